// `cloud-literal` against the thesis's figures, written down once more the obvious slow way.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <palpate/registry.h>
#include <palpate/replay.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/shading.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::render {
namespace {

constexpr double kLiteralStiffness = 0.5;  // N/mm, a model's own

/// Figures 36 and 42 and section 3.5.2 over all points of one model without a pose, unshaded.
class Printed {
 public:
  Printed(const SceneInput& scene, double box_mm, double cell_mm)
      : cloud_(*scene.models[0].cloud),
        table_(search::build_neighbours("modified-knn:complete=false", cloud_, 1).value().table),
        half_(0.5 * box_mm),
        cell_(cell_mm),
        friction_(scene.models[0].surface.friction.static_coefficient) {
    low_ = search::local_box(cloud_, 1).low_mm;
  }

  Frame step(const Vec3& hip) {
    const Vec3 h = hip - cloud_.origin_mm, before = std::exchange(last_, h);
    std::uint32_t from = god_;
    bool collided = was_collision_;
    if (was_collision_) {
      collided = !crosses(before, h) || crosses(h, at(god_) + radius() * direction_);
    } else if (const auto crossed = crossed_by(before, h); !crossed.empty()) {
      collided = true;
      from = crossed.front();
      for (const std::uint32_t i : crossed)
        if ((at(i) - before).norm() < (at(from) - before).norm()) from = i;
    }
    Frame frame;
    frame.god_object_mm = hip;
    frame.contact = collided;
    if (collided) {
      const std::uint32_t free = nearest_along(from, h, [](std::uint32_t) { return true; });
      const std::uint32_t rolled = friction_ > 0.0 && was_collision_ ? rolled_back(free, h) : free;
      rolls_ += rolled != free;
      god_ = rolled;
      direction_ = (at(god_) - h).normalized();
      frame.god_object_mm = at(god_) + cloud_.origin_mm;
      frame.force_n = kLiteralStiffness * (at(god_) - h);
    }
    was_collision_ = collided;
    return frame;
  }
  void start(const Vec3& hip) { last_ = hip - cloud_.origin_mm; }
  [[nodiscard]] std::size_t rolls() const { return rolls_; }

 private:
  [[nodiscard]] Vec3 at(std::size_t i) const { return cloud_.local_mm(i); }
  [[nodiscard]] double radius() const { return std::sqrt(3.0) * half_ * (1.0 + 1e-3); }
  [[nodiscard]] Vec3 cell_of(const Vec3& p) const { return ((p - low_) / cell_).array().floor(); }

  /// Section 3.1.3: the cells of the starting points of pieces at most a cell long, and of the end; the boxes
  /// of their points.
  [[nodiscard]] std::vector<std::uint32_t> crossed_by(const Vec3& a, const Vec3& b) const {
    const double pieces = std::max(1.0, std::ceil((b - a).norm() / cell_));
    std::vector<Vec3> cells = {cell_of(b)};
    for (double i = 0; i < pieces; ++i) cells.push_back(cell_of(a + (i / pieces) * (b - a)));
    std::vector<std::uint32_t> crossed;
    for (std::uint32_t i = 0; i < cloud_.size(); ++i)
      if (std::find(cells.begin(), cells.end(), cell_of(at(i))) != cells.end() && in_box(a, b, at(i)))
        crossed.push_back(i);
    return crossed;
  }
  [[nodiscard]] bool crosses(const Vec3& a, const Vec3& b) const { return !crossed_by(a, b).empty(); }
  [[nodiscard]] bool in_box(const Vec3& a, const Vec3& b, const Vec3& centre) const {
    double t0 = 0.0, t1 = 1.0;
    for (int axis = 0; axis < 3; ++axis) {
      const double d = b[axis] - a[axis];
      double s = (centre[axis] - half_ - a[axis]) / d, e = (centre[axis] + half_ - a[axis]) / d;
      if (s > e) std::swap(s, e);
      t0 = std::max(t0, s);
      t1 = std::min(t1, e);
    }
    return t0 <= t1;
  }
  /// Downhill in the distance to `aim` from neighbour to neighbour, as long as `may` allows the next.
  template <class May>
  [[nodiscard]] std::uint32_t nearest_along(std::uint32_t i, const Vec3& aim, May&& may) const {
    while (true) {
      std::uint32_t best = i;
      for (const std::uint32_t other : table_.of[i])
        if ((at(other) - aim).norm() < (at(best) - aim).norm()) best = other;
      if (best == i || !may(best)) return i;
      i = best;
    }
  }
  /// Towards the god object of the frame before, no further than the coefficient times the depth.
  [[nodiscard]] std::uint32_t rolled_back(std::uint32_t free, const Vec3& h) const {
    const double most = friction_ * (at(free) - h).norm();
    return nearest_along(free, at(god_), [&](std::uint32_t i) { return (at(i) - at(free)).norm() <= most; });
  }

