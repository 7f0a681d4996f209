// Path generators: constant speed, the printed offset, free starts, the same bits every time.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numbers>
#include <sstream>
#include <string>
#include <tuple>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include "tests/toolkit/messages.h"
#include "toolkit/core/hash.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::paths {
namespace {

struct Target {
  cloud::GeneratedModel model;
  PathTarget target;
};

Target target_of(const std::string& spec) {
  Target made{cloud::generate(*parse_named_options(spec)).value(), {}};
  made.target.surface = made.model.surface.get();
  made.target.cloud = &made.model.cloud;
  made.target.mesh = made.model.original_mesh.get();
  made.target.box_mm = made.model.cloud.box_mm();
  made.target.spacing_mm = made.model.nominal_spacing_mm;
  // What a hand feels: the formula's closest point.
  static constexpr double kFormulaNPerMm = 0.5;
  made.target.stiffness_n_per_mm = kFormulaNPerMm;
  made.target.felt = [surface = made.model.surface]() -> Result<ForceFunction> {
    return ForceFunction([surface](const Vec3& hip) -> Vec3 {
      if (!(surface->signed_distance_mm(hip) < 0.0)) return Vec3::Zero();
      return kFormulaNPerMm * (surface->closest(hip).point_mm - hip);
    });
  };
  return made;
}

/// All but `hand`, which has no depth of its own.
std::vector<PathGenerator> laid_generators() {
  std::vector<PathGenerator> all = path_generators();
  std::erase_if(all, [](const PathGenerator& generator) { return generator.name == "hand"; });
  return all;
}

trace::ProbePath path_of(const std::string& spec, const PathTarget& target) {
  auto path = make_path(*parse_named_options(spec), target);
  EXPECT_TRUE(path) << spec << ": " << (path ? "" : path.error().message());
  return path ? *path : trace::ProbePath{};
}

std::uint64_t hash_of(const trace::ProbePath& path) {
  Hash64 hash;
  for (std::size_t i = 0; i < path.size(); ++i) {
    hash.real(path.t_s[i]);
    for (int axis = 0; axis < 3; ++axis) hash.real(path.hip_mm[i][axis]);
  }
  return hash.value();
}

std::string refusal(const std::string& spec, const PathTarget& target) {
  const auto path = make_path(*parse_named_options(spec), target);
  return path ? "accepted" : path.error().message();
}

double printed_offset(std::size_t k, double depth) {
  return (depth + 0.4) / 2 * std::cos(2 * std::numbers::pi * static_cast<double>(k) / 900) -
         (depth - 0.4) / 2;
}

TEST(Paths, WeaveIsTheFormulaOfTheDesign) {
  const Target t = target_of("sinusoid:points=100");
  const trace::ProbePath path = path_of("weave:frames=20000", t.target);
  ASSERT_EQ(path.size(), 20000u);
  EXPECT_EQ(path.t_s[1500], 1.5);
  EXPECT_TRUE(test::contains(path.name, "weave:", "depth_mm=2"));
  Vec3 last = Vec3::Zero();
  Vec3 lowest = Vec3::Constant(1e9), highest = -lowest;
  for (std::size_t k = 0; k < path.size(); ++k) {
    // Shallower than the radius of curvature (6.3 mm), the foot of the HIP is what it was set off from.
    const geometry::SurfacePoint s = t.target.surface->closest(path.hip_mm[k]);
    ASSERT_NEAR((path.hip_mm[k] - s.point_mm).dot(s.normal), printed_offset(k, 2), 1e-9) << k;
    if (k > 0) {
      ASSERT_NEAR((s.point_mm - last).norm(), 0.05, 0.05 * 0.01) << "50 mm/s at 1 kHz, frame " << k;
    }
    last = s.point_mm;
    lowest = lowest.cwiseMin(s.point_mm);
    highest = highest.cwiseMax(s.point_mm);
  }
  // 80 % of the extent, to the rim on each side: a metre of way turns there several times, and around a turn
  // a frame of 0.05 mm strays from it by the square of that.
  for (int axis = 0; axis < 2; ++axis) {
    EXPECT_GE(lowest[axis], -40 - 1e-9);
    EXPECT_LE(highest[axis], 40 + 1e-9);
    EXPECT_NEAR(lowest[axis], -40, 0.05);
    EXPECT_NEAR(highest[axis], 40, 0.05);
  }
}

TEST(Paths, TheSameForEverySpacingOfASurface) {
  const Target coarse = target_of("sinusoid:points=100"),
               fine = target_of("sinusoid:points=250000:jitter=0.3");
  for (const char* name : {"weave", "raster", "spiral", "tap", "slide", "hold"})
    EXPECT_EQ(hash_of(path_of(std::string(name) + ":frames=3000", coarse.target)),
              hash_of(path_of(std::string(name) + ":frames=3000", fine.target)))
        << name;
}

TEST(Paths, AllStartFreeRunSmoothlyAndTouchOnEveryShape) {
  for (const char* shape :
       {"sinusoid", "plane", "saddle", "wedge:angle_deg=80", "wedge:angle_deg=300", "sphere", "torus",
        "slab:thickness_mm=5", "ellipsoid", "rounded-box", "shells:gap_mm=5"}) {
    const Target t = target_of(std::string(shape) + ":points=10000");
    for (const auto& generator : path_generators()) {
      const trace::ProbePath path = path_of(generator.name + ":frames=4000", t.target);
      SCOPED_TRACE(std::string(shape) + " " + generator.name);
      ASSERT_EQ(path.size(), 4000u);
      EXPECT_TRUE(check_path_starts_free(path, *t.target.surface, {}));
      std::size_t inside = 0, outside = 0;
      for (std::size_t k = 0; k < path.size(); ++k) {
        ASSERT_TRUE(is_finite(path.hip_mm[k])) << k;
        if (k > 0) {
          ASSERT_GT(path.t_s[k], path.t_s[k - 1]);
          // Strokes are four times as fast as all others.
          ASSERT_LT((path.hip_mm[k] - path.hip_mm[k - 1]).norm(), generator.name == "strokes" ? 1.0 : 0.25)
              << k;
        }
        if (k % 10 == 0) (t.target.surface->signed_distance_mm(path.hip_mm[k]) < 0 ? inside : outside)++;
      }
      EXPECT_GT(inside, 20u);
      EXPECT_GT(outside, generator.name == "hold" ? 5u : 10u);
    }
  }
}

TEST(Paths, NoneGoesDeeperThanItsDepthOnAnyShape) {
  // `exploration` follows planes fitted to points a millimetre apart, which round off an edge by as much.
  constexpr double kRounding = 1.0;
  for (const char* shape :
       {"sinusoid", "plane", "saddle", "relief", "wedge:angle_deg=80", "wedge:angle_deg=300", "sphere",
        "pebble", "torus", "slab:thickness_mm=5", "ellipsoid", "rounded-box", "shells:gap_mm=5"}) {
    const Target t = target_of(std::string(shape) + ":points=10000");
    for (const auto& generator : laid_generators()) {
      SCOPED_TRACE(std::string(shape) + " " + generator.name);
      // Strokes are at their full depth in few frames.
      const std::string frames = generator.name == "strokes" ? "20000" : "6000";
      const trace::ProbePath path = path_of(generator.name + ":depth_mm=2:frames=" + frames, t.target);
      double deepest = 0;
      for (std::size_t k = 0; k < path.size(); k += 5)
        deepest = std::max(deepest, -t.target.surface->signed_distance_mm(path.hip_mm[k]));
      EXPECT_LE(deepest, 2 + (generator.name == "exploration" ? kRounding : 1e-3));
      EXPECT_GE(deepest, 2 - 1e-3);
    }
  }
}

TEST(Paths, SlideHoldsItsDepthWhereTheSurfaceBends) {
  for (const char* shape : {"saddle", "sinusoid", "sphere"}) {
    const Target t = target_of(std::string(shape) + ":points=100");
    const trace::ProbePath path = path_of("slide:frames=1500:depth_mm=2", t.target);
    for (std::size_t k = 100; k < path.size(); ++k)
      ASSERT_NEAR(t.target.surface->signed_distance_mm(path.hip_mm[k]), -2.0, 1e-4) << shape << ' ' << k;
  }
}

TEST(Paths, ConstantSurfaceSpeedOnRoundShapesToo) {
  for (const char* shape : {"sphere", "torus", "saddle"})
    for (const char* name : {"weave", "spiral", "raster"}) {
      const Target t = target_of(std::string(shape) + ":points=1000");
      const trace::ProbePath path =
          path_of(std::string(name) + ":frames=5000:depth_mm=0.5:speed_mm_s=30", t.target);
      std::size_t off = 0;
      Vec3 last = Vec3::Zero();
      for (std::size_t k = 0; k < path.size(); ++k) {
        const Vec3 foot = t.target.surface->closest(path.hip_mm[k]).point_mm;
        if (k > 0) off += std::abs((foot - last).norm() - 0.03) > 0.0003;
        last = foot;
      }
      EXPECT_EQ(off, 0u) << shape << ' ' << name;
    }
}

std::string exact(double x) {
  std::ostringstream text;
  text << std::setprecision(17) << x;
  return text.str();
}

TEST(Paths, WorkAtEveryScale) {
  // Powers of two scale without rounding: paths are the same to the last bit, as nothing in them is absolute.
  for (const double scale : {0x1p-10, 0x1p20}) {
    // Jittered, so that one crest is the highest.
    const std::string model = "sinusoid:points=2500:jitter=0.2:scale=";
    const Target t = target_of(model + exact(scale)), one = target_of(model + "1");
    for (const auto& generator : laid_generators()) {
      const auto spec = [&](double f) {
        std::string text =
            generator.name + ":frames=2000:depth_mm=" + exact(2 * f) + ":clearance_mm=" + exact(0.5 * f);
        for (const OptionSpec& option : generator.options)
          if (option.key.ends_with("mm_s")) text += ":" + option.key + "=" + exact(32 * f);
        return text;
      };
      const trace::ProbePath path = path_of(spec(scale), t.target), reference = path_of(spec(1), one.target);
      ASSERT_EQ(path.size(), reference.size());
      for (std::size_t k = 0; k < path.size(); ++k)
        ASSERT_EQ(path.hip_mm[k], scale * reference.hip_mm[k]) << generator.name << ' ' << scale << ' ' << k;
    }
  }
}

TEST(Paths, PoseMovesThePath) {
  Target t = target_of("sinusoid:points=100");
  const trace::ProbePath home = path_of("weave:frames=100", t.target);
  t.target.world_from_model.rotation = Eigen::AngleAxisd(1.0, Vec3(1, 2, 3).normalized());
  t.target.world_from_model.translation_mm = {1e6, -2e6, 5};
  const trace::ProbePath away = path_of("weave:frames=100", t.target);
  for (std::size_t k = 0; k < home.size(); ++k)
    EXPECT_LT((t.target.world_from_model.inverse() * away.hip_mm[k] - home.hip_mm[k]).norm(), 1e-8);
}

TEST(Paths, Deterministic) {
  const Target t = target_of("sphere:points=5000");
  for (const auto& generator : path_generators()) {
    const std::string spec = generator.name + ":frames=2000";
    EXPECT_EQ(hash_of(path_of(spec, t.target)), hash_of(path_of(spec, t.target))) << generator.name;
  }
}

TEST(Paths, WhatDoesNothingIsNoOption) {
  const Target t = target_of("plane:points=400");
  for (const char* spec : {"raster:seed=2", "spiral:seed=2", "tap:seed=2", "hold:seed=2", "slide:seed=2",
                           "slide:period_frames=500"}) {
    EXPECT_TRUE(test::refused(make_path(parse_named_options(spec).value(), t.target), "has no option"))
        << spec;
  }
  // Every option that is left moves the path, or its times.
  for (const PathGenerator& generator : path_generators())
    for (const OptionSpec& option : generator.options) {
      if (option.kind != OptionKind::kNumber && option.kind != OptionKind::kInteger) continue;
      const double was = parse_number(option.default_value).value();
      // Another value than the default, nearby, in range; the shortest path that any of them shows on.
      const double now = was > 0.0 ? std::min(0.5 * was, option.high) : 0.1;
      const std::string text = option.key == "frames"                ? "1999"
                               : option.kind == OptionKind::kInteger ? fmt::format("{}", was + 1.0)
                                                                     : fmt::format("{}", now);
      // A share of strokes needs many of them to show.
      const std::string base =
          generator.name + (generator.name == "strokes" ? ":frames=20000" : ":frames=2000");
      const std::string changed =
          option.key == "frames" ? generator.name + ":frames=" + text : base + ":" + option.key + "=" + text;
      const trace::ProbePath before = path_of(base, t.target), after = path_of(changed, t.target);
      EXPECT_TRUE(before.t_s != after.t_s || before.hip_mm != after.hip_mm) << changed;
    }
}

TEST(Paths, HoldStandsStill) {
  const Target t = target_of("plane:points=100");
  const trace::ProbePath path = path_of("hold:frames=2000", t.target);
  for (std::size_t k = 450; k < path.size(); ++k)
    EXPECT_LT((path.hip_mm[k] - Vec3(-10, -10, -2)).norm(), 1e-13);
  const trace::ProbePath shaking = path_of("hold:frames=2000:tremor_mm=0.1", t.target);
  double highest = -10;
  for (std::size_t k = 450; k < path.size(); ++k) highest = std::max(highest, shaking.hip_mm[k].z());
  EXPECT_NEAR(highest, -1.9, 1e-3);
}

TEST(Paths, SlideLeavesOverTheEdgeOfTheSlab) {
  const Target t = target_of("slab:points=1000");
  const trace::ProbePath path = path_of("slide:frames=3000:depth_mm=0.2", t.target);
  // Down 0.6 mm, then along x at z = 0.3 from -10 to beyond 25.
  bool under = false, beyond = false;
  for (const Vec3& hip : path.hip_mm) {
    under |= std::abs(hip.z() - 0.3) < 1e-9 && hip.x() < 24;
    beyond |= hip.x() > 26;
  }
  EXPECT_TRUE(under);
  EXPECT_TRUE(beyond);
}

TEST(Paths, ExplorationStaysWithTheCloudAtHumanSpeed) {
  for (const char* shape :
       {"sphere:points=30000", "torus:points=30000:mesh=false", "sinusoid:points=30000:jitter=0.3"}) {
    Target t = target_of(shape);
    const geometry::AnalyticSurface& surface = *t.target.surface;
    t.target.surface = nullptr;  // without any formula
    const trace::ProbePath path = path_of("exploration:frames=20000", t.target);
    ASSERT_TRUE(check_path_starts_free(path, surface, {})) << shape;
    std::size_t entries = 0;
    double length = 0, deepest = 0;
    geometry::Aabb visited;
    bool was_inside = false;
    for (std::size_t k = 0; k < path.size(); ++k) {
      const double d = surface.signed_distance_mm(path.hip_mm[k]);
      if (k > 0) {
        const double step = (path.hip_mm[k] - path.hip_mm[k - 1]).norm();
        ASSERT_LE(step, 0.05 * (1 + 1e-9)) << shape << ' ' << k;
        length += step;
      }
      entries += d < 0 && !was_inside;
      was_inside = d < 0;
      deepest = std::min(deepest, d);
      ASSERT_LT(d, 2.0) << shape << " strayed, frame " << k;
      visited.add(path.hip_mm[k]);
    }
    EXPECT_GT(entries, 15u) << shape;
    EXPECT_NEAR(deepest, -2.0, 0.4) << shape;
    EXPECT_GT(length / 20, 15.0) << shape << ", mean speed in mm/s";
    EXPECT_GT(visited.extent_mm().norm(), 0.3 * t.target.box_mm.extent_mm().norm()) << shape;
  }
}

TEST(Paths, ExplorationDoesNotStayAtAStrayPoint) {
  // The outermost points stand alone: from there no step would lead on.
  Target t = target_of("sinusoid:points=30000");
  t.target.surface = nullptr;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < t.model.cloud.size(); ++i) points.push_back(t.model.cloud.point_mm(i));
  const geometry::Aabb box = t.target.box_mm;
  points.push_back(box.high_mm + Vec3(3, 3, 3));
  points.push_back(box.high_mm + Vec3(-3, 3, 4));
  points.push_back(box.low_mm + Vec3(50, 50, 5));
  const cloud::Cloud stray = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  t.target.cloud = &stray;
  t.target.box_mm = stray.box_mm();
  const trace::ProbePath path = path_of("exploration:frames=20000", t.target);
  geometry::Aabb visited;
  for (const Vec3& p : path.hip_mm) visited.add(p);
  EXPECT_GT(visited.extent_mm().norm(), 0.3 * box.extent_mm().norm());
  const geometry::AnalyticSurface& surface = *t.model.surface;
  EXPECT_TRUE(check_path_starts_free(path, surface, {}));
}

