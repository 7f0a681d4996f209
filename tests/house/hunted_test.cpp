// What the hunt and the fuzzer found: played by every renderer of ours in every build.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/house/all_renderers.h"
#include "tests/house/corpus_scene.h"
#include "toolkit/trace/replay.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace palpate::house {
namespace {

namespace fs = std::filesystem;

/// A god object that comes to rest may end farther by what its last step leaves: cloud-smooth stops at a
/// hundredth of a voxel, whose square is the error of the squared distance.
constexpr double kRestShare = 1e-5;

std::vector<std::string> files_in(const std::string& folder, const std::string& ending) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ending) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

void expect_promises(const trace::ProbePath& path, const trace::ForceTrace& trace) {
  Vec3 god = path.hip_mm[0];
  double stored = 0.0, made = 0.0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const render::Frame& frame = trace.frames[k];
    ASSERT_TRUE(is_finite(frame.force_n) && is_finite(frame.god_object_mm)) << "frame " << k;
    ASSERT_TRUE(frame.contact || frame.force_n == Vec3::Zero()) << "frame " << k;
    const double now = (path.hip_mm[k] - frame.god_object_mm).squaredNorm();
    stored = std::max(stored, now);
    if (frame.contact) made += std::max(0.0, now - (path.hip_mm[k] - god).squaredNorm());
    god = frame.contact ? frame.god_object_mm : path.hip_mm[k];
  }
  EXPECT_NE(trace.frames.back().status, render::FrameStatus::kBoundHit) << "after a rest";
  EXPECT_LE(made, kRestShare * stored) << "energy out of nothing";
}

TEST(Hunted, CasesKeepTheirPromisesNow) {
  render::Registry registry;
  register_all_renderers(registry);
  const std::string folder = corpus_folder() + "../hunt/";
  int played = 0;
  for (const std::string& name : files_in(folder, ".toml")) {
    const CorpusScene loaded = load_corpus("../hunt/" + name + ".toml", "../hunt/" + name + ".csv");
    for (const render::RendererInfo& info : registry.all()) {
      if (info.role != render::Role::kOurs) continue;
      SCOPED_TRACE(name + " by " + info.name);
      auto renderer = registry.make(info.name, {});
      ASSERT_TRUE(renderer.ok()) << renderer.error().message();
      if (!(*renderer)->prepare(loaded.scene.input, {1, nullptr})) continue;
      const auto first = trace::replay(**renderer, loaded.path),
                 again = trace::replay(**renderer, loaded.path);
      ASSERT_TRUE(first.ok() && again.ok());
      EXPECT_EQ(trace::trace_hash(*first), trace::trace_hash(*again)) << "a restart forgets everything";
      expect_promises(loaded.path, *first);
      ++played;
    }
  }
  EXPECT_GT(played, 0);
}

TEST(Hunted, BytesOfTheFuzzerEndWell) {
  const std::string folder = corpus_folder() + "../frame/";
  int played = 0;
  for (const std::string& name : files_in(folder, ".bin")) {
    SCOPED_TRACE(name);
    std::ifstream file(folder + name + ".bin", std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    EXPECT_EQ(LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), 0);
    ++played;
  }
  EXPECT_GT(played, 0);
}

}  // namespace
}  // namespace palpate::house
