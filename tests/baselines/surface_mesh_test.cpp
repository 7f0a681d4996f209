#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "baselines/mesh/mesh_repair.h"
#include "baselines/mesh/pieces.h"
#include "baselines/proximity/segment_index.h"
#include "tests/baselines/meshes.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::baselines {
namespace {

SurfaceMesh build(const geometry::TriangleMesh& mesh) {
  return test::value_of(SurfaceMesh::build(mesh, 1));
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

/// Thousands of facets in no order, some of them turned, with everything that a file may hold: vertices given
/// twice, facets given twice and without area, edges of three facets, unused vertices, islands.
geometry::TriangleMesh jumble(std::uint64_t seed) {
  Random random(seed);
  geometry::TriangleMesh mesh = test::height_mesh(160, 50.0, test::sinusoid);
  for (int island = 0; island < 40; ++island)
    mesh = test::joined(mesh, test::moved(test::box_mesh(1, 2, 3),
                                          {Eigen::Quaterniond::Identity(), Vec3(3.0 * island, 0, 200)}));
  const auto below = [&](std::size_t n) {
    return std::min(static_cast<std::uint32_t>(random.uniform() * static_cast<double>(n)),
                    static_cast<std::uint32_t>(n - 1));
  };
  for (int i = 0; i < 300; ++i) {
    const std::uint32_t v = below(mesh.vertices_mm.size());
    mesh.vertices_mm.push_back(mesh.vertices_mm[v]);
    auto twice = mesh.triangles[below(mesh.triangles.size())];
    if (i % 3 == 0) std::swap(twice[0], twice[1]);
    mesh.triangles.push_back(twice);
    mesh.triangles.push_back({twice[0], twice[1], below(mesh.vertices_mm.size())});
    mesh.triangles.push_back({v, v, twice[2]});
    for (std::uint32_t& corner : mesh.triangles[below(mesh.triangles.size())])
      if (corner == v) corner = static_cast<std::uint32_t>(mesh.vertices_mm.size() - 1);
  }
  std::vector<std::uint32_t> to(mesh.vertices_mm.size());
  std::iota(to.begin(), to.end(), 0u);
  for (std::size_t i = to.size() - 1; i > 0; --i) std::swap(to[i], to[below(i + 1)]);
  geometry::TriangleMesh mixed = mesh;
  for (std::size_t i = 0; i < to.size(); ++i) mixed.vertices_mm[to[i]] = mesh.vertices_mm[i];
  for (auto& t : mixed.triangles) {
    for (std::uint32_t& v : t) v = to[v];
    if (random.uniform() < 0.1) std::swap(t[1], t[2]);
  }
  for (std::size_t i = mixed.triangles.size() - 1; i > 0; --i)
    std::swap(mixed.triangles[i], mixed.triangles[below(i + 1)]);
  return mixed;
}

void expect_same(const SurfaceMesh& a, const SurfaceMesh& b) {
  ASSERT_EQ(a.vertices().size(), b.vertices().size());
  ASSERT_EQ(a.facets().size(), b.facets().size());
  EXPECT_EQ(a.origin_mm(), b.origin_mm());
  EXPECT_EQ(a.rounding_mm(), b.rounding_mm());
  for (std::uint32_t v = 0; v < a.vertices().size(); ++v) {
    ASSERT_EQ(a.vertices()[v], b.vertices()[v]);
    ASSERT_TRUE(std::ranges::equal(a.star(v), b.star(v)));
  }
  for (std::uint32_t f = 0; f < a.facets().size(); ++f) {
    ASSERT_EQ(a.facet(f).vertex, b.facet(f).vertex);
    ASSERT_EQ(a.facet(f).across, b.facet(f).across);
    for (std::size_t i = 0; i < 3; ++i) ASSERT_EQ(a.facet(f).corner[i], b.facet(f).corner[i]);
    for (std::uint32_t e = 0; e < 3; ++e)
      for (const std::uint32_t side : {0u, 1u})
        ASSERT_EQ(a.neighbour(half_facet(f, side), e), b.neighbour(half_facet(f, side), e));
  }
}

void expect_same_counts(const SurfaceMeshCounts& a, const SurfaceMeshCounts& b) {
  using Counts = SurfaceMeshCounts;
  for (const auto count :
       {&Counts::vertices, &Counts::welded_vertices, &Counts::collapsed_facets, &Counts::repeated_facets,
        &Counts::fins, &Counts::edges, &Counts::boundary_edges, &Counts::radial_edges})
    EXPECT_EQ(a.*count, b.*count);
}

TEST(SurfaceMesh, IsTheSameForAnyNumberOfThreads) {
  for (const std::uint64_t seed : {1u, 2u}) {
    RecordProperty("seed", static_cast<int>(seed));
    const geometry::TriangleMesh mesh = jumble(seed);
    ASSERT_GT(mesh.triangles.size(), 3 * kPointsPerChunk) << "too few for several chunks";
    for (const MeshOrder order : {MeshOrder::kGiven, MeshOrder::kCurve}) {
      const SurfaceMesh one = std::move(SurfaceMesh::build(mesh, 1, order)).value();
      EXPECT_GT(one.counts().welded_vertices, 0u);
      EXPECT_GT(one.counts().repeated_facets, 0u);
      EXPECT_GT(one.counts().radial_edges, 0u);
      EXPECT_GT(one.counts().collapsed_facets, 0u);
      for (const int threads : {2, 3, 0}) {
        const SurfaceMesh more = std::move(SurfaceMesh::build(mesh, threads, order)).value();
        expect_same(one, more);
        expect_same_counts(one.counts(), more.counts());
      }
    }
  }
}

/// Corners of a facet in the order of their places.
std::array<std::array<double, 3>, 3> places_of(const SurfaceMesh& mesh, std::uint32_t facet) {
  std::array<std::array<double, 3>, 3> places{};
  for (std::size_t i = 0; i < 3; ++i)
    for (int axis = 0; axis < 3; ++axis)
      places[i][static_cast<std::size_t>(axis)] = mesh.facet(facet).corner[i][axis];
  std::sort(places.begin(), places.end());
  return places;
}

/// Numbers along the curve say the same as the given ones: facets, and what lies over each edge.
TEST(SurfaceMesh, OrderAlongTheCurveChangesNumbersAlone) {
  const geometry::TriangleMesh mesh = jumble(3);
  const SurfaceMesh given = build(mesh);
  const SurfaceMesh curve = std::move(SurfaceMesh::build(mesh, 0, MeshOrder::kCurve)).value();
  expect_same_counts(given.counts(), curve.counts());
  ASSERT_EQ(given.facets().size(), curve.facets().size());
  std::map<std::array<std::array<double, 3>, 3>, std::uint32_t> of;
  for (std::uint32_t f = 0; f < given.facets().size(); ++f) of[places_of(given, f)] = f;
  ASSERT_EQ(of.size(), given.facets().size());
  double near = 0.0, far = 0.0;
  for (std::uint32_t f = 0; f < curve.facets().size(); ++f) {
    const auto found = of.find(places_of(curve, f));
    ASSERT_NE(found, of.end());
    std::multiset<std::uint32_t> over, expected;
    for (std::uint32_t e = 0; e < 3; ++e)
      for (const std::uint32_t side : {0u, 1u}) {
        const HalfFacet there = curve.neighbour(half_facet(f, side), e),
                        here = given.neighbour(half_facet(found->second, side), e);
        over.insert(there == kNoFacet ? kNoFacet : of.at(places_of(curve, facet_of(there))));
        expected.insert(here == kNoFacet ? kNoFacet : facet_of(here));
      }
    ASSERT_EQ(over, expected);
    if (f == 0) continue;
    near += (curve.facet(f).corner[0] - curve.facet(f - 1).corner[0]).norm();
    far += (given.facet(f).corner[0] - given.facet(f - 1).corner[0]).norm();
  }
  EXPECT_LT(20.0 * near, far) << "facets next to each other in memory are near each other";
}

/// Pieces by a walk over single neighbours, one facet at a time.
TEST(Pieces, AreThoseOfAWalkForAnyNumberOfThreads) {
  const SurfaceMesh mesh = std::move(SurfaceMesh::build(jumble(4), 0, MeshOrder::kCurve)).value();
  const Pieces one = pieces_of(mesh, 1);
  EXPECT_GT(one.count, 40u);
  for (const int threads : {2, 3, 0}) {
    const Pieces more = pieces_of(mesh, threads);
    EXPECT_EQ(more.number, one.number);
    EXPECT_EQ(more.flipped, one.flipped);
  }
  std::vector<std::uint32_t> number(mesh.facets().size(), kNoFacet);
  std::uint32_t count = 0;
  for (std::uint32_t start = 0; start < number.size(); ++start) {
    if (number[start] != kNoFacet) continue;
    std::vector<std::uint32_t> open{start};
    number[start] = count;
    while (!open.empty()) {
      const std::uint32_t facet = open.back();
      open.pop_back();
      for (std::uint32_t e = 0; e < 3; ++e) {
        const HalfFacet a = mesh.neighbour(half_facet(facet, 0), e),
                        b = mesh.neighbour(half_facet(facet, 1), e);
        if (a == kNoFacet || b == kNoFacet || facet_of(a) != facet_of(b)) continue;
        if (number[facet_of(a)] != kNoFacet) continue;
        number[facet_of(a)] = count;
        open.push_back(facet_of(a));
      }
    }
    ++count;
  }
  ASSERT_EQ(one.count, count);
  for (std::uint32_t f = 0; f < number.size(); ++f) ASSERT_EQ(one.piece_of(f), number[f]);
}

/// A sheet of facets turned at random agrees once they are turned back.
TEST(Pieces, SayWhichFacetsLookTheOtherWay) {
  geometry::TriangleMesh sheet = test::height_mesh(130, 50.0, test::sinusoid);
  Random random(5);
  for (auto& t : sheet.triangles)
    if (random.uniform() < 0.5) std::swap(t[0], t[1]);
  const SurfaceMesh mesh = std::move(SurfaceMesh::build(sheet, 0, MeshOrder::kCurve)).value();
  const Pieces pieces = pieces_of(mesh, 0);
  ASSERT_EQ(pieces.count, 1u);
  const double first = mesh.normal(half_facet(0, 0)).z();
  for (std::uint32_t f = 0; f < mesh.facets().size(); ++f)
    ASSERT_GT(first * mesh.normal(half_facet(f, pieces.side(f))).z(), 0.0);
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

constexpr std::uint64_t kSeed = 20240607;

/// Segments through vertices, edges and facets of a bumpy surface, at several scales, near and far from the
/// origin: not one may miss.
TEST(SegmentIndex, NoSegmentSlipsThroughEdgesOrVertices) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const geometry::TriangleMesh unit = test::height_mesh(60, 50.0, test::sinusoid);
  std::size_t tried = 0, missed = 0;
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double shift : {0.0, 1e5}) {
      const geometry::RigidTransform motion{Eigen::Quaterniond(0.5, 0.1, -0.7, 0.3).normalized(),
                                            Vec3::Constant(shift * scale)};
      const test::Indexed built = test::indexed(test::moved(unit, motion, scale));
      const double reach = 3.0 * scale;
      for (int i = 0; i < 30000; ++i) {
        const auto f = static_cast<std::uint32_t>(random.below(built.mesh->facets().size()));
        const Facet& facet = built.mesh->facet(f);
        const auto corner = static_cast<std::uint32_t>(random.below(3));
        Vec3 aim = facet.corner[corner];
        if (i % 2 == 1) aim += (facet.corner[after(corner)] - aim) * random.uniform();
        bool boundary = false;
        for (std::uint32_t c = 0; c < 3; ++c)
          boundary |= built.mesh->around_corner(half_facet(f, 0), c, [](HalfFacet) {});
        if (boundary) continue;
        const Vec3 n = built.mesh->normal(half_facet(f, 0));
        const Vec3 along = Vec3(random.normal(), random.normal(), random.normal()).cross(n).normalized();
        const Vec3 way = (n + along * random.uniform(0.0, 0.8)).normalized() * reach;
        ++tried;
        missed += !built.index->first_hit(aim + way, aim - way).has_value();
      }
    }
  EXPECT_GT(tried, 100000u);
  EXPECT_EQ(missed, 0u);
}

/// A path across the surface in small steps, every second joint on the surface: some step must meet it.
TEST(SegmentIndex, ChainsOfSegmentsMeetTheSurface) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const test::Indexed built = test::indexed(test::height_mesh(40, 50.0, test::sinusoid));
  std::size_t missed = 0;
  constexpr int kChains = 20000;
  for (int i = 0; i < kChains; ++i) {
    const auto f = static_cast<std::uint32_t>(random.below(built.mesh->facets().size()));
    const Facet& facet = built.mesh->facet(f);
    const Vec3 joint = i % 2 == 0 ? facet.corner[0] : Vec3((facet.corner[0] + facet.corner[1]) / 2);
    if (joint.head<2>().cwiseAbs().maxCoeff() > 45.0) continue;
    const Vec3 above = joint + Vec3(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1.0);
    const Vec3 below = joint - Vec3(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1.0);
    missed += !built.index->first_hit(above, joint) && !built.index->first_hit(joint, below);
  }
  EXPECT_EQ(missed, 0u);
}