TEST(Paths, ExplorationStartsOnTheMeshsOutside) {
  // A plane whose triangles face down: outside is below.
  Target t = target_of("plane:points=2500");
  t.target.surface = nullptr;
  EXPECT_GT(path_of("exploration:frames=10", t.target).hip_mm[0].z(), 0.3);
  for (auto& triangle : t.model.original_mesh->triangles) std::swap(triangle[0], triangle[1]);
  EXPECT_LT(path_of("exploration:frames=10", t.target).hip_mm[0].z(), -0.3);
}

TEST(Paths, RefusesWithAReason) {
  const Target t = target_of("sinusoid:points=100");
  const PathTarget nothing;
  const std::tuple<const char*, const PathTarget*, const char*> refused[] = {
      {"wave", &t.target, "choose from weave"},
      {"weave:speed=1", &t.target, "no option"},
      {"weave:frames=0", &t.target, "from 1 to 10000000"},
      {"weave:speed_mm_s=1e9:frames=10", &t.target, "speed"},
      {"exploration:slowest_mm_s=60", &t.target, "exchange"},
      {"weave", &nothing, "cloud"},
      {"exploration", &nothing, "cloud"},
      {"tap:from=x", &t.target, "does nothing"},  // the formula needs no side
      {"slide:speed_mm_s=1e9", &t.target, "speed_mm_s"}};
  for (const auto& [spec, target, why] : refused) EXPECT_TRUE(test::contains(refusal(spec, *target), why));
}

