#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/replay.h>
#include "baselines/reference/closest_mesh.h"
#include "baselines/reference/facet_tree.h"
#include "baselines/reference/mesh_reference.h"
#include "tests/baselines/meshes.h"
#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/metrics/closest_point.h"

namespace palpate::baselines {
namespace {

constexpr std::uint64_t kSeed = 99;

trace::ProbePath path_over(double depth, std::size_t frames) {
  trace::ProbePath path;
  path.name = "test";
  for (std::size_t i = 0; i < frames; ++i) {
    const double t = static_cast<double>(i) * 1e-3;
    const double x = 30 * std::sin(0.5 * t), y = 30 * std::sin(0.8 * t + 0.4);
    path.t_s.push_back(t);
    path.hip_mm.push_back(
        {x, y, test::sinusoid(x, y) + (depth + 0.4) / 2 * std::cos(7 * t) - (depth - 0.4) / 2});
  }
  return path;
}

TEST(FacetTree, ClosestAndCrossingAgreeWithBruteForce) {
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  auto mesh = test::value_of(SurfaceMesh::build(test::height_mesh(20, 50.0, test::sinusoid), 1));
  const FacetTree tree(mesh);
  for (int i = 0; i < 500; ++i) {
    const Vec3 p{random.uniform(-60, 60), random.uniform(-60, 60), random.uniform(-60, 60)};
    const double least = test::least_distance_sq(mesh, p);
    EXPECT_EQ(tree.closest(p).point.distance_sq, least);
    const Vec3 q{random.uniform(-45, 45), random.uniform(-45, 45), -60};
    EXPECT_NE(tree.first_crossing({q.x(), q.y(), 60}, q).facet, kNoFacet);
  }
}

TEST(MeshReference, AgreesWithTheClosestPointAndWithTheRenderer) {
  const geometry::TriangleMesh mesh = test::height_mesh(250, 50.0, test::sinusoid);
  const trace::ProbePath path = path_over(1.0, 6000);
  auto truth = test::value_of(MeshTruth::build(mesh, {}));
  auto reference = test::value_of(mesh_reference(*truth, path, 0.5, 0.0, no_progress()));
  ASSERT_EQ(reference.frames.size(), path.size());
  EXPECT_TRUE(test::contains(reference.exactness, "in 0 another part"));

  const test::Probe probe = test::prepare(test::model_of(mesh), "mesh-godobject:mesh=original");
  auto trace = test::value_of(trace::replay(*probe.renderer, path));
  std::size_t contact = 0, differ = 0;
  double worst = 0.0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const render::Frame& mine = trace.frames[i];
    const render::Frame& true_frame = reference.frames[i].frame;
    contact += mine.contact;
    differ += mine.contact != true_frame.contact;
    if (mine.contact && true_frame.contact)
      worst = std::max(worst, (mine.force_n - true_frame.force_n).norm());
  }
  EXPECT_GT(contact, 2000u);
  EXPECT_LE(differ, 2u);     // the float margin at entries
  EXPECT_LT(worst, 0.0275);  // under a hill two neighbouring facets can both hold a local minimum
}

TEST(MeshReference, AgreesWithTheFormulaOnASphere) {
  const auto model = test::generated("sphere:points=20000");
  paths::PathTarget target;
  target.surface = model.surface.get();
  target.box_mm = model.surface->box_mm();
  const auto path = paths::make_path(parse_named_options("weave:frames=1500").value(), target).value();
  const auto truth = MeshTruth::build(*model.original_mesh, {}).value();
  const auto reference = mesh_reference(*truth, path, 0.5, 0, no_progress()).value();
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    // Chords lie below the sphere by at most s^2 / (4 R), far below this.
    EXPECT_NEAR(reference.frames[i].signed_distance_mm, model.surface->signed_distance_mm(path.hip_mm[i]),
                0.05);
    contacts += reference.frames[i].frame.contact;
  }
  EXPECT_GT(contacts, 700u);
}

/// Through these places in straight lines, 200 frames each.
trace::ProbePath path_through(const std::vector<Vec3>& places) {
  trace::ProbePath path;
  for (std::size_t k = 0; k + 1 < places.size(); ++k)
    for (int i = 0; i < 200; ++i) {
      path.t_s.push_back(1e-3 * static_cast<double>(path.t_s.size()));
      path.hip_mm.push_back(places[k] + (places[k + 1] - places[k]) * (i / 200.0));
    }
  return path;
}

