#include <gtest/gtest.h>

#include "baselines/mesh/mesh_report.h"
#include "tests/baselines/meshes.h"
#include "toolkit/core/random.h"

namespace palpate::baselines {
namespace {

SurfaceMesh build(const geometry::TriangleMesh& mesh) {
  auto built = SurfaceMesh::build(mesh, 1);
  EXPECT_TRUE(built.ok()) << (built.ok() ? "" : built.error().message());
  return std::move(built).value();
}

TEST(SurfaceMesh, BoxIsClosedAndNeighboursAreMutual) {
  const SurfaceMesh mesh = build(test::box_mesh(1, 2, 3));
  EXPECT_EQ(mesh.counts().boundary_edges, 0u);
  EXPECT_EQ(mesh.counts().flipped_edges, 0u);
  for (std::uint32_t f = 0; f < 12; ++f)
    for (std::uint32_t e = 0; e < 3; ++e)
      for (std::uint32_t side = 0; side < 2; ++side) {
        const HalfFacet next = mesh.neighbour(half_facet(f, side), e);
        ASSERT_NE(next, kNoFacet);
        EXPECT_EQ(side_of(next), side);
        bool back = false;
        for (std::uint32_t other = 0; other < 3; ++other)
          back |= mesh.neighbour(next, other) == half_facet(f, side);
        EXPECT_TRUE(back);
      }
  const MeshReport report = report_on(mesh);
  EXPECT_TRUE(report.closed);
  EXPECT_EQ(report.components, 1u);
  EXPECT_EQ(report.faces, 12u);
}

TEST(SurfaceMesh, FlippedFacetKeepsTheSide) {
  geometry::TriangleMesh box = test::box_mesh(1, 1, 1);
  std::swap(box.triangles[2][0], box.triangles[2][1]);
  const SurfaceMesh mesh = build(box);
  EXPECT_EQ(mesh.counts().flipped_edges, 3u);
  for (std::uint32_t e = 0; e < 3; ++e) {
    const HalfFacet start = half_facet(0, 0);
    EXPECT_GT(mesh.normal(start).dot((mesh.facet(0).corner[0])), 0.0);
    const HalfFacet from_flipped = mesh.neighbour(half_facet(2, 1), e);
    EXPECT_EQ(side_of(from_flipped), 0u);
  }
  bool boundary = true;
  const Vec3 n = mesh.pseudonormal(half_facet(3, 0), kCorner, &boundary);
  EXPECT_FALSE(boundary);
  EXPECT_GT(n.dot(mesh.facet(3).corner[0]), 0.0);
}

TEST(SurfaceMesh, WeldsRepeatedVerticesAndDropsCollapsedFacets) {
  geometry::TriangleMesh box = test::box_mesh(1, 1, 1);
  geometry::TriangleMesh soup;
  for (const auto& t : box.triangles) {
    const auto base = static_cast<std::uint32_t>(soup.vertices_mm.size());
    for (const std::uint32_t v : t) soup.vertices_mm.push_back(box.vertices_mm[v]);
    soup.triangles.push_back({base, base + 1, base + 2});
  }
  soup.triangles.push_back({0, 0, 1});
  const SurfaceMesh mesh = build(soup);
  EXPECT_EQ(mesh.counts().vertices, 8u);
  EXPECT_EQ(mesh.counts().welded_vertices, 28u);
  EXPECT_EQ(mesh.counts().collapsed_facets, 1u);
  EXPECT_TRUE(report_on(mesh).closed);
}

TEST(SurfaceMesh, EdgeOfThreeFacetsConnectsEachSideToTheNextInRotation) {
  // Three leaves around the z axis at 0, 90 and 180 degrees.
  geometry::TriangleMesh fan;
  fan.vertices_mm = {{0, 0, 0}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}};
  fan.triangles = {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}};
  const SurfaceMesh mesh = build(fan);
  EXPECT_EQ(mesh.counts().radial_edges, 1u);
  // The side of leaf 0 that looks to +y sees the side of leaf 1 that looks to +x.
  const auto looks = [&](std::uint32_t facet, const Vec3& to) {
    return mesh.normal(half_facet(facet, 0)).dot(to) > 0 ? half_facet(facet, 0) : half_facet(facet, 1);
  };
  EXPECT_EQ(mesh.neighbour(looks(0, Vec3::UnitY()), 0), looks(1, Vec3::UnitX()));
  EXPECT_EQ(mesh.neighbour(looks(1, -Vec3::UnitX()), 0), looks(2, Vec3::UnitY()));
  EXPECT_EQ(mesh.neighbour(looks(2, -Vec3::UnitY()), 0), looks(0, -Vec3::UnitY()));
  EXPECT_EQ(report_on(mesh).refused_faces, 2u);  // all three run the same way: one fits
}

TEST(SurfaceMesh, HostileMeshesAreErrors) {
  geometry::TriangleMesh mesh;
  EXPECT_FALSE(SurfaceMesh::build(mesh, 1).ok());
  mesh.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 7}};
  EXPECT_FALSE(SurfaceMesh::build(mesh, 1).ok());
  mesh.triangles = {{0, 1, 2}};
  mesh.vertices_mm[1].x() = std::nan("");
  EXPECT_FALSE(SurfaceMesh::build(mesh, 1).ok());
}

TEST(ClosestOnFacet, AgreesWithSamplingAndSlivers) {
  constexpr std::uint64_t kSeed = 7;
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  for (int trial = 0; trial < 2000; ++trial) {
    Facet f{};
    const double thin = trial % 3 == 0 ? 1e-6 : 1.0;
    for (Vec3& c : f.corner) c = {random.normal(), random.normal() * thin, random.normal() * thin};
    const Vec3 p{random.normal() * 2, random.normal() * 2, random.normal() * 2};
    const FacetPoint q = closest_on_facet(f, p);
    EXPECT_NEAR(q.distance_sq, (p - q.point).squaredNorm(), 1e-12);
    for (int i = 0; i < 200; ++i) {
      double u = random.uniform(), v = random.uniform();
      if (u + v > 1) u = 1 - u, v = 1 - v;
      const Vec3 s = f.corner[0] + (f.corner[1] - f.corner[0]) * u + (f.corner[2] - f.corner[0]) * v;
      ASSERT_GE((p - s).norm(), std::sqrt(q.distance_sq) - 1e-9);
    }
  }
}

}  // namespace
}  // namespace palpate::baselines
