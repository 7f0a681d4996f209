// Round bodies, open sheets and nested ones: ellipsoid, rounded box, bowl, shells.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

constexpr std::uint64_t kSheetSeed = 20260102;
constexpr double kScales[] = {1e-3, 1.0, 1e6};

TEST(Sheets, MakersRefuseWhatIsNoShape) {
  const double nan = std::nan("");
  EXPECT_EQ(make_ellipsoid({1, 0, 1}), nullptr);
  EXPECT_EQ(make_ellipsoid({1, 1, nan}), nullptr);
  EXPECT_EQ(make_rounded_box({10, 3, 10}, 1.6), nullptr) << "the edges meet";
  EXPECT_NE(make_rounded_box({10, 3, 10}, 1.5), nullptr);
  EXPECT_EQ(make_rounded_box({10, 3, 10}, 0), nullptr);
  EXPECT_EQ(make_bowl(1, 0.5, Felt::kInside), nullptr);
  EXPECT_EQ(make_bowl(1, 179.5, Felt::kInside), nullptr);
  EXPECT_EQ(make_bowl(nan, 90, Felt::kInside), nullptr);
  EXPECT_EQ(make_shells(1, 1), nullptr);
  EXPECT_EQ(make_shells(1, -0.1), nullptr);
}

TEST(Sheets, KnownPoints) {
  const auto ellipsoid = make_ellipsoid({4, 2, 1});
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({7, 0, 0}), 3.0);
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({0, 0, 0.25}), -0.75);
  EXPECT_DOUBLE_EQ(ellipsoid->signed_distance_mm({0, 0, 0}), -1.0);
  // Where the long way is closed in by the short one: x < a - c^2 / a, the closest is off the axis.
  EXPECT_LT(ellipsoid->closest({1, 0, 0}).point_mm.x(), 2.0);
  EXPECT_NEAR(ellipsoid->closest({1, 0, 0}).point_mm.x(), 16.0 / 15.0, 1e-14);
  EXPECT_NEAR(ellipsoid->signed_distance_mm({4 * 0.6, 2 * 0.8, 0}), 0.0, 1e-15) << "in a plane of symmetry";
  const auto ball = make_ellipsoid({3, 3, 3});
  EXPECT_DOUBLE_EQ(ball->signed_distance_mm({0, 5, 0}), 2.0);
  EXPECT_DOUBLE_EQ(ball->signed_distance_mm({0, 0, 0}), -3.0);

  const auto box = make_rounded_box({10, 6, 8}, 1);
  EXPECT_DOUBLE_EQ(box->signed_distance_mm({7, 0, 0}), 2.0);
  EXPECT_DOUBLE_EQ(box->signed_distance_mm({0, 2.5, 0}), -0.5);
  EXPECT_NEAR(box->signed_distance_mm({7, 5, 0}), 3 * std::sqrt(2.0) - 1, 1e-14);
  EXPECT_NEAR(box->signed_distance_mm({5, 3, 4}), std::sqrt(3.0) - 1, 1e-14) << "the corner is cut";
  // Equal ways: from the middle of the face over its flat 4 mm and the quarter turn to the next face's.
  EXPECT_NEAR((on_rounded_box(*box, {1, 0, 1}) - Vec3(4 + std::sqrt(0.5), 0, 3 + std::sqrt(0.5))).norm(), 0.0,
              1e-14);
  EXPECT_NEAR(half_ways_of_rounded_box({10, 6, 8}, 1).x(), 4 + std::numbers::pi / 4, 1e-14);

  const auto shells = make_shells(10, 1);
  EXPECT_DOUBLE_EQ(shells->signed_distance_mm({0, 9.75, 0}), -0.25);
  EXPECT_DOUBLE_EQ(shells->signed_distance_mm({0, 8, 0}), 1.0);
  EXPECT_EQ(shells->closest({0, 8, 0}).normal, Vec3(0, -1, 0)) << "towards the hollow";

  const auto bowl = make_bowl(10, 90, Felt::kInside);
  EXPECT_EQ(bowl->closest({0, 0, -9}).normal, Vec3(0, 0, 1));
  EXPECT_DOUBLE_EQ(bowl->signed_distance_mm({0, 0, -9}), 1.0);
  EXPECT_DOUBLE_EQ(bowl->signed_distance_mm({0, 0, -12}), 2.0) << "a sheet has no inside";
  EXPECT_NEAR(bowl->signed_distance_mm({10, 0, 3}), 3.0, 1e-14) << "to the rim";
  EXPECT_EQ(bowl->box_mm().high_mm.z(), bowl->at(0.5, 0).point_mm.z());
}