  const cloud::Cloud& cloud_;
  search::NeighbourTable table_;
  double half_, cell_, friction_;
  Vec3 low_ = Vec3::Zero(), last_ = Vec3::Zero(), direction_ = Vec3::UnitZ();
  std::uint32_t god_ = 0;
  bool was_collision_ = false;
  std::size_t rolls_ = 0;
};

TEST(CloudLiteral, FollowsTheFiguresToTheLetter) {
  for (const char* spec : {"sinusoid:points=2601:extent_mm=40:wavelength_mm=20:amplitude_mm=3:jitter=0.3",
                           "wedge:points=2601:extent_mm=40:jitter=0.3"})
    for (const double friction : {0.0, 0.8})
      for (const char* path_spec : {"weave:frames=4000:depth_mm=1.5:speed_mm_s=60",
                                    "weave:frames=1500:depth_mm=2.5:period_frames=90:speed_mm_s=900"}) {
        SCOPED_TRACE(testing::Message() << spec << ", friction " << friction << ", " << path_spec);
        Scene scene = generated(spec);
        scene.input.models[0].surface.friction = {friction, friction};
        ASSERT_EQ(scene.input.models[0].surface.stiffness_n_per_mm, kLiteralStiffness);
        // Small cells and boxes, so that segments span several and gaps are met.
        const auto renderer = prepared(
            scene.input,
            "cloud-literal:shading=none:neighbours=modified-knn:box_mm=0.7:resolution_mm=0.5:cell=2");
        Printed printed(scene.input, 0.7, 1.0);
        const trace::ProbePath path = path_over(scene, path_spec);
        renderer->restart(path.hip_mm[0]);
        printed.start(path.hip_mm[0]);
        std::size_t contacts = 0;
        for (std::size_t i = 0; i < path.size(); ++i) {
          const Frame a = renderer->step(path.hip_mm[i], 1e-3), b = printed.step(path.hip_mm[i]);
          ASSERT_EQ(a.contact, b.contact) << i;
          // The same point, but for the rounding of the way to the world and back.
          ASSERT_LT((a.god_object_mm - b.god_object_mm).norm(), 1e-12) << i;
          ASSERT_LT((a.force_n - b.force_n).norm(), 1e-12) << i;
          contacts += a.contact;
        }
        EXPECT_GT(contacts, path.size() / 4);
        EXPECT_LT(contacts, path.size());
        EXPECT_EQ(printed.rolls() > 0, friction > 0.0);
      }
}

// Section 3.2.2.5 returns what the shrinking block holds: with the option, eight.
TEST(CloudLiteral, TakesTheNeighboursThatThePrintedSearchFinds) {
  const Scene scene = generated("sinusoid:points=2601:jitter=0.4");
  const trace::ProbePath path = path_over(scene, "weave:frames=3000");
  const auto hash = [&](const std::string& options) {
    const auto renderer = prepared(scene.input, "cloud-literal:neighbours=modified-knn" + options);
    return trace_hash(trace::replay(*renderer, path).value());
  };
  EXPECT_EQ(hash(""), hash(":complete=false"));
  EXPECT_NE(hash(""), hash(":complete=true"));

  for (const auto& [complete, fewer] : {std::pair("false", true), std::pair("true", false)}) {
    const auto notes =
        prepare_report(scene.input, std::string("cloud-literal:neighbours=modified-knn:complete=") + complete)
            ->notes;
    EXPECT_EQ(std::any_of(notes.begin(), notes.end(),
                          [](const std::string& note) -> bool {
                            return test::contains(note, "have fewer than eight neighbours");
                          }),
              fewer)
        << complete;
  }
}

// Cells of 5 mm. The way goes from the cell (0, 0) through a corner of (0, 1) into (1, 1), 5.5 mm: two
// pieces, none of which starts in (0, 1), where the only point on the way lies.
TEST(CloudLiteral, SampledCellsMissAClippedCellThatCrossedCellsFind) {
  std::vector<Vec3> points = {{4.4, 5.05, 0}};
  for (const double x : {0.0, 20.0})
    for (const double y : {0.0, 20.0}) points.emplace_back(x, y, 0);
  const SceneInput scene = cloud_of(points);
  const Vec3 from(3.0, 4.9, 0.0), to(8.5, 5.6, 0.0);
  for (const auto& [cells, found] : {std::pair("sampled", false), std::pair("crossed", true)}) {
    SCOPED_TRACE(cells);
    const auto renderer = prepared(
        scene,
        std::string("cloud-literal:neighbours=exact-knn:shading=none:box_mm=0.4:resolution_mm=1:cells=") +
            cells);
    renderer->restart(from);
    EXPECT_EQ(renderer->step(to, 1e-3).contact, found);
  }
}

// Whatever the distance: bounded by the grid.
TEST(CloudLiteral, AHipFromFarAwayCostsNoMoreThanTheGrid) {
  const Scene scene = generated("plane:extent_mm=20:spacing_mm=0.5");
  const auto renderer = prepared(scene.input, "cloud-literal");
  for (const double far : {1e3, 1e9, 1e17, 1e200, 1e308}) {
    SCOPED_TRACE(far);
    renderer->restart(Vec3(0.1, 0.2, far));
    const std::uint64_t before = renderer->counters().cells_visited;
    (void)renderer->step(Vec3(0.3, 0.1, -far), 1e-3);
    (void)renderer->step(Vec3(far, 0.1, 0.2), 1e-3);
    EXPECT_LT(renderer->counters().cells_visited - before, 1000u);
  }
}

// What a swept sphere gains: boxes that the cells hide. What it pays: it touches a radius earlier.
TEST(CloudLiteral, ASweptSphereTouchesEarlier) {
  const Scene scene = generated("sinusoid:points=10000");
  const trace::ProbePath path = path_over(scene, "weave:frames=4000:clearance_mm=4");
  const auto contacts = [&](const test::Stepped& renderer) {
    const trace::ForceTrace trace = trace::replay(*renderer, path).value();
    return std::count_if(trace.frames.begin(), trace.frames.end(), [](const Frame& f) { return f.contact; });
  };
  const auto box = prepared(scene.input, "cloud-literal"),
             swept = prepared(scene.input, "cloud-literal:test=swept-sphere:sphere_mm=0.3");
  EXPECT_GT(contacts(swept), contacts(box));
  EXPECT_GT(swept->counters().sphere_only, 0u);
}

// The rule of geometry/god_object_check.h in renderers that keep a place: what it sets right, may not break.

constexpr double kSpacing = 0.25;

/// Over [-10, 10] x [-4, 4] a floor at 0 and along y a wall, 4 mm high and two spacings thick, four at its
/// foot: posts, or points on all of its faces.
SceneInput wall_on_floor(bool posts) {
  constexpr int kRows = 16, kColumns = 40, kHeight = 16;
  std::vector<Vec3> points;
  for (int row = -kRows; row <= kRows; ++row) {
    for (int column = -kColumns; column <= kColumns; ++column)
      points.push_back(kSpacing * Vec3(column, row, std::abs(column) < 2 ? kHeight : 0));
    for (int level = 1; level < kHeight && !posts; ++level)
      for (const int side : {-1, 1}) points.push_back(kSpacing * Vec3(side, row, level));
  }
  return cloud_of(points);
}
class HeldPlaceOf : public testing::TestWithParam<const char*> {
 protected:
  static bool posts() { return GetParam() == std::string("heightfield"); }
  void start(const Vec3& at) {
    renderer_ = prepared(wall_on_floor(posts()), GetParam());
    renderer_->restart(at);
    at_ = at;
  }
  /// At 40 mm/s, an eighth of a spacing in the frames between two looks.
  Frame go(const Vec3& to) { return move(renderer_, at_, to, 0.04); }
  /// At one place, for longer than a correction takes.
  Frame wait() { return glide(renderer_, at_, at_, 60); }
  test::Stepped renderer_;
  Vec3 at_ = Vec3::Zero();
};

// Below the floor and past a spur, which is in the way of the god object but not of the HIP.
TEST_P(HeldPlaceOf, AHipThatPassedBehindASpurIsHeldWhereItIs) {
  start({-3, 0.1, 1});
  ASSERT_TRUE(go({-3, 0.1, -0.3}).contact);
  const Frame before = go({-0.4, 0.1, -0.3});
  ASSERT_TRUE(before.contact);
  EXPECT_LT(before.god_object_mm.x(), 0.0);
  go({3, 0.1, -0.3});
  const Frame after = wait();
  ASSERT_TRUE(after.contact);
  EXPECT_LT((after.god_object_mm - Vec3(3, 0.1, 0)).norm(), 1e-3);
  EXPECT_FALSE(go({3, 0.1, 0.3}).contact);
}

// The HIP is through the wall and above the floor behind it: held, however long it stays. A height field is
// looked at straight below the HIP, so its flank counts only where the floor is farther than half the pull.
TEST_P(HeldPlaceOf, AThinWallOnAFloorHolds) {
  const double z = posts() ? 1.0 : 0.3;
  start({-3, 0.1, z});
  ASSERT_TRUE(go({0.8, 0.1, z}).contact);
  const Frame frame = wait();
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.god_object_mm.x(), 0.0);
  EXPECT_LT(frame.force_n.x(), 0.0);
}

