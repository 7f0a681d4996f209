// Repair, smoothing and decimation, and the distances that say what they cost.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "baselines/mesh/mesh_repair.h"
#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/renderers/mesh_source.h"
#include "tests/baselines/meshes.h"
#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"

namespace palpate::baselines {
namespace {

double area_of(const geometry::TriangleMesh& mesh) {
  double area = 0.0;
  for (const auto& t : mesh.triangles)
    area += 0.5 * (mesh.vertices_mm[t[1]] - mesh.vertices_mm[t[0]])
                      .cross(mesh.vertices_mm[t[2]] - mesh.vertices_mm[t[0]])
                      .norm();
  return area;
}

TEST(MeshGap, IsBruteForceInDouble) {
  constexpr std::uint64_t kSeed = 3;
  Random random(kSeed);
  const auto mesh = test::height_mesh(20, 10.0, [](double x, double y) { return std::sin(x) + 0.1 * y; });
  const auto held = test::indexed(mesh);
  std::vector<Vec3> places(300);
  double sum = 0.0, most = 0.0;
  for (Vec3& p : places) {
    p = {random.uniform(-15, 15), random.uniform(-15, 15), random.uniform(-5, 5)};
    const double least = test::least_distance_sq(mesh, p);
    sum += least;
    most = std::max(most, least);
  }
  for (const int threads : {1, 2}) {
    const MeshGap gap = gap_to(*held.mesh, *held.index, places, threads);
    EXPECT_NEAR(gap.rms_mm, std::sqrt(sum / 300.0), 1e-6);
    EXPECT_NEAR(gap.max_mm, std::sqrt(most), 1e-6);
  }
}

TEST(MeshGap, PlacesLieEvenlyOnTheMesh) {
  const auto mesh = test::box_mesh(3, 2, 1);
  const std::vector<Vec3> places = places_on(mesh, 20'000);
  ASSERT_EQ(places.size(), 20'000u);
  const auto held = test::indexed(mesh);
  EXPECT_LT(gap_to(*held.mesh, *held.index, places, 1).max_mm, 1e-12);
  // The share of the tops is that of their area, 48 of 88.
  const auto top = [](const Vec3& p) { return std::abs(std::abs(p.z()) - 1.0) < 1e-9; };
  EXPECT_NEAR(static_cast<double>(std::count_if(places.begin(), places.end(), top)) / 20'000.0, 48.0 / 88.0,
              0.01);
}

TEST(Repair, OrientsWeldsAndFillsHoles) {
  geometry::TriangleMesh broken = test::subdivided(test::box_mesh(5, 5, 5), 3);
  // Every third facet turned round, one facet and a patch of eight missing.
  for (std::size_t i = 0; i < broken.triangles.size(); i += 3)
    std::swap(broken.triangles[i][1], broken.triangles[i][2]);
  broken.triangles.erase(broken.triangles.begin() + 200, broken.triangles.begin() + 208);
  broken.triangles.erase(broken.triangles.begin() + 5);
  RepairReport report;
  const auto whole = test::value_of(repaired(broken, 100, &report));
  EXPECT_GT(report.welded, 0u);
  EXPECT_GT(report.flipped, 0u);
  EXPECT_EQ(report.cut, 0u);
  EXPECT_EQ(report.filled_holes, 2u);
  EXPECT_EQ(report.left_loops, 0u);
  const SurfaceMeshCounts counts = SurfaceMesh::build(whole, 1)->counts();
  EXPECT_EQ(counts.boundary_edges, 0u);
  EXPECT_EQ(counts.flipped_edges, 0u);
  EXPECT_NEAR(std::abs(test::volume_of(whole)), 1000.0, 1e-9);
  EXPECT_NEAR(area_of(whole), 600.0, 1e-9);
}

TEST(Repair, KeepsTheRimOfAnOpenSheetAndCutsWhereTooManyMeet) {
  // Three sheets on one edge; a sheet's own rim is no hole.
  const geometry::TriangleMesh mesh{{{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {-1, 0, 0}, {0, 0, 1}},
                                    {{0, 1, 2}, {0, 1, 3}, {0, 1, 4}}};
  RepairReport report;
  const auto made = test::value_of(repaired(mesh, 2, &report));
  EXPECT_EQ(made.triangles.size(), 3u);
  EXPECT_EQ(report.cut, 1u);
  EXPECT_EQ(SurfaceMesh::build(made, 1)->counts().boundary_edges > 0, true);
  const auto sheet = test::flat_mesh(40, 10.0);
  const auto same = test::value_of(repaired(sheet, 100, &report));
  EXPECT_EQ(same.triangles.size(), sheet.triangles.size());
  EXPECT_EQ(report.left_loops, 1u);
}

TEST(Decimate, KeepsWhatItIsAskedAndTheShape) {
  const auto mesh = test::height_mesh(100, 50.0, test::sinusoid);
  double former = 0.0;
  for (const double share : {0.5, 0.1, 0.02}) {
    const auto made = test::value_of(decimated(mesh, share));
    EXPECT_NEAR(static_cast<double>(made.triangles.size()), share * 20'000, 2.0);
    const auto held = test::indexed(made);
    const MeshGap gap = gap_to(*held.mesh, *held.index, mesh.vertices_mm, 1);
    EXPECT_GT(gap.rms_mm, former);  // fewer facets, further off
    former = gap.rms_mm;
    // The error of a triangulation with edges e is about curvature e^2 / 8: e^2 = 2 x 1 mm^2 / share here.
    EXPECT_LT(gap.rms_mm, 0.158 * 2.0 / share / 8.0);
  }
  // A plane loses nothing; far from the origin, and small and large, the same is kept.
  const auto flat = test::flat_mesh(30, 10.0);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const geometry::RigidTransform far{Eigen::Quaterniond::Identity(), Vec3::Constant(1e4 * scale)};
    const auto moved = test::moved(flat, far, scale);
    const auto made = test::value_of(decimated(moved, 0.1));
    EXPECT_NEAR(static_cast<double>(made.triangles.size()), 180.0, 2.0);
    for (const Vec3& v : made.vertices_mm) EXPECT_NEAR(v.z(), 1e4 * scale, 1e-8 * scale);
  }
  EXPECT_FALSE(decimated(flat, 0.0).ok());
  EXPECT_FALSE(decimated({}, 0.5).ok());
}

// A fold is a false wall to whatever walks over it.
TEST(Decimate, FoldsNothing) {
  const auto mesh = test::height_mesh(150, 50.0, test::sinusoid);
  for (const double share : {0.5, 0.1, 0.01}) {
    const auto made = test::value_of(decimated(mesh, share));
    const auto held = test::indexed(made);
    EXPECT_EQ(Crossings::find(*held.mesh, *held.index, 0).pairs(), 0u) << share;
    for (std::uint32_t f = 0; f < held.mesh->facets().size(); ++f)
      ASSERT_GT(held.mesh->normal(half_facet(f, 0)).z(), 0.0) << share;
  }
}

TEST(Smooth, TakesNoiseAndLeavesAPlane) {
  constexpr std::uint64_t kSeed = 11;
  Random random(kSeed);
  auto noisy = test::height_mesh(60, 10.0, [&](double, double) { return 0.02 * random.normal(); });
  const auto rough = [](const geometry::TriangleMesh& mesh) {
    double sum = 0.0;
    for (const Vec3& v : mesh.vertices_mm)
      if (std::abs(v.x()) < 8 && std::abs(v.y()) < 8) sum += v.z() * v.z();
    return std::sqrt(sum);
  };
  const auto made = test::value_of(smoothed(noisy, 20));
  EXPECT_EQ(made.triangles.size(), noisy.triangles.size());
  EXPECT_LT(rough(made), 0.5 * rough(noisy));
  const auto flat = test::value_of(smoothed(test::flat_mesh(20, 10.0), 20));
  for (const Vec3& v : flat.vertices_mm) EXPECT_NEAR(v.z(), 0.0, 1e-12);
}

// As options of a renderer: phases, notes, and the mesh that is handed out.
TEST(Refine, IsAnOptionOfMeshRenderers) {
  const auto mesh = test::height_mesh(60, 50.0, test::sinusoid);
  for (const char* name : {"mesh-godobject", "mesh-proxy"}) {
    const std::string options = std::string(name) + ":mesh=original:repair=true:smooth=1:decimate=0.1";
    test::Probe probe = test::make(mesh, options);
    const auto* holder = dynamic_cast<const MeshHolder*>(probe.renderer.get());
    ASSERT_NE(holder, nullptr);
    EXPECT_NEAR(static_cast<double>(holder->mesh(0)->triangles.size()), 720.0, 2.0);
    std::size_t phases = 0, notes = 0;
    for (const auto& phase : probe.report.phases)
      phases += phase.name == "repair (OpenMesh)" || phase.name == "smooth (OpenMesh)" ||
                phase.name == "decimate (OpenMesh)" || phase.name == "measure the refined mesh";
    for (const auto& note : probe.report.notes) notes += note.find("Hausdorff") != std::string::npos;
    EXPECT_EQ(phases, 4u);
    EXPECT_EQ(notes, 1u);
    EXPECT_TRUE(probe.press({0, 0, 30}, {0, 0, 18}, 0.5).contact);
  }
}

}  // namespace
}  // namespace palpate::baselines
