// A refined surface: as sound as what it is made of, nearer to smooth surfaces by the order that was
// promised, and not rounder at creases.
#include "toolkit/stars/refine.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "tests/toolkit/stars/clouds.h"
#include "tests/toolkit/stars/sound.h"

namespace palpate::stars {
namespace {

/// Over a sphere around the world's origin: how far the middles of facets are off it, and how far their
/// normals are turned, as root mean squares.
struct Off {
  double height = 0.0, turn = 0.0;
};
Off off_sphere(const StarMesh& mesh, double radius) {
  Off off;
  std::size_t count = 0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i)
    mesh.for_triangles_of(i, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const Vec3 middle = (mesh.at(a) + mesh.at(b) + mesh.at(c)) / 3.0 + mesh.origin_mm();
      const Vec3 n = (mesh.at(b) - mesh.at(a)).cross(mesh.at(c) - mesh.at(a)).normalized();
      off.height += std::pow(middle.norm() - radius, 2);
      off.turn += (n - middle.normalized()).squaredNorm();
      ++count;
    });
  off.height = std::sqrt(off.height / static_cast<double>(count));
  off.turn = std::sqrt(off.turn / static_cast<double>(count));
  return off;
}

TEST(Refined, IsSoundOnAnyPoints) {
  for (const Named& cloud : all_clouds()) {
    SCOPED_TRACE(cloud.name);
    const StarMesh coarse = StarMesh::build(cloud_of(cloud.points), 2);
    const StarMesh fine = refined(coarse, 1, 2);
    expect_sound(fine);
    EXPECT_EQ(fine.counts().triangles, 4 * coarse.counts().triangles);
    EXPECT_EQ(fine.counts().closed_pieces, coarse.counts().closed_pieces);
  }
}

TEST(Refined, IsNearerToASphereByAnOrder) {
  const StarMesh coarse = StarMesh::build(cloud_of(random_spheres({10.0}, 0.5, 41)), 2);
  const Off before = off_sphere(coarse, 10.0);
  const Off once = off_sphere(refined(coarse, 1, 2), 10.0);
  const Off twice = off_sphere(refined(coarse, 2, 2), 10.0);
  EXPECT_LT(once.height, 0.3 * before.height);
  EXPECT_LT(twice.height, 0.3 * once.height);
  EXPECT_LT(once.turn, 0.55 * before.turn);
  EXPECT_LT(twice.turn, 0.55 * once.turn);
}

TEST(Refined, KeepsThePointsAndTheCreases) {
  // A floor and a wall, joined by points of both.
  std::vector<Vec3> points;
  for (int y = 0; y <= 20; ++y)
    for (int k = -10; k <= 10; ++k) points.emplace_back(std::min(k, 0), y, std::max(k, 0));
  const StarMesh coarse = StarMesh::build(cloud_of(points), 2);
  // The ends of the crease may have a triangle more or less.
  ASSERT_NEAR(static_cast<double>(coarse.counts().triangles), 2.0 * 20.0 * 20.0, 2.0);
  const StarMesh fine = refined(coarse, 2, 2);
  std::size_t kept = 0;
  for (std::uint32_t i = 0; i < fine.size(); ++i) {
    const Vec3 p = fine.at(i) + fine.origin_mm();
    if (p.y() > 1.0 && p.y() < 19.0) {
      EXPECT_LT(std::min(std::abs(p.x()), std::abs(p.z())), 1e-6);
    }
    kept += static_cast<std::size_t>((points[fine.order()[i]] - p).norm() < 1e-6);
  }
  EXPECT_EQ(kept, points.size());
}

TEST(Refined, IsTheSameForAnyNumberOfThreads) {
  const StarMesh coarse = StarMesh::build(cloud_of(random_torus(60000, 0.0, 42)), 2);
  const StarMesh one = refined(coarse, 1, 1), many = refined(coarse, 1, 0);
  ASSERT_EQ(one.size(), many.size());
  EXPECT_EQ(one.order(), many.order());
  for (std::uint32_t i = 0; i < one.size(); ++i) {
    ASSERT_EQ(one.at(i), many.at(i));
    const Ring a = one.ring(i), b = many.ring(i);
    ASSERT_TRUE(std::equal(a.of, a.of + a.size, b.of, b.of + b.size) && a.open == b.open);
  }
}

}  // namespace
}  // namespace palpate::stars