TEST(Paths, APathThatStartsInsideIsRefusedWithItsLine) {
  const auto sphere = geometry::make_sphere(10);
  trace::ProbePath path;
  path.name = "mine.csv";
  path.t_s = {0};
  path.hip_mm = {{0, 0, 9}};
  const Status status = check_path_starts_free(path, *sphere, {});
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().line, 2);
  EXPECT_EQ(status.error().file, "mine.csv");
  path.hip_mm = {{0, 0, 10}};
  EXPECT_TRUE(check_path_starts_free(path, *sphere, {})) << "on the surface is not inside";
}

// Strokes: how far they leave, how fast they come, on formulas and on meshes.

TEST(Strokes, LeaveByTwoMillimetresAtManySpeedsWithImpacts) {
  for (const bool by_formula : {true, false}) {
    Target m = target_of("ellipsoid:points=4000:extent_mm=80");
    if (!by_formula) m.target.surface = nullptr;
    const trace::ProbePath path = path_of("strokes:frames=60000:depth_mm=1.5:seed=3", m.target);
    ASSERT_EQ(path.size(), 60000u);
    const geometry::AnalyticSurface& surface = *m.model.surface;
    std::size_t peaks = 0, impacts = 0, slow = 0, entries = 0;
    double high = 0.0, deepest = 0.0, fastest = 0.0, before = 0.0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      const double d = surface.signed_distance_mm(path.hip_mm[i]);
      if (i == 0) {
        EXPECT_GT(d, 1.5);
        before = d;
        continue;
      }
      const double speed = (path.hip_mm[i] - path.hip_mm[i - 1]).norm() * 1000.0;
      fastest = std::max(fastest, speed);
      high = std::max(high, d);
      deepest = std::min(deepest, d);
      if (before >= 0.0 && d < 0.0) {
        ++entries;
        peaks += high > 1.9 ? 1u : 0u;
        impacts += before - d > 0.15 ? 1u : 0u;  // 200 mm/s straight in
        slow += before - d < 0.002 ? 1u : 0u;    // under 2 mm/s
        high = 0.0;
      }
      before = d;
    }
    EXPECT_GT(entries, 60u);
    EXPECT_GT(peaks, entries * 9 / 10) << by_formula;
    EXPECT_GT(impacts, entries / 10);
    EXPECT_LT(impacts, entries / 2);
    EXPECT_GT(slow, entries / 10);
    EXPECT_LT(deepest, -1.0);
    EXPECT_GT(deepest, -1.9);
    EXPECT_LE(fastest, 4.0 * 200.0 + 1e-6);
  }
}

TEST(Strokes, RefuseSpeedsTheWrongWayRound) {
  const Target m = target_of("sphere:points=500");
  for (const char* bad : {"strokes:slowest_mm_s=50:fastest_mm_s=10", "strokes:impacts=1.5",
                          "strokes:clearance_mm=0", "strokes:speed_mm_s=5"})
    EXPECT_NE(refusal(bad, m.target), "accepted") << bad;
}

}  // namespace
}  // namespace palpate::paths
