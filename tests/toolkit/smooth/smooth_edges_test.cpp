// `cloud-smooth` under a hand that goes over sharp edges: in contact wherever it is behind a face, free
// wherever it is not, and never held by more than it is pressed.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/toolkit/smooth/smooth_scenes.h"

namespace palpate::render {
namespace {

constexpr double kHalf = 8.0;  // mm, of a cube
constexpr std::size_t kPoints = 15000;
const double kSpacing = std::sqrt(6.0 * 4.0 * kHalf * kHalf / static_cast<double>(kPoints));
/// As deep as a hand presses into points of such a spacing: what is near there is known.
constexpr double kDeepest = 0.3;
/// Of the bounds below: a hand feels a wrong force after 20 ms.
constexpr int kFelt = 20;

std::vector<Vec3> cube_points(double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points(kPoints);
  for (Vec3& p : points) {
    const auto axis = static_cast<Eigen::Index>(random.below(3));
    for (Eigen::Index a = 0; a < 3; ++a) p[a] = kHalf * random.uniform(-1.0, 1.0);
    p[axis] = (random.uniform() < 0.5 ? -kHalf : kHalf) + noise * kSpacing * random.normal();
  }
  return points;
}

/// Below the cube's surface, mm; less than 0 outside.
double depth_of(const Vec3& h) {
  return kHalf - h.cwiseAbs().maxCoeff();
}

/// Round and round a cube in slanted planes, in and out: over each edge at many angles and depths.
std::vector<Vec3> around_path(int frames) {
  std::vector<Vec3> path;
  for (int i = 0; i < frames; ++i) {
    const double t = 1e-3 * i, turn = 1.7 * t, tilt = 0.31 * t;
    Vec3 way(std::cos(turn), std::sin(turn) * std::cos(tilt), std::sin(turn) * std::sin(tilt));
    way = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized()) * way;
    const double depth = kDeepest * (0.3 + 0.7 * std::sin(5.3 * t));
    path.push_back(way * ((kHalf - depth) / way.cwiseAbs().maxCoeff()));
  }
  return path;
}

class OverEdges : public ::testing::TestWithParam<double> {};

TEST_P(OverEdges, AHandIsNeitherLostNorCaught) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    const test::Stepped renderer = prepared(cloud_of(cube_points(GetParam(), seed)), "cloud-smooth", 2);
    const std::vector<Vec3> path = around_path(20000);
    renderer->restart(path.front() * 2.0);
    int lost = 0, caught = 0, longest_lost = 0, longest_caught = 0;
    double most = 0.0;
    for (const Vec3& h : path) {
      const Frame frame = renderer->step(h, 1e-3);
      const double depth = depth_of(h);
      lost = !frame.contact && depth > 0.4 * kSpacing ? lost + 1 : 0;
      caught = frame.contact && depth < -0.4 * kSpacing ? caught + 1 : 0;
      longest_lost = std::max(longest_lost, lost);
      longest_caught = std::max(longest_caught, caught);
      most = std::max(most, frame.force_n.norm());
    }
    EXPECT_LE(longest_lost, kFelt) << seed;
    EXPECT_LE(longest_caught, kFelt) << seed;
    // Over an edge the god object may be held on the face that the hand came by, until the other face is less
    // than half as far: and that is no deeper than the hand is, and some frames.
    EXPECT_LT(most, 0.5 * 3.0 * kDeepest) << seed;
  }
}
INSTANTIATE_TEST_SUITE_P(Noise, OverEdges, ::testing::Values(0.0, 0.15));

}  // namespace
}  // namespace palpate::render
