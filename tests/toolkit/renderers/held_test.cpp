// The rule of geometry/held_place.h in the renderers that keep a place: what it sets right, and what it may
// not break.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"

namespace palpate::render {
namespace {

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
  Frame go(const Vec3& to) {
    constexpr double kStep = 0.04;
    const Vec3 from = at_;
    const int steps = static_cast<int>(std::ceil((to - from).norm() / kStep));
    Frame frame;
    for (int i = 1; i <= steps; ++i) frame = renderer_->step(from + (to - from) * (double(i) / steps), 1e-3);
    at_ = to;
    return frame;
  }
  /// At one place, for longer than a correction takes.
  Frame wait() {
    constexpr int kWait = 60;
    Frame frame;
    for (int i = 0; i < kWait; ++i) frame = renderer_->step(at_, 1e-3);
    return frame;
  }
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

INSTANTIATE_TEST_SUITE_P(Renderers, HeldPlaceOf, testing::Values("cloud", "heightfield"));

}  // namespace
}  // namespace palpate::render