TEST(MeshReference, ASurfaceMuchNearerThatFacesTheSameWayTakesOver) {
  const auto truth = MeshTruth::build(test::box_mesh(10, 10, 10), {}).value();
  // In by a side, up to 0.2 mm below the top, and on below it, as a recorded hand may go.
  const auto path = path_through({{12, 1, 8}, {9, 1, 8}, {9, 1, 9.8}, {0, 1, 9.8}, {0, 1, 9.8}});
  const auto reference = mesh_reference(*truth, path, 1.0, 0.0, no_progress()).value();
  for (const trace::TruthFrame& frame : reference.frames)
    EXPECT_LE(frame.frame.force_n.norm(), 1.0 + 1e-9) << "it stayed on the side";
  EXPECT_LT((reference.frames.back().frame.force_n - Vec3(0.0, 0.0, 0.2)).norm(), 1e-9);
  EXPECT_TRUE(test::contains(reference.exactness, "; 1 times"));
}

TEST(MeshReference, AThinPlateHoldsAProbeThatIsBeyondIt) {
  const auto truth = MeshTruth::build(test::box_mesh(10, 10, 0.25), {}).value();
  const auto path = path_through({{1, 2, 3}, {1, 2, -1.5}, {4, 3, -1.5}, {4, 3, -1.5}});
  const auto reference = mesh_reference(*truth, path, 1.0, 0.0, no_progress()).value();
  EXPECT_LT((reference.frames.back().frame.force_n - Vec3(0.0, 0.0, 1.75)).norm(), 1e-9);
}

// The mesh truth that shares nothing with the mesh renderers, against formulas, brute force, the other one.

constexpr std::uint64_t kClosestSeed = 4711;

geometry::RigidTransform pose() {
  return {Eigen::Quaterniond(0.3, 0.2, 0.9, -0.1).normalized(), Vec3(7, -8, 9)};
}

/// Facets in another order, each begun at another corner: nothing may depend on it.
geometry::TriangleMesh mixed_up(geometry::TriangleMesh mesh, Random& random) {
  for (std::size_t i = mesh.triangles.size(); i > 1; --i)
    std::swap(mesh.triangles[i - 1], mesh.triangles[random.below(i)]);
  for (auto& t : mesh.triangles)
    std::rotate(t.begin(), t.begin() + static_cast<long>(random.below(3)), t.end());
  return mesh;
}

/// Of a box, also straight off its edges and corners, where no facet is nearer than its neighbours.
template <class Truth>
void expect_box_distances() {
  Random random(kClosestSeed);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    geometry::RigidTransform where = pose();
    where.translation_mm *= scale;
    const auto truth =
        test::value_of(Truth::build(mixed_up(test::box_mesh(scale, 2 * scale, 3 * scale), random), where));
    for (int i = 0; i < 5000; ++i) {
      const Vec3 p{random.uniform(-3, 3), random.uniform(-4, 4), random.uniform(-5, 5)};
      const Vec3 d = p.cwiseAbs() - Vec3(1, 2, 3);
      const double expected = d.maxCoeff() < 0 ? d.maxCoeff() : d.cwiseMax(0.0).norm();
      ASSERT_NEAR(truth->signed_distance_mm(where * (scale * p)), scale * expected, scale * 1e-9) << p;
    }
    for (const Vec3& way : {Vec3(1, 1, 0), Vec3(1, 1, 1), Vec3(-1, 1, -1), Vec3(0, -1, 1)}) {
      const Vec3 rim = way.cwiseProduct(Vec3(1, 2, 3));
      const double out = truth->signed_distance_mm(where * (scale * (rim + 0.5 * way)));
      EXPECT_NEAR(out, scale * 0.5 * way.norm(), scale * 1e-9);
      EXPECT_LT(truth->signed_distance_mm(where * (scale * (rim - 0.1 * way))), 0.0);
    }
  }
}
TEST(MeshTruths, SignedDistanceOfABoxAtEveryScale) {
  RecordProperty("seed", static_cast<int>(kClosestSeed));
  expect_box_distances<MeshTruth>();
  expect_box_distances<ClosestMesh>();
}

TEST(ClosestMesh, SharpFoldsAndThinParts) {
  // A needle of a tetrahedron: at its tip the side cannot be told from one facet's plane.
  const geometry::TriangleMesh needle{{{0, 0, 10}, {0.3, 0, 0}, {-0.15, 0.26, 0}, {-0.15, -0.26, 0}},
                                      {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {1, 3, 2}}};
  const auto truth = test::value_of(ClosestMesh::build(needle, {}));
  Random random(kClosestSeed);
  int inside = 0;
  for (int i = 0; i < 20000; ++i) {
    const Vec3 p{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-1, 11)};
    const bool behind_all = std::ranges::all_of(needle.triangles, [&](const auto& t) {
      const Vec3 &a = needle.vertices_mm[t[0]], &b = needle.vertices_mm[t[1]], &c = needle.vertices_mm[t[2]];
      return (b - a).cross(c - a).dot(p - a) < 0.0;
    });
    inside += behind_all;
    ASSERT_EQ(truth->signed_distance_mm(p) < 0.0, behind_all) << p.transpose();
  }
  EXPECT_GT(inside, 100);
}

