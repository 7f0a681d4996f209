// Creases stay sharp in bricks of their own, and steps of curvature along their lines.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/toolkit/smooth/smooth_scenes.h"
#include "toolkit/smooth/brick_grid.h"

namespace palpate::render {
namespace {

TEST(Brick, KeepsPieceAndJointApart) {
  Brick brick;
  constexpr std::uint16_t kLastPiece = (1u << Brick::kPieceBits) - 1u;
  for (const std::uint16_t piece : {std::uint16_t{0}, std::uint16_t{1}, kLastPiece})
    for (const Joint joint : {Joint::kLast, Joint::kRidge, Joint::kValley, Joint::kSeam}) {
      brick.set(piece, joint);
      EXPECT_EQ(brick.piece(), piece);
      EXPECT_EQ(brick.joint(), joint);
    }
}

TEST(Brick, TellsWhatIsPastALine) {
  Random random(3);
  int past = 0;
  for (int k = 0; k < 200; ++k) {
    const Vec3 across = Vec3{random.normal(), random.normal(), random.normal()}.normalized();
    const Vec3 on = Vec3{4.0 * random.uniform(), 4.0 * random.uniform(), 4.0 * random.uniform()};
    Brick brick;
    brick.set_line(across, across.dot(on));
    const Vec3 at = Vec3{4.0 * random.uniform(), 4.0 * random.uniform(), 4.0 * random.uniform()};
    const double off = across.dot(at - on);
    if (std::abs(off) < 0.001) continue;  // as exact as its 16 bits
    const Vec3f a = at.cast<float>();
    EXPECT_EQ(brick.is_past({a.x(), a.y(), a.z()}), off > 0.0) << k;
    past += off > 0.0;
  }
  EXPECT_GT(past, 50);
  EXPECT_LT(past, 150);
}

TEST(Brick, RoundsAndCutsOffDistances) {
  Brick brick;
  std::array<float, kBrickCoefficients> distance{};
  distance[0] = 1.5f;
  distance[1] = -1e9f;
  distance[2] = 1e9f;
  brick.put(distance);
  EXPECT_NEAR(kBrickUnit * static_cast<float>(brick.distance[0]), 1.5f, kBrickUnit);
  EXPECT_NEAR(kBrickUnit * static_cast<float>(brick.distance[1]), -kBrickReach, kBrickUnit);
  EXPECT_NEAR(kBrickUnit * static_cast<float>(brick.distance[2]), kBrickReach, kBrickUnit);
  EXPECT_EQ(brick.distance[3], 0);
}

/// Two faces that meet along y, each falling by `slope` from the middle: a ridge, or with a negative one a
/// valley. Points at random.
std::vector<Vec3> two_faces(double slope, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points(9000);
  for (Vec3& p : points) {
    const double x = 8.0 * random.uniform() - 4.0, y = 8.0 * random.uniform() - 4.0;
    p = Vec3{x, y, -slope * std::abs(x)};
  }
  return points;
}

// Just below the tip, behind the face that it came in by: the god object is on that face up to the ridge,
// where a rounded one would have let it slip over. Where chance leaves a face few points the ridge is round
// still.
TEST(CloudSmoothCreases, ARidgeHoldsUpToItsTip) {
  int held = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    test::Stepped renderer = prepared(cloud_of(two_faces(1.0, seed)), "cloud-smooth", 2);
    renderer->restart(Vec3(1.0, 0.0, 0.0));
    Frame frame;
    for (int k = 0; k <= 44; ++k) frame = renderer->step(Vec3(1.0 - 0.025 * k, 0.1, -0.25), 0.001);
    // Now at x = -0.1, z = -0.25, and over the face x > 0 still.
    ASSERT_TRUE(frame.contact) << seed;
    held += (frame.god_object_mm - Vec3(0.075, 0.1, -0.075)).norm() < 0.01;
    for (int k = 0; k <= 10; ++k) frame = renderer->step(Vec3(-0.1 - 0.025 * k, 0.1, -0.25), 0.001);
    // At x = -0.35 it is out, over the other face.
    EXPECT_FALSE(frame.contact) << seed;
  }
  EXPECT_GE(held, 2);
}

// Pressed into a valley the god object stands on its line, and the force is of both faces.
TEST(CloudSmoothCreases, AValleyHoldsOnItsLine) {
  test::Stepped renderer = prepared(cloud_of(two_faces(-1.0, 4)), "cloud-smooth", 2);
  renderer->restart(Vec3(0.05, 0.0, 1.0));
  Frame frame;
  for (int k = 0; k <= 80; ++k) frame = renderer->step(Vec3(0.05, 0.0, 1.0 - 0.025 * k), 0.001);
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.god_object_mm.norm(), 0.02) << frame.god_object_mm.transpose();
  EXPECT_LT((frame.force_n / frame.force_n.norm() - Vec3(-0.05, 0.0, 1.0).normalized()).norm(), 0.03);
}

}  // namespace
}  // namespace palpate::render
