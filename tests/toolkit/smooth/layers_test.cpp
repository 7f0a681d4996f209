// The layers of a sheet in one brick: what they come to, and the step to the nearest free place.
#include "toolkit/smooth/layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "toolkit/core/random.h"

namespace palpate::render {
namespace {

/// Flat: distance n . x - c, in voxels from the corner of the brick's cells.
struct Flat {
  Vec3 n;
  double c;
  [[nodiscard]] double at(const Vec3& x) const { return n.dot(x) - c; }
};
/// Coefficients of a spline that is linear are its values; they are rounded to half of kBrickUnit.
constexpr double kRounded = 1e-3;

Brick brick_of(const Flat& flat, Joint joint) {
  Brick brick;
  for (int i = 0; i < kBrickCoefficients; ++i) {
    const Vec3 node(i / 49 - 1, i / 7 % 7 - 1, i % 7 - 1);
    const double units = flat.at(node) / static_cast<double>(kBrickUnit);
    brick.distance[static_cast<std::size_t>(i)] =
        static_cast<std::int16_t>(std::lround(std::clamp(units, -32767.0, 32767.0)));
  }
  brick.set(0, joint);
  return brick;
}
BrickPlace place_of(const Vec3& x) {
  BrickPlace at;
  for (std::size_t a = 0; a < 3; ++a) {
    const double one = x[static_cast<Eigen::Index>(a)];
    at.cell[a] = std::clamp(static_cast<int>(one), 0, kBrickCells - 1);
    at.t[a] = static_cast<float>(one - at.cell[a]);
  }
  return at;
}
Vec3 any_place(Random& random) {
  return {random.uniform(1.0, 3.0), random.uniform(1.0, 3.0), random.uniform(1.0, 3.0)};
}
Vec3 any_normal(Random& random) {
  return Vec3{random.normal(), random.normal(), random.normal()}.normalized();
}

TEST(Layers, ComeToTheLeastBodyOfTheGreatestFaces) {
  Random random(71);
  for (int round = 0; round < 200; ++round) {
    // Two faces of one body, and two of another.
    std::array<Flat, 4> flats;
    std::vector<Brick> bricks;
    const Vec3 middle = any_place(random);
    for (std::size_t k = 0; k < flats.size(); ++k) {
      const Vec3 n = any_normal(random);
      flats[k] = {n, n.dot(middle) + random.uniform(-0.3, 0.3)};
      bricks.push_back(brick_of(flats[k], k == 1 ? Joint::kValley : k == 3 ? Joint::kLast : Joint::kRidge));
    }
    ASSERT_EQ(layers_from(bricks.data()), 4u);
    const Vec3 x = any_place(random);
    const double truth =
        std::min(std::max(flats[0].at(x), flats[1].at(x)), std::max(flats[2].at(x), flats[3].at(x)));
    EXPECT_NEAR(static_cast<double>(layers_value(bricks.data(), place_of(x))), truth, kRounded);
    const Jet jet = layers_jet(bricks.data(), place_of(x));
    EXPECT_NEAR(static_cast<double>(jet.value), truth, kRounded);
    double least = 1.0;
    for (const Flat& f : flats)
      if (std::abs(f.at(x) - truth) < kRounded)
        least = std::min(least, (jet.gradient.cast<double>() - f.n).norm());
    EXPECT_LT(least, 10 * kRounded);
  }
}

/// The place of all half spaces n . x >= c nearest to h, by Dykstra's alternating projections.
Vec3 nearest_free(const std::vector<Flat>& walls, const Vec3& h) {
  Vec3 x = h;
  std::vector<Vec3> left(walls.size(), Vec3::Zero());
  for (int round = 0; round < 2000; ++round)
    for (std::size_t k = 0; k < walls.size(); ++k) {
      const Vec3 from = x + left[k];
      x = from + walls[k].n * std::max(-walls[k].at(from), 0.0);
      left[k] = from - x;
    }
  return x;
}

// Valleys as seen from the free side: bodies beside each other above, or faces of one body below.
TEST(Layers, AStepIsToTheNearestPlaceThatAllLeaveFree) {
  Random random(72);
  int compared = 0, held_by_several = 0;
  for (int round = 0; round < 400; ++round) {
    const double side = round % 2 == 0 ? 1.0 : -1.0;
    const std::size_t count = 2 + random.below(2);
    const Vec3 corner(2.0, 2.0, 2.0);
    std::vector<Flat> walls;
    std::vector<Brick> bricks;
    for (std::size_t k = 0; k < count; ++k) {
      Vec3 n;
      do {
        n = any_normal(random);
      } while (
          std::any_of(walls.begin(), walls.end(), [&](const Flat& w) { return std::abs(w.n.dot(n)) > 0.8; }));
      walls.push_back({n, n.dot(corner)});
      const Flat flat{n * side, n.dot(corner) * side};
      bricks.push_back(brick_of(flat, k + 1 == count ? Joint::kLast
                                      : side > 0.0   ? Joint::kValley
                                                     : Joint::kRidge));
    }
    const Vec3 at = corner + 0.3 * Vec3{random.normal(), random.normal(), random.normal()};
    const Vec3 h = corner + 0.5 * Vec3{random.normal(), random.normal(), random.normal()};
    int behind = 0;
    for (const Flat& w : walls) behind += w.at(h) < 0.0 ? 1 : 0;
    if (behind == 0) continue;  // not held
    const Vec3 truth = nearest_free(walls, h);
    // Between walls that leave little more than a point the projections come near it slowly.
    if (std::any_of(walls.begin(), walls.end(), [&](const Flat& w) { return w.at(truth) < -1e-5; })) continue;
    ++compared;
    const NewtonStep step = layers_step(bricks.data(), place_of(at), h - at, side, 100.0);
    const Vec3 x = at + step.along + step.normal * step.lift;
    EXPECT_LT((x - truth).norm(), 20 * kRounded) << round;
    // The normal is that of the force, growing with the distance.
    EXPECT_LT(((x - h).normalized() * side - step.normal).norm(), 0.05) << round;
    int on = 0;
    for (const Flat& w : walls) on += std::abs(w.at(x)) < kRounded ? 1 : 0;
    held_by_several += on > 1 ? 1 : 0;
  }
  EXPECT_GT(compared, 200);
  EXPECT_GT(held_by_several, 50);
}

// A ridge is one face at a time.
TEST(Layers, OverARidgeAStepIsAlongTheFaceThatCounts) {
  const Flat left{Vec3(-1.0, 0.0, 1.0).normalized(), 0.0}, right{Vec3(1.0, 0.0, 1.0).normalized(), 2.8284271};
  const std::array<Brick, 2> bricks{brick_of(left, Joint::kRidge), brick_of(right, Joint::kLast)};
  // The tip is at x = 2, z = 2; from the left of it.
  const Vec3 at(1.5, 2.0, 1.5), h(1.9, 2.0, 1.6);
  ASSERT_NEAR(left.at(at), 0.0, 1e-9);
  const NewtonStep step = layers_step(bricks.data(), place_of(at), h - at, 1.0, 100.0);
  const Vec3 x = at + step.along + step.normal * step.lift;
  EXPECT_LT((x - (h - left.n * left.at(h))).norm(), 20 * kRounded);
}

}  // namespace
}  // namespace palpate::render