/// A point of the unit sphere, the k-th of n, spread evenly.
Vec3 on_sphere(int k, int n) {
  const double z = 1.0 - (2.0 * k + 1.0) / n, turn = k * M_PI * (3.0 - std::sqrt(5.0)),
               r = std::sqrt(1.0 - z * z);
  return {r * std::cos(turn), r * std::sin(turn), z};
}

class HollowBallOf : public testing::TestWithParam<const char*> {};

// Pressed from outside through its wall into the hollow and along there, the outer sheet of a ball holds.
TEST_P(HollowBallOf, HoldsThroughItsWall) {
  constexpr int kPoints = 6000;
  constexpr double kOuter = 10.0, kGap = 1.4;  // three spacings
  std::vector<Vec3> points;
  for (const double radius : {kOuter, kOuter - kGap})
    for (int k = 0; k < kPoints; ++k) points.push_back(radius * on_sphere(k, kPoints));
  const test::Stepped renderer = prepared(cloud_of(points), GetParam());
  constexpr int kFrames = 4000;
  int lost = 0;
  double lowest = kOuter;
  for (int k = 0; k < kFrames; ++k) {
    // In and out of the ball six times, to almost three times its wall.
    const double share = static_cast<double>(k) / kFrames;
    const double depth = 3.9 * std::sin(6.0 * M_PI * share) * std::sin(6.0 * M_PI * share) - 0.2;
    const double turn = 4.0 * share;
    const Vec3 way(std::cos(turn), std::sin(turn) * std::cos(2.0 * turn),
                   std::sin(turn) * std::sin(2.0 * turn));
    const Vec3 hip = (kOuter - depth) * way;
    if (k == 0) renderer->restart(hip);
    const Frame frame = renderer->step(hip, 1e-3);
    if (depth < 0.1) continue;
    lost += frame.contact ? 0 : 1;
    if (frame.contact) lowest = std::min(lowest, frame.god_object_mm.norm());
  }
  EXPECT_EQ(lost, 0);
  EXPECT_GT(lowest, kOuter - 0.1);
}

