// Reconstructions within limits, in a process of their own, and their cache.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include <palpate/generate.h>
#include "baselines/reconstruct/method_functions.h"
#include "baselines/reconstruct/reconstruct.h"
#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"

namespace palpate::baselines {
namespace {

namespace fs = std::filesystem;

cloud::Cloud points(const std::string& spec) {
  return test::generated(spec).cloud;
}

std::size_t files_in(const fs::path& folder) {
  std::error_code code;
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder, code), fs::directory_iterator()));
}

bool no_child_left() {
  return ::waitpid(-1, nullptr, WNOHANG) < 0 && errno == ECHILD;
}

class Limited : public testing::Test {
 protected:
  Limited() {
    std::string name = (fs::temp_directory_path() / "palpate-meshes-XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
  }
  ~Limited() override {
    std::error_code code;
    fs::remove_all(folder_, code);
    ::unsetenv("PALPATE_RECONSTRUCT");
  }
  Result<Reconstruction> run(const std::string& method, const cloud::Cloud& cloud, Limits limits = {},
                             MeshCache* cache = nullptr, Progress& progress = no_progress()) {
    ReconstructRequest request;
    request.method = method;
    request.limits = limits;
    request.threads = 1;
    request.cache = cache;
    return reconstruct(request, cloud, progress);
  }
  fs::path folder_;
};

TEST_F(Limited, TheOtherProcessMakesTheSameMesh) {
  const cloud::Cloud cloud = points("sinusoid:points=900");
  for (const char* name : {"advancing-front", "power-crust", "organised"}) {
    const auto there = test::value_of(run(name, cloud));
    const Method& method = *test::value_of(find_method(name));
    render::PrepareReport report;
    render::PreparePhases phases(report, {1, nullptr});
    const auto here =
        test::value_of(make_mesh(method, cloud, validate({}, method.options, name).value(), 1, phases));
    // Inside one process CGAL's second triangulation of a regular grid breaks ties otherwise than its first.
    const auto triangles = static_cast<double>(here.triangles.size());
    EXPECT_NEAR(static_cast<double>(there.mesh.triangles.size()), triangles, 0.02 * triangles) << name;
    const auto again = test::value_of(run(name, cloud));
    EXPECT_TRUE(there.mesh.vertices_mm == again.mesh.vertices_mm) << name;
    EXPECT_TRUE(there.mesh.triangles == again.mesh.triangles) << name;
    ASSERT_EQ(there.made.phases.size(), report.phases.size());
    EXPECT_EQ(there.made.phases.back().name, report.phases.back().name);
    EXPECT_GT(there.peak_bytes, there.mesh.bytes());
    EXPECT_FALSE(there.recorded);
  }
  EXPECT_TRUE(no_child_left());
}

TEST_F(Limited, GivesUpInTimeAndLeavesNothing) {
  const cloud::Cloud cloud = points("sphere:points=200000");
  // A folder of its own for what is temporary: other tests that run beside this one use the common one.
  ::setenv("TMPDIR", folder_.c_str(), 1);
  const auto made = run("poisson", cloud, {0.05, 0});
  ::unsetenv("TMPDIR");
  ASSERT_TRUE(test::refused(made, "did not finish in 0.05 s"));
  EXPECT_TRUE(made.error().gave_up);
  EXPECT_TRUE(no_child_left());
  EXPECT_EQ(files_in(folder_), 0u);
}

TEST_F(Limited, GivesUpAtTheLimitOfMemory) {
  const cloud::Cloud cloud = points("sphere:points=200000");
  const auto made = run("power-crust", cloud, {0.0, 150'000'000});
  ASSERT_TRUE(test::refused(made, "0.15 GB"));
  EXPECT_TRUE(made.error().gave_up) << made.error().message();
  EXPECT_TRUE(no_child_left());
}

TEST_F(Limited, StopsWhenAsked) {
  struct Stop final : Progress {
    void report(std::string_view, double) override { ++reports; }
    [[nodiscard]] bool cancelled() const override { return reports > 1; }
    int reports = 0;
  } stop;
  const auto made = run("poisson", points("sphere:points=200000"), {0.0, 0}, nullptr, stop);
  ASSERT_TRUE(test::refused(made, "stopped"));
  EXPECT_FALSE(made.error().gave_up);
  EXPECT_TRUE(no_child_left());
}

TEST_F(Limited, ErrorsComeBackWhole) {
  const auto made = run("organised", points("sphere:points=500"));
  ASSERT_TRUE(test::refused(made, "raster"));
  EXPECT_NE(made.error().remedy, "");
  EXPECT_FALSE(made.error().gave_up);
}

TEST_F(Limited, SaysHowAProgramEnded) {
  const cloud::Cloud cloud = points("sphere:points=500");
  const fs::path script = folder_ / "worker";
  const auto with = [&](const char* text) {
    std::ofstream(script) << "#!/bin/sh\n" << text << "\n";
    fs::permissions(script, fs::perms::owner_all);
    ::setenv("PALPATE_RECONSTRUCT", script.c_str(), 1);
    return run("poisson", cloud);
  };
  EXPECT_TRUE(test::refused(with("echo the last words; exit 3"), "the last words"));
  EXPECT_TRUE(test::refused(with("kill -SEGV $$"), "crashed"));
  EXPECT_FALSE(with("echo nonsense >&0; exit 0").ok());
  fs::remove(script);
  EXPECT_TRUE(test::refused(run("poisson", cloud), "PALPATE_RECONSTRUCT"));
  EXPECT_TRUE(no_child_left());
}

TEST_F(Limited, KeepsAMeshWithTheTimesItTook) {
  MeshCache cache(folder_);
  const cloud::Cloud cloud = points("sinusoid:points=900");
  const auto first = test::value_of(run("advancing-front", cloud, {}, &cache));
  EXPECT_EQ(files_in(folder_), 1u);
  const auto second = test::value_of(run("advancing-front", cloud, {}, &cache));
  EXPECT_FALSE(first.recorded);
  EXPECT_TRUE(second.recorded);
  EXPECT_TRUE(first.mesh.triangles == second.mesh.triangles);
  EXPECT_TRUE(first.mesh.vertices_mm == second.mesh.vertices_mm);
  EXPECT_EQ(first.made.total_ms, second.made.total_ms);
  EXPECT_EQ(first.made_on, second.made_on);
  EXPECT_EQ(first.peak_bytes, second.peak_bytes);
  // Other points, another method, another option: other entries.
  EXPECT_FALSE(run("advancing-front", points("sinusoid:points=961"), {}, &cache)->recorded);
  EXPECT_FALSE(run("alpha-shape", cloud, {}, &cache)->recorded);
  ReconstructRequest request;
  request.method = "advancing-front";
  request.options.set("front_beta", "0.6");
  request.cache = &cache;
  EXPECT_FALSE(reconstruct(request, cloud, no_progress())->recorded);
  EXPECT_EQ(files_in(folder_), 4u);
}

TEST_F(Limited, MakesADamagedEntryAnew) {
  MeshCache cache(folder_);
  const cloud::Cloud cloud = points("sinusoid:points=900");
  ASSERT_TRUE(run("advancing-front", cloud, {}, &cache).ok());
  const fs::path entry = fs::directory_iterator(folder_)->path();
  const auto size = static_cast<std::streamoff>(fs::file_size(entry));
  for (const std::streamoff at : {std::streamoff{0}, std::streamoff{20}, size / 2, size - 1}) {
    {
      std::fstream file(entry, std::ios::in | std::ios::out | std::ios::binary);
      file.seekg(at);
      const int byte = file.get();
      file.seekp(at);
      file.put(static_cast<char>(byte ^ 0x40));
    }
    EXPECT_FALSE(test::value_of(run("advancing-front", cloud, {}, &cache)).recorded) << at;
  }
  fs::resize_file(entry, 10);
  EXPECT_FALSE(run("advancing-front", cloud, {}, &cache)->recorded);
  EXPECT_TRUE(run("advancing-front", cloud, {}, &cache)->recorded);
}

TEST_F(Limited, RemembersThatALimitWasReached) {
  MeshCache cache(folder_);
  const cloud::Cloud cloud = points("sphere:points=20000");
  ASSERT_FALSE(run("advancing-front", cloud, {0.03, 0}, &cache).ok());
  const auto again = run("advancing-front", cloud, {0.02, 0}, &cache);
  ASSERT_TRUE(test::refused(again, "recorded"));
  EXPECT_TRUE(again.error().gave_up);
  (void)test::value_of(run("advancing-front", cloud, {0.0, 0}, &cache));
  EXPECT_TRUE(run("advancing-front", cloud, {0.02, 0}, &cache)->recorded);
}

TEST_F(Limited, SeveralMayUseOneCache) {
  const cloud::Cloud cloud = points("sinusoid:points=2500");
  std::vector<std::thread> threads;
  std::array<std::size_t, 4> triangles{};
  for (std::size_t i = 0; i < triangles.size(); ++i)
    threads.emplace_back([&, i] {
      MeshCache cache(folder_);
      const auto made = run("advancing-front", cloud, {}, &cache);
      triangles[i] = made.ok() ? made->mesh.triangles.size() : 0;
    });
  for (std::thread& t : threads) t.join();
  EXPECT_GT(triangles[0], 0u);
  EXPECT_EQ(std::count(triangles.begin(), triangles.end(), triangles[0]), 4);
  EXPECT_EQ(files_in(folder_), 1u);
  MeshCache cache(folder_);
  EXPECT_TRUE(run("advancing-front", cloud, {}, &cache)->recorded);
}

TEST_F(Limited, StaysWithinItsRoom) {
  MeshCache cache(folder_, 200'000);
  for (const char* spec : {"sinusoid:points=900", "sinusoid:points=961", "sinusoid:points=1024"})
    ASSERT_TRUE(run("advancing-front", points(spec), {}, &cache).ok());
  std::uint64_t sum = 0;
  for (const fs::directory_entry& file : fs::directory_iterator(folder_)) sum += file.file_size();
  EXPECT_LE(sum, 200'000u);
  EXPECT_GT(sum, 0u);
  EXPECT_TRUE(run("advancing-front", points("sinusoid:points=1024"), {}, &cache)->recorded);
}

}  // namespace
}  // namespace palpate::baselines