TEST(SegmentIndex, WithinAndNearestAgreeWithBruteForce) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const test::Indexed built = test::indexed(test::height_mesh(20, 50.0, test::sinusoid));
  for (int i = 0; i < 300; ++i) {
    const Vec3 p{random.uniform(-40, 40), random.uniform(-40, 40), random.uniform(-30, 30)};
    const double least = test::least_distance_sq(*built.mesh, p);
    const std::uint32_t near = built.index->nearest(p, 200.0);
    ASSERT_NE(near, kNoFacet);
    EXPECT_NEAR(closest_on_facet(built.mesh->facet(near), p).distance_sq, least, 1e-9 * least);
    EXPECT_TRUE(built.index->within(p, std::sqrt(least) * 1.001 + 1e-9));
    EXPECT_FALSE(built.index->within(p, std::sqrt(least) * 0.999));
  }
}

TEST(Crossings, TwoCrossingSheetsAreFoundAndAFoldedOneHasNone) {
  const test::Indexed crossing = test::indexed(test::crossing_sheets(8));
  const Crossings found = Crossings::find(*crossing.mesh, *crossing.index, 1);
  EXPECT_TRUE(found.any());
  for (std::uint32_t f = 0; f < crossing.mesh->facets().size(); ++f)
    for (const std::uint32_t g : found.of(f)) EXPECT_NE(f < 128, g < 128);
  const test::Indexed single = test::indexed(test::height_mesh(30, 50.0, test::sinusoid));
  EXPECT_FALSE(Crossings::find(*single.mesh, *single.index, 2).any());
}

}  // namespace
}  // namespace palpate::baselines
