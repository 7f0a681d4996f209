// Strokes: how far they leave, how fast they come, on formulas and on meshes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "toolkit/cloud/generate.h"
#include "toolkit/trace/paths.h"

namespace palpate::trace {
namespace {

struct OnModel {
  cloud::GeneratedModel model;
  PathTarget target;
};

OnModel on(const std::string& spec, bool by_formula) {
  OnModel m{cloud::generate(parse_named_options(spec).value()).value(), {}};
  if (by_formula) m.target.surface = m.model.surface.get();
  m.target.mesh = m.model.original_mesh.get();
  m.target.box_mm = m.model.cloud.box_mm();
  m.target.spacing_mm = m.model.nominal_spacing_mm;
  return m;
}

ProbePath strokes_on(OnModel& m, const std::string& spec) {
  m.target.cloud = &m.model.cloud;
  const auto path = make_path(parse_named_options(spec).value(), m.target);
  EXPECT_TRUE(path) << (path ? "" : path.error().message());
  return path ? *path : ProbePath{};
}

TEST(Strokes, LeaveByTwoMillimetresAtManySpeedsWithImpacts) {
  for (const bool by_formula : {true, false}) {
    OnModel m = on("ellipsoid:points=4000:extent_mm=80", by_formula);
    const ProbePath path = strokes_on(m, "strokes:frames=60000:depth_mm=1.5:seed=3");
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

TEST(Strokes, AreTheSameAtEveryScaleAndOnEveryRun) {
  OnModel small = on("torus:points=3000", true), large = on("torus:points=3000:scale=1000000", true);
  const ProbePath a = strokes_on(small, "strokes:frames=3000:seed=5");
  const ProbePath again = strokes_on(small, "strokes:frames=3000:seed=5");
  EXPECT_EQ(a.hip_mm, again.hip_mm);
  const ProbePath b = strokes_on(large,
                                 "strokes:frames=3000:seed=5:depth_mm=2e6:clearance_mm=2e6:slowest_mm_s=1e5:"
                                 "fastest_mm_s=2e8");
  for (std::size_t i = 0; i < a.size(); ++i)
    ASSERT_LT((b.hip_mm[i] - 1e6 * a.hip_mm[i]).norm(), 1.0) << i;  // 1e-6 mm of the small one
  EXPECT_NE(strokes_on(small, "strokes:frames=3000:seed=6").hip_mm, a.hip_mm);
}

TEST(Strokes, RefuseSpeedsTheWrongWayRound) {
  OnModel m = on("sphere:points=500", true);
  m.target.cloud = &m.model.cloud;
  for (const char* bad : {"strokes:slowest_mm_s=50:fastest_mm_s=10", "strokes:impacts=1.5",
                          "strokes:clearance_mm=0", "strokes:speed_mm_s=5"})
    EXPECT_FALSE(make_path(parse_named_options(bad).value(), m.target)) << bad;
}

}  // namespace
}  // namespace palpate::trace
