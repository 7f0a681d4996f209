// Creases as `cloud-vertices` and `cloud` feel them: grooves, corners of three planes and ridges, against the
// surface they were taken from.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include <palpate/geometry.h>
#include "tests/baselines/vertices_scenes.h"
#include "toolkit/core/tolerances.h"

namespace palpate::baselines::vertices {
namespace {

constexpr double kStiffness = 0.5;  // N/mm, every scene's here
constexpr double kScales[] = {1e-3, 1.0, 1e6};
/// Coordinates are floats, of a scene 30 units wide; some facets' planes magnify that by depth over spacing.
constexpr double kStored = 30.0 * 16.0 * kUnitRoundoffFloat;

std::string wedge(double angle_deg, double scale) {
  return "wedge:angle_deg=" + std::to_string(angle_deg) +
         ":extent_mm=12:spacing_mm=0.2:scale=" + std::to_string(scale);
}

std::vector<Vec3> straight(const std::vector<Vec3>& corners, double step, double scale) {
  std::vector<Vec3> path;
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const Vec3 way = corners[c + 1] - corners[c];
    const int steps = static_cast<int>(std::ceil(way.norm() / step));
    for (int i = 0; i < steps; ++i) path.emplace_back(scale * (corners[c] + way * i / steps));
  }
  path.emplace_back(scale * corners.back());
  return path;
}

/// Along a flank of the wedge z = rise |x| at a depth along the normal, over the edge or the bottom, and
/// along the other.
std::vector<Vec3> across(double rise, double depth, double scale, double step = 0.02) {
  const double below = depth * std::sqrt(1.0 + rise * rise);
  return straight({{-4.0, 0.13, 4.0 * rise + 1.0},
                   {-3.0, 0.23, 3.0 * rise - below},
                   {0.0, 0.53, -below},
                   {3.0, 0.83, 3.0 * rise - below},
                   {4.0, 0.93, 4.0 * rise + 1.0}},
                  step, scale);
}

std::vector<Frame> run(const test::Stepped& renderer, const std::vector<Vec3>& path) {
  std::vector<Frame> frames;
  renderer->restart(path.front());
  for (const Vec3& h : path) frames.push_back(renderer->step(h, 1e-3));
  return frames;
}

std::vector<Frame> run(const Scene& scene, const std::string& spec, const std::vector<Vec3>& path) {
  return run(ready(scene.input, spec), path);
}

/// The largest change of force from frame to frame, over the stiffness and the way of the HIP.
double steepest(const std::vector<Frame>& frames, const std::vector<Vec3>& path) {
  double worst = 0.0;
  for (std::size_t i = 1; i < frames.size(); ++i)
    if (frames[i].contact && frames[i - 1].contact)
      worst = std::max(worst, (frames[i].force_n - frames[i - 1].force_n).norm() /
                                  (kStiffness * (path[i] - path[i - 1]).norm()));
  return worst;
}

TEST(Crease, GrooveHoldsByBothFlanks) {
  const double rise = 1.0 / std::sqrt(3.0);  // 120 degrees open
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const Scene scene = generated(wedge(240, s));
    for (const double depth : {0.3, 1.0, 2.0}) {
      const std::vector<Vec3> path = across(rise, depth, s);
      const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                               truth = run(scene, "analytic", path);
      std::size_t held = 0;
      for (std::size_t i = 0; i < path.size(); ++i) {
        if (!truth[i].contact || -path[i].z() + rise * std::abs(path[i].x()) < 0.2 * s) continue;
        ASSERT_TRUE(frames[i].contact) << i;
        ASSERT_LE((frames[i].force_n - truth[i].force_n).norm(), kStored * kStiffness * s)
            << i << " " << depth;
        held += truth[i].god_object_mm.x() == 0.0;
      }
      EXPECT_GT(held, 10u);
      // The free space is convex: its nearest place moves no faster than the HIP, nor does the force.
      EXPECT_LE(steepest(frames, path), 1.0 + 1e-3) << depth;
    }
  }
}