TEST(Sheets, ARoundedBoxHoldsOnTheEntryFaceAndSlidesOverItsEdge) {
  for (const double k : kScales) {
    const auto box = make_rounded_box(k * Vec3(20, 20, 4), 1 * k);
    SurfacePoint g = box->first_entry(k * Vec3(3, 4, 3), k * Vec3(3, 4, 1.9)).value();
    EXPECT_NEAR((g.point_mm - k * Vec3(3, 4, 2)).norm(), 0.0, 1e-12 * k);
    // Through the middle and out below: still the upper face.
    for (int i = 0; i < 100; ++i) g = box->track(g, k * Vec3(3, 4, 1.9 - 0.05 * i));
    EXPECT_NEAR((g.point_mm - k * Vec3(3, 4, 2)).norm(), 0.0, 1e-12 * k);
    // Onto the edge: at 45 degrees from its middle line, while the HIP is above the core.
    g = box->track(g, k * Vec3(9.25, 4, 1.25));
    EXPECT_NEAR((g.point_mm - k * Vec3(9 + std::sqrt(0.5), 4, 1 + std::sqrt(0.5))).norm(), 0.0, 1e-12 * k);
    // Deeper than the edge's middle line and beyond it: down the side.
    g = box->track(g, k * Vec3(9.5, 4, 0.5));
    EXPECT_NEAR((g.point_mm - k * Vec3(10, 4, 0.5)).norm(), 0.0, 1e-12 * k);
  }
}

TEST(Sheets, AnEllipsoidHoldsTheSheetThatWasEntered) {
  // A lens of 2 mm: pressed through to the other side.
  const auto lens = make_ellipsoid({20, 20, 1});
  SurfacePoint g = lens->first_entry({1, 2, 3}, {1, 2, 0.5}).value();
  EXPECT_GT(g.normal.z(), 0.99);
  for (int i = 0; i < 60; ++i) g = lens->track(g, {1, 2, 0.9 - 0.05 * i});
  EXPECT_GT(g.point_mm.z(), 0.9);
  EXPECT_LT(lens->closest({1, 2, -2}).point_mm.z(), 0.0);
}

TEST(Sheets, ShellsKeepTheSheetThatWasEntered) {
  for (const double k : kScales) {
    const auto shells = make_shells(10 * k, 0.5 * k);
    SurfacePoint g = shells->first_entry({11 * k, 0, 0}, {9.8 * k, 0, 0}).value();
    for (int i = 0; i < 40; ++i) g = shells->track(g, {(9.8 - 0.05 * i) * k, 0, 0});  // into the hollow
    EXPECT_NEAR(g.point_mm.x(), 10 * k, 1e-12 * k);
    EXPECT_EQ(g.normal, Vec3(1, 0, 0));
    // From the hollow outwards: the inner sheet, and a segment through the whole ball enters the outer one.
    const auto inner = shells->first_entry({0, 0, 0}, {0, 9.8 * k, 0});
    ASSERT_TRUE(inner);
    EXPECT_NEAR(inner->point_mm.y(), 9.5 * k, 1e-12 * k);
    EXPECT_EQ(inner->normal, Vec3(0, -1, 0));
    EXPECT_NEAR(shells->first_entry({0, -20 * k, 0}, {0, 20 * k, 0})->point_mm.y(), -10 * k, 1e-12 * k);
    // From within the wall: out into the hollow, and in again on the far side.
    const auto far = shells->first_entry({0, 0, 9.7 * k}, {0, 0, -20 * k});
    ASSERT_TRUE(far);
    EXPECT_NEAR(far->point_mm.z(), -9.5 * k, 1e-12 * k);
    EXPECT_FALSE(shells->first_entry({0, 0, 9.7 * k}, {0, 0, 20 * k}));
  }
}