TEST(ClosestMesh, BeyondTheRimOfAnOpenMeshIsOutside) {
  const auto sheet = test::value_of(ClosestMesh::build(test::flat_mesh(8, 10.0), pose()));
  EXPECT_NEAR(sheet->signed_distance_mm(pose() * Vec3(3, 4, -1)), -1.0, 1e-12);
  EXPECT_NEAR(sheet->signed_distance_mm(pose() * Vec3(3, 4, 1)), 1.0, 1e-12);
  for (const Vec3& beyond : {Vec3(10.5, 1, -1), Vec3(0, -11, -2), Vec3(12, 12, -0.1), Vec3(-10.1, 0, 0.3)})
    EXPECT_GT(sheet->signed_distance_mm(pose() * beyond), 0.0) << beyond.transpose();
}

TEST(ClosestMesh, AgreesWithTheOtherTruthOnAnUnevenBody) {
  const auto made = test::generated("pebble:points=2000:jitter=0.2:nonuniform=0.6:seed=5");
  ASSERT_NE(made.original_mesh, nullptr);
  Random random(kClosestSeed);
  const auto ours = MeshTruth::build(*made.original_mesh, pose()).value();
  const auto theirs = ClosestMesh::build(mixed_up(*made.original_mesh, random), pose()).value();
  const geometry::Aabb box = made.cloud.box_mm();
  for (int i = 0; i < 3000; ++i) {
    Vec3 p;
    for (int axis = 0; axis < 3; ++axis) p[axis] = 1.2 * random.uniform(box.low_mm[axis], box.high_mm[axis]);
    const double a = ours->signed_distance_mm(pose() * p), b = theirs->signed_distance_mm(pose() * p);
    ASSERT_NEAR(a, b, 1e-9) << p.transpose();
    const geometry::SurfacePoint near = theirs->closest(pose() * p);
    EXPECT_NEAR((near.point_mm - pose() * p).norm(), std::abs(b), 1e-9);
    EXPECT_NEAR(near.normal.norm(), 1.0, 1e-9);
  }
}

TEST(ClosestMesh, FindsWhereAFollowedReferenceIsHeldByASheet) {
  // A plate of 0.4 mm is crossed: the way decides from the middle on.
  const auto plate = test::subdivided(test::box_mesh(10, 10, 0.2), 2);
  trace::ProbePath path;
  path.name = "through";
  for (int i = 0; i < 400; ++i) {
    path.t_s.push_back(1e-3 * i);
    path.hip_mm.push_back({0.3, 0.4, 1.0 - 0.005 * i});
  }
  const auto mesh = MeshTruth::build(plate, {}).value();
  const auto closest = ClosestMesh::build(plate, {}).value();
  auto first = test::value_of(mesh_reference(*mesh, path, 0.5, 0.0, no_progress()));
  const auto second =
      test::value_of(metrics::closest_point_reference(*closest, path, 0.5, 0.0, no_progress()));
  const auto tally = test::value_of(metrics::compare_references(first, second, path));
  EXPECT_EQ(tally.place, 40u);                                // z in (-0.2, 0)
  EXPECT_NEAR(static_cast<double>(tally.state), 159.0, 1.0);  // below the plate
  for (std::size_t i = 0; i < path.size(); ++i)
    if (std::abs(path.hip_mm[i].z()) > 1e-9 && std::abs(path.hip_mm[i].z() + 0.2) > 1e-9) {
      EXPECT_EQ(first.frames[i].history_decides, path.hip_mm[i].z() < 0.0) << i;
    }
}

TEST(ClosestMesh, RefusesWhatIsNoSurface) {
  EXPECT_FALSE(ClosestMesh::build({}, {}));
  EXPECT_FALSE(ClosestMesh::build({{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, {{0, 1, 2}}}, {}));
  geometry::TriangleMesh nan = test::box_mesh(1, 1, 1);
  nan.vertices_mm[3].y() = std::nan("");
  EXPECT_TRUE(test::refused(ClosestMesh::build(nan, {}), "vertex 3"));
}

}  // namespace
}  // namespace palpate::baselines