TEST(Crease, GrooveBetweenThePointsIsOffByNoMoreThanItsFacets) {
  // A column of points on either side of the bottom, half a spacing from it, jittered ones up to 0.7: the
  // facets between them bridge it, and no place of theirs is farther from it than these points.
  const double rise = 1.0 / std::sqrt(3.0), slant = std::sqrt(1.0 + rise * rise);
  for (const auto& [more, bridge] : {std::pair{"", 0.5 * slant}, std::pair{":jitter=0.2", 0.7 * slant}}) {
    SCOPED_TRACE(more);
    const Scene scene = generated("wedge:angle_deg=240:extent_mm=12.2:spacing_mm=0.2" + std::string(more));
    ASSERT_EQ(scene.input.models[0].cloud->size(), 62u * 62u);
    const std::vector<Vec3> path = across(rise, 1.0, 1.0);
    const std::vector<Frame> frames = run(scene, "cloud", path), truth = run(scene, "analytic", path);
    double worst = 0.0, single = 0.0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      if (!truth[i].contact || truth[i].god_object_mm.x() != 0.0) continue;
      worst = std::max(worst, (frames[i].force_n - truth[i].force_n).norm());
      // One flank alone would be wrong by this at the bottom.
      const Vec3 flank = Vec3(-0.5, 0.0, std::sqrt(0.75));
      single = std::max(single, (kStiffness * -flank.dot(path[i]) * flank - truth[i].force_n).norm());
    }
    EXPECT_LE(worst, kStiffness * 0.2 * bridge + 1e-6);
    EXPECT_GT(single, 3.0 * worst);
  }
}

/// Three faces of a cube seen from inside, points `step` apart: free where x, y and z are positive.
std::vector<Vec3> corner_points(double step, int side) {
  std::vector<Vec3> points;
  for (int i = 0; i <= side; ++i)
    for (int j = 0; j <= side; ++j) {
      points.emplace_back(i * step, j * step, 0.0);
      if (j > 0) points.emplace_back(i * step, 0.0, j * step);
      if (i > 0 && j > 0) points.emplace_back(0.0, i * step, j * step);
    }
  return points;
}

TEST(Crease, CornerHoldsByThreePlanes) {
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const SceneInput scene = cloud_of(corner_points(0.2 * s, 30));
    const auto cloud = ready(scene, "cloud-vertices:shading=facet");
    // Down into the corner, then about below it: on a face, on an edge between two, in the corner itself.
    std::vector<Vec3> path = straight({{2, 2, 2}, {-0.5, -0.5, -0.5}}, 0.02, s);
    for (int i = 0; i < 4000; ++i) {
      const double t = 0.002 * i;
      path.emplace_back(s * (Vec3(-0.5, -0.5, -0.5) +
                             Vec3(0.8 * std::sin(3 * t), 0.8 * std::sin(2 * t), 0.7 * std::sin(5 * t))));
    }
    const std::vector<Frame> frames = run(cloud, path);
    std::size_t by_planes[4] = {};
    for (std::size_t i = 0; i < path.size(); ++i) {
      const Vec3 truth = kStiffness * (path[i].cwiseMax(0.0) - path[i]);
      if (truth.norm() < 0.2 * s * kStiffness) continue;  // within a spacing of the surface
      ASSERT_TRUE(frames[i].contact) << i;
      ASSERT_LE((frames[i].force_n - truth).norm(), kStored * kStiffness * s)
          << i << " " << path[i].transpose();
      ++by_planes[(path[i].array() < 0.0).count()];
    }
    EXPECT_GT(by_planes[1], 5u);
    EXPECT_GT(by_planes[2], 100u);
    EXPECT_GT(by_planes[3], 500u);
    EXPECT_LE(steepest(frames, path), 1.0 + 1e-3);
  }
}

TEST(Crease, RidgeKeepsTheGodObjectOnItsFaceUpToTheEdge) {
  const double fall = -1.0 / std::sqrt(3.0);  // 120 degrees of material
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const Scene scene = generated(wedge(120, s));
    const std::vector<Vec3> path = across(fall, 0.5, s);
    const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                             truth = run(scene, "analytic", path);
    std::size_t contacts = 0, turned = 0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      if (!truth[i].contact || std::abs(path[i].x()) > 2.0 * s) continue;
      ++contacts;
      turned += !((frames[i].force_n - truth[i].force_n).norm() <= kStored * kStiffness * s);
    }
    EXPECT_GT(contacts, 200u);
    EXPECT_LE(turned, 1u);  // the frame in which it passes the edge may be a rounding early or late
  }
}

TEST(Crease, AlongARidgeTheGodObjectFollowsOnItsFace) {
  // Past the points nearest to the HIP, before the edge: the god object goes along the edge with the HIP.
  const Scene scene = generated(wedge(120, 1.0));
  const std::vector<Vec3> path = straight(
      {{-2, -3, 0}, {-1, -3, -0.1}, {0.2, -3, -0.7}, {0.2, 3, -0.7}, {0.3, 3, -0.75}, {0.3, -3, -0.75}}, 0.02,
      1.0);
  const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                           truth = run(scene, "analytic", path);
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!truth[i].contact || truth[i].force_n.norm() < 0.2 * kStiffness) continue;
    ++contacts;
    ASSERT_LE((frames[i].force_n - truth[i].force_n).norm(), kStored * kStiffness) << i;
  }
  EXPECT_GT(contacts, 500u);
}

}  // namespace
}  // namespace palpate::baselines::vertices
