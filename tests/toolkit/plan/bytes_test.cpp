// What the plan expects against what comes of it, over points of every kind: random, uneven, noisy, raster,
// closed and open, many and few, large and small.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string_view>

#include <palpate/registry.h>
#include "tests/in_folder.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/plan/plan.h"
#include "toolkit/render/prepare.h"

namespace palpate::plan {
namespace {

/// Of what is held.
constexpr double kShare = 0.25;
/// Of `cloud-smooth`: how many smaller bricks edges and noise need is known once they are built, and strips
/// of a model have edges of their own, and of uneven points larger bricks where the whole has none. Within a
/// factor of two and some.
constexpr double kSmoothShare = 1.4;
double share_of(const std::string& name, double said, double held) {
  return name == "cloud-smooth" ? kSmoothShare * std::min(said, held) : kShare * held;
}
/// Edges are not counted beforehand, as the plan says: where faces meet each has a brick of its own, and on a
/// thin plate with rounded edges that is 1.6 times as much.
constexpr double kEdgesMost = 1.75;
/// Below so much the fixed parts count: a table's least size, one brick.
constexpr double kFewBytes = 8192.0;

const char* const kScenes[] = {
    "sinusoid:points=4225",
    "sinusoid:points=4000:sampling=random:noise=0.1:seed=4",
    "sinusoid:points=4000:sampling=random:density=30:seed=6",
    "torus:points=4000:sampling=random:density=100:seed=7",
    "sphere:points=5000:scale=0.0001",
    "slab:points=4000:sampling=random:seed=10",
    "shells:points=4000",
    "rounded-box:points=5000:sampling=random:seed=12",
    "relief:points=4000:sampling=random:seed=13",
    "plane:points=4000:sampling=random:outliers=0.01:seed=14",
};

/// As a hand would go over it.
std::string path_on(const render::SceneInput& scene, int frames = 600) {
  const double size = scene.models[0].cloud->box_mm().extent_mm().norm();
  return fmt::format("exploration:frames={3}:depth_mm={0}:clearance_mm={1}:slowest_mm_s={2}:fastest_mm_s={2}",
                     size / 100.0, size / 300.0, size / 5.0, frames);
}

TEST(Bytes, AreExpectedWithinAQuarter) {
  const Machine machine{"some", {{1.0, 1.0}}, false};
  const render::Registry& registry = render::toolkit_renderers();
  int checked = 0;
  for (const char* scene_text : kScenes) {
    const render::SceneInput scene = render::generated(scene_text).input;
    for (const char* name :
         {"cloud", "cloud:refine=1", "cloud-smooth", "cloud-literal", "heightfield", "heightfield-literal"}) {
      SCOPED_TRACE(std::string(scene_text) + " " + name);
      const NamedOptions named = parse_named_options(name).value();
      Result<Plan> decided = make_plan(scene, named, registry, {1, nullptr});
      const Result<render::PrepareReport> report = render::prepare_report(scene, name);
      ASSERT_EQ(decided.ok(), report.ok());
      if (!decided) continue;  // no height field
      estimate_on_machine(*decided, scene, registry, path_on(scene), machine);
      ASSERT_GT(decided->decided.bytes, 0u);
      const auto said = static_cast<double>(decided->decided.bytes),
                 held = static_cast<double>(report->bytes);
      EXPECT_LE(std::abs(said - held), std::max(kShare * held, kFewBytes))
          << said << " said, " << held << " held";
      ++checked;
    }
  }
  EXPECT_GT(checked, 4 * static_cast<int>(std::size(kScenes)) - 1);
}

// Of what is more than one piece the pieces are strips along the probe's way.
TEST(Bytes, OfLargeModelsAreExpectedWithinAQuarter) {
  const Machine machine{"some", {{1.0, 1.0}}, false};
  const render::Registry& registry = render::toolkit_renderers();
  for (const char* scene_text :
       {"sinusoid:points=40000:sampling=random:noise=0.1:seed=4",
        "torus:points=40000:sampling=random:density=30:seed=6", "slab:points=40000:sampling=random:seed=10",
        "relief:points=40000:sampling=random:seed=13"}) {
    const render::SceneInput scene = render::generated(scene_text).input;
    for (const char* name : {"cloud", "cloud:refine=1", "cloud-smooth"}) {
      SCOPED_TRACE(std::string(scene_text) + " " + name);
      const NamedOptions named = parse_named_options(name).value();
      Plan decided = make_plan(scene, named, registry, {1, nullptr}).value();
      const auto held = static_cast<double>(render::prepare_report(scene, name)->bytes);
      estimate_on_machine(decided, scene, registry, path_on(scene, 12'000), machine);  // twelve pieces
      const auto said = static_cast<double>(decided.decided.bytes);
      const bool edges = std::string_view(scene_text).starts_with("slab") && named.name == "cloud-smooth";
      EXPECT_LE(said - held, share_of(named.name, said, held)) << said << " said, " << held << " held";
      EXPECT_LE(held - (edges ? kEdgesMost : 1.0) * said, share_of(named.name, said, held))
          << said << " said, " << held << " held";
    }
  }
}

/// A sphere at the origin and another one so many of its spacings along x.
std::vector<Vec3> two_spheres(const render::Scene& sphere, double spacings, bool second) {
  std::vector<Vec3> points;
  const cloud::Cloud& cloud = *sphere.input.models[0].cloud;
  const Vec3 off(second ? spacings * sphere.spacing_mm : 0.0, 0.0, 0.0);
  for (std::size_t i = 0; i < cloud.size(); ++i) points.push_back(cloud.point_mm(i) + off);
  return points;
}

std::string reason_of_coordinates(const Plan& plan, std::size_t model = 0) {
  for (const render::Decision& d : plan.decided.models[model].decisions)
    if (d.about == "coordinates") return d.choice + "; " + d.reason;
  return {};
}

// The limit is where it is said to be; and who does as the plan says has floats that are fine enough.
TEST(Precision, TheLimitAndItsRemedyAreAsThePlanSays) {
  const render::Registry& registry = render::toolkit_renderers();
  const NamedOptions named = parse_named_options("cloud").value();
  const render::Scene sphere = render::generated("sphere:points=2000");
  const auto planned = [&](const render::SceneInput& scene) {
    return make_plan(scene, named, registry, {1, nullptr}).value();
  };
  for (const int power : {10, 17, 18, 19, 20}) {
    SCOPED_TRACE(power);
    const double spacings = std::ldexp(1.0, power);
    std::vector<Vec3> points = two_spheres(sphere, spacings, false);
    const std::vector<Vec3> second = two_spheres(sphere, spacings, true);
    points.insert(points.end(), second.begin(), second.end());
    const render::SceneInput whole = render::cloud_of(points);
    const Plan plan = planned(whole);
    const std::string reason = reason_of_coordinates(plan);
    // The plan's spacing is measured, and a little off the one that the points were made with.
    const double share = render::coordinate_rounding_mm(*whole.models[0].cloud) / plan.spacing_mm[0];
    EXPECT_NEAR(share, std::ldexp(1.0, power - 25), 0.4 * std::ldexp(1.0, power - 25));
    const bool fits = share <= render::kMaxRoundingShare;
    EXPECT_EQ(plan.warnings.empty(), fits) << reason;
    EXPECT_EQ(reason.find("TOO COARSE") == std::string::npos, fits) << reason;
    EXPECT_EQ(fits, power <= 18);
    if (fits) {
      EXPECT_TRUE(test::contains(reason, fmt::format("2^{:.0f} spacings", std::log2(share) + 25.0)));
      EXPECT_TRUE(test::contains(reason, "up to 2^18"));
      continue;
    }
    const double parts = std::ceil(share / render::kMaxRoundingShare);
    EXPECT_TRUE(test::contains(reason, fmt::format("{:.0f} along its longest side", parts)));
    ASSERT_GE(parts, 2.0);
    // Cut in so many, the two spheres come into different ones.
    render::SceneInput cut = render::cloud_of(two_spheres(sphere, spacings, false));
    cut.models.push_back(render::cloud_of(second).models[0]);
    const Plan better = planned(cut);
    EXPECT_TRUE(better.warnings.empty()) << better.warnings.front();
    for (std::size_t i = 0; i < 2; ++i)
      EXPECT_FALSE(test::contains(reason_of_coordinates(better, i), "TOO COARSE"));
  }
}

class MachineTest : public InFolder {};

TEST_F(MachineTest, IsMeasuredOnceAndReadAgain) {
  ::setenv("XDG_CACHE_HOME", in("cache").c_str(), 1);
  const Machine first = measure_machine("1", false, nullptr);
  const Machine again = measure_machine("1", false, nullptr);
  EXPECT_FALSE(first.from_cache);
  EXPECT_TRUE(again.from_cache);
  ASSERT_EQ(first.reads.size(), again.reads.size());
  for (std::size_t i = 0; i < first.reads.size(); ++i) EXPECT_EQ(first.reads[i].ns, again.reads[i].ns);
  EXPECT_FALSE(measure_machine("2", false, nullptr).from_cache) << "another version";
  // A file that somebody has written over is not believed.
  for (const auto& file : std::filesystem::directory_iterator(in("cache/palpate")))
    std::ofstream(file.path()) << "palpate-machine-1\n" << first.cpu << "\n16384 -3\nnan nan\n";
  EXPECT_FALSE(measure_machine("1", false, nullptr).from_cache);
}

TEST(Machine, ReadsBetweenSizesLieBetweenThem) {
  Machine machine;
  EXPECT_EQ(machine.read_ns(1e6), 0.0);
  machine.reads = {{1024.0, 1.0}, {4096.0, 3.0}, {16384.0, 9.0}};
  EXPECT_EQ(machine.read_ns(10.0), 1.0);
  EXPECT_NEAR(machine.read_ns(2048.0), 2.0, 1e-12);
  EXPECT_NEAR(machine.read_ns(8192.0), 6.0, 1e-12);
  EXPECT_EQ(machine.read_ns(1e9), 9.0);
}

TEST(Pilot, WaitsForMemoryByWhatTheWholePathReads) {
  Machine machine;
  machine.reads = {{64e3, 1.0}, {64e6, 101.0}};
  // 2 lines a frame come anew, 128 kB on the pieces; the whole path is ten times as long.
  const ColdCacheRun pieces{200.0, 1000.0, 10.0, 1e9};
  EXPECT_NEAR(memory_wait_ns(pieces, machine), 2.0 * (machine.read_ns(1.28e6) - machine.read_ns(128e3)),
              1e-9);
  EXPECT_GT(memory_wait_ns(pieces, machine), 0.0) << "the whole is larger than its cut-outs";
  // No more is read than there is, and no less than the pieces read.
  EXPECT_NEAR(memory_wait_ns({200.0, 1000.0, 10.0, 256e3}, machine),
              2.0 * (machine.read_ns(256e3) - machine.read_ns(128e3)), 1e-9);
  EXPECT_EQ(memory_wait_ns({200.0, 1000.0, 10.0, 1e3}, machine), 0.0);
  // Times that tell nothing.
  EXPECT_EQ(memory_wait_ns({-1.0, 1000.0, 10.0, 1e9}, machine), 0.0) << "cold was no slower";
  machine.reads = {{64e3, 1.0}};
  EXPECT_EQ(memory_wait_ns(pieces, machine), 0.0);
}

TEST(Pilot, StepsCutOutsOfTheScene) {
  const render::Registry& registry = render::toolkit_renderers();
  const render::SceneInput scene = render::generated("torus:points=20000:sampling=random:seed=2").input;
  Plan plan = make_plan(scene, parse_named_options("cloud").value(), registry, {1, nullptr}).value();
  const std::optional<double> before = plan.decided.frame_us;
  Machine machine;
  machine.reads = {{1.0, 1.0}, {1e9, 1e4}};  // a machine whose memory is slow
  const std::string path =
      "exploration:frames=50000:depth_mm=0.7:clearance_mm=0.14:slowest_mm_s=5.8:fastest_mm_s=29";
  estimate_on_machine(plan, scene, registry, path, machine);
  ASSERT_TRUE(plan.cost.has_value());
  EXPECT_EQ(plan.cost->excerpts, kMaxExcerpts);
  EXPECT_GT(plan.cost->warm_us, 0.0);
  EXPECT_GE(plan.cost->miss_us, 0.0);
  EXPECT_NE(plan.decided.frame_us, before);
  // Nothing is felt where the probe stays away: the plan says what it said.
  Plan other = make_plan(scene, parse_named_options("cloud").value(), registry, {1, nullptr}).value();
  estimate_on_machine(other, scene, registry, "no-such-path", machine);
  EXPECT_FALSE(other.cost.has_value());
  EXPECT_EQ(other.decided.frame_us, before);
}

}  // namespace
}  // namespace palpate::plan