/// What metrics/reference.cpp does after each step: whether the HIP is let go.
bool let_go(const SurfacePoint& g, const Vec3& hip) {
  return (hip - g.point_mm).dot(g.normal) >= 0.0;
}

TEST(Sheets, ABowlEndsAtItsRim) {
  for (const double k : kScales)
    for (const Felt felt : {Felt::kInside, Felt::kOutside}) {
      const double out = felt == Felt::kOutside ? 1.0 : -1.0;
      const auto bowl = make_bowl(10 * k, 60, felt);
      const auto at = [&](double deg, double radius) {
        const double angle = deg * std::numbers::pi / 180.0;
        return Vec3(radius * k * std::sin(angle), 0.0, -radius * k * std::cos(angle));
      };
      // Entered at 50 degrees and slid towards the rim 0.5 mm behind the sheet.
      const auto entry = bowl->first_entry(at(50, 10 + out), at(50, 10 - 0.5 * out));
      ASSERT_TRUE(entry);
      SurfacePoint g = *entry;
      double last = 0.0;
      for (double deg = 50; deg < 70; deg += 0.25) {
        const Vec3 hip = at(deg, 10 - 0.5 * out);
        g = bowl->track(g, hip);
        if (let_go(g, hip)) break;
        EXPECT_NEAR((g.point_mm - hip).norm(), 0.5 * k, 1e-9 * k);
        last = deg;
      }
      EXPECT_NEAR(last, 60.0, 0.26) << "neither before the rim nor after it";
      // Beyond the rim there is nothing, and from behind nothing is felt.
      EXPECT_FALSE(bowl->first_entry(at(61, 10 + out), at(61, 10 - out)));
      EXPECT_TRUE(bowl->first_entry(at(59, 10 + out), at(59, 10 - out)));
      EXPECT_FALSE(bowl->first_entry(at(30, 10 - out), at(30, 10 + out)));
      const Vec3 on = at(20, 10);
      const SurfacePoint s = bowl->closest(on);
      EXPECT_TRUE(bowl->first_entry(s.point_mm, s.point_mm - 0.01 * k * s.normal));
      EXPECT_FALSE(bowl->first_entry(s.point_mm, s.point_mm + 0.01 * k * s.normal));
      EXPECT_FALSE(bowl->first_entry(s.point_mm - 0.01 * k * s.normal, s.point_mm - 0.02 * k * s.normal));
    }
  // The mouth: felt from outside, in through the hole, and nothing there.
  const auto mouth = make_bowl(10, 150, Felt::kOutside);
  EXPECT_TRUE(mouth->first_entry({11, 0, 0}, {9, 0, 0}));
  EXPECT_FALSE(mouth->first_entry({0, 0, 12}, {0, 0, 0}));
  EXPECT_FALSE(mouth->first_entry({0, 0, 0}, {-12, 0, 0})) << "the wall from within";
  EXPECT_TRUE(let_go(mouth->track({{10, 0, 0}, {1, 0, 0}}, {0.5, 0, 9}), {0.5, 0, 9}));
}

TEST(Sheets, PlacesOfParametersLieOnTheSurfaceWithTheirNormals) {
  Random random(kSheetSeed);
  for (const double k : kScales)
    for (const auto& surface :
         {make_ellipsoid(k * Vec3(30, 18, 22)), make_rounded_box(k * Vec3(40, 20, 30), 2 * k),
          make_bowl(25 * k, 110, Felt::kInside), make_bowl(25 * k, 150, Felt::kOutside),
          make_shells(25 * k, 0.6 * k)})
      for (int n = 0; n < 200; ++n) {
        const SurfacePoint s = surface->at(random.uniform(), random.uniform());
        ASSERT_NEAR(surface->signed_distance_mm(s.point_mm), 0.0, 1e-13 * k * 100) << surface->formula();
        ASSERT_NEAR((surface->closest(s.point_mm + 0.01 * k * s.normal).point_mm - s.point_mm).norm(), 0.0,
                    1e-10 * k)
            << surface->formula();
        ASSERT_TRUE(surface->box_mm().grown(1e-12 * k).contains(s.point_mm)) << surface->formula();
      }
}

}  // namespace
}  // namespace palpate::geometry