INSTANTIATE_TEST_SUITE_P(Renderers, HollowBallOf, testing::Values("cloud", "cloud-smooth"));
INSTANTIATE_TEST_SUITE_P(Renderers, HeldPlaceOf, testing::Values("cloud", "heightfield"));

const Vec3 kA(0, 0, 0), kB(1, 0, 0), kC(0, 1, 0);

TEST(Shading, ProjectedAreasAreExactInsideAFlatFacet) {
  const Vec3 v = shaded_vector(Shading::kAreaProjected, Vec3(0.3, 0.2, -2.0), kA, kB, kC);
  EXPECT_NEAR((v - Vec3(0, 0, 2)).norm(), 0.0, 1e-15);
  // Outside the facet unsigned areas pull sideways; signed ones do not.
  EXPECT_GT(
      (shaded_vector(Shading::kAreaProjected, Vec3(-0.3, -0.2, -2.0), kA, kB, kC) - Vec3(0, 0, 2)).norm(),
      0.1);
  EXPECT_NEAR((shaded_vector(Shading::kFacet, Vec3(-0.3, -0.2, -2.0), kA, kB, kC) - Vec3(0, 0, 2)).norm(),
              0.0, 1e-15);
}

TEST(Shading, RawAreasByHand) {
  // h below the corner a: |fb x fc| for h = (0,0,-1) is |(1,1,1)| ... worked by hand: sqrt 3, 1, 1.
  const Vec3 v = shaded_vector(Shading::kAreaRaw, Vec3(0, 0, -1), kA, kB, kC);
  const double sum = std::sqrt(3.0) + 2.0;
  EXPECT_NEAR((v - Vec3(1.0 / sum, 1.0 / sum, 1.0)).norm(), 0.0, 1e-15);
}

TEST(Shading, PrintedLengthsDoubleTheForceAndNormalisedOnesDoNot) {
  // Far below a small facet all three lengths are nearly equal, so the weights' sum shows.
  const Vec3 h(0.3, 0.3, -1000.0);
  EXPECT_NEAR(shaded_vector(Shading::kLengthPrinted, h, kA, kB, kC).norm(), 2000.0, 0.01);
  EXPECT_NEAR(shaded_vector(Shading::kLengthNormalised, h, kA, kB, kC).norm(), 1000.0, 0.01);
}

TEST(Shading, SliversFallBackAtEveryScale) {
  for (const double s : {1e-3, 1.0, 1e6}) {
    const Vec3 h(0.2 * s, 0.0, -s);
    for (const Shading kind : {Shading::kAreaRaw, Shading::kAreaProjected, Shading::kFacet})
      EXPECT_EQ(shaded_vector(kind, h, kA, s * kB, s * Vec3(2, 1e-3, 0)), kA - h);
  }
}

TEST(Normals, CodeIsWithinItsBound) {
  Random random(3);
  for (int i = 0; i < 20000; ++i) {
    Vec3 n(random.normal(), random.normal(), random.normal());
    n.normalize();
    EXPECT_LT(surface::decode_normal(surface::encode_normal(n)).cross(n).norm(), 1e-4);
  }
  for (const Vec3& axis : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1), Vec3(0, 0, -1)})
    EXPECT_EQ(surface::decode_normal(surface::encode_normal(axis)), axis);
}

}  // namespace
}  // namespace palpate::render
