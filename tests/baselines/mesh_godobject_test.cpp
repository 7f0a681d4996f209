#include <gtest/gtest.h>

#include <algorithm>

#include "baselines/mesh/facet.h"
#include "baselines/renderers/mesh_source.h"
#include "tests/baselines/small_models.h"
#include "tests/house/allocation_count.h"
#include "tests/toolkit/messages.h"

namespace palpate::baselines {
namespace {

using test::any_says;
using test::expect_held;
using test::expect_near;
using test::kStiffness;
using test::make;
using test::Probe;

TEST(MeshGodObject, ForceIsLimitedAndNonFiniteIsRefused) {
  Probe probe = make(test::box_mesh(5, 5, 5), "mesh-godobject:mesh=original", {}, 1.0);
  const render::Frame frame = probe.press({0, 0, 6}, {0, 0, 1}, 0.1);
  expect_near(frame.force_n, {0, 0, 1.0}, 1e-9);
  const render::Frame bad = probe.to({std::nan(""), 0, 0});
  EXPECT_EQ(bad.status, render::FrameStatus::kNonFinite);
  EXPECT_EQ(bad.force_n, Vec3::Zero());
  EXPECT_TRUE(probe.to({0, 0, 4}).contact);
}

TEST(MeshGodObject, CubeEdgesAndCornersLetGo) {
  Probe probe = make(test::box_mesh(5, 5, 5));
  expect_held(probe.press({0, 0, 6}, {0, 0, 4}, 0.1), {0, 0, 5}, 1e-9);
  expect_held(probe.glide({0, 0, 4}, {4.9, 0, 4}, 0.1), {4.9, 0, 5}, 1e-9);
  // Past the edge: round it to the side face, and free beyond.
  EXPECT_FALSE(probe.glide({4.9, 0, 4}, {5.1, 0, 4}, 0.05).contact);
  expect_held(probe.glide({5.1, 0, 4}, {4.5, 0, 4}, 0.05), {5, 0, 4}, 1e-9);
}

// Past a corner into the box: whichever plane the way meets last is the face it comes in by, and there the
// god object stays.
TEST(MeshGodObject, AWayInNearACornerHasItsFace) {
  Probe probe = make(test::box_mesh(5, 5, 5));
  for (int axis = 0; axis < 3; ++axis)
    for (const double step : {0.07, 0.5, 5.0}) {
      SCOPED_TRACE(testing::Message() << "axis " << axis << ", step " << step);
      Vec3 inside(4.5, 4.6, 0.0);
      inside[2] = 4.7;
      std::swap(inside[2], inside[axis]);
      Vec3 on_face = inside;
      on_face[axis] = 5.0;
      expect_held(probe.press({6, 6, 6}, inside, step), on_face, 1e-9);
    }
  // Through the corner itself all three are as good; on one of them it lies.
  const render::Frame frame = probe.press({6, 6, 6}, {4.5, 4.5, 4.5}, 0.07);
  ASSERT_TRUE(frame.contact);
  Vec3 sorted = frame.god_object_mm;
  std::sort(sorted.data(), sorted.data() + 3);
  expect_near(sorted, {4.5, 4.5, 5.0}, 1e-9);
}

// In by a missing facet, out through the surface, and everything is as it was before.
TEST(MeshGodObject, AHoleDoesNotTurnAClosedMeshInsideOut) {
  geometry::TriangleMesh fine = test::subdivided(test::box_mesh(5, 5, 5), 4);
  const auto hole = fine.triangles.front();
  fine.triangles.erase(fine.triangles.begin());
  const Vec3 at = (fine.vertices_mm[hole[0]] + fine.vertices_mm[hole[1]] + fine.vertices_mm[hole[2]]) / 3.0;
  Probe probe = make(fine);
  EXPECT_FALSE(probe.press(at * 1.5, {0, 0, 0}, 0.02).contact);
  EXPECT_FALSE(probe.glide({0, 0, 0}, {0.3, 0.2, 7}, 0.02).contact);
  const render::Frame frame = probe.glide({0.3, 0.2, 7}, {0.3, 0.2, 4}, 0.02);
  ASSERT_TRUE(frame.contact);
  expect_near(frame.force_n, kStiffness * Vec3(0, 0, 1), 1e-8);
}

TEST(MeshGodObject, CrossingSheetsHoldInTheirWedge) {
  Probe probe = make(test::crossing_sheets(12), "mesh-godobject:mesh=original:crossings=true");
  expect_held(probe.press({2, 0.5, 1}, {2, 0.5, -1}, 0.05), {2, 0.5, 0}, 1e-9);
  // Sideways under the floor against the wall at x = 0.3: held by both, along the wall without sticking.
  expect_held(probe.glide({2, 0.5, -1}, {-1, 0.5, -1}, 0.05), {0.3, 0.5, 0}, 1e-6);
  expect_held(probe.glide({-1, 0.5, -1}, {-1, 4.1, -1}, 0.05), {0.3, 4.1, 0}, 1e-6);
  // Up over the floor: the wall alone holds.
  expect_held(probe.glide({-1, 4.1, -1}, {-1, 4.1, 2}, 0.05), {0.3, 4.1, 2}, 1e-6);
}

TEST(MeshGodObject, OpenSheetStopsAtItsBoundaryAndLetsGo) {
  Probe probe = make(test::flat_mesh(10, 10.0));
  ASSERT_TRUE(probe.press({9, 0.1, 1}, {9, 0.1, -1}, 0.05).contact);
  expect_held(probe.glide({9, 0.1, -1}, {9.99, 0.1, -1}, 0.01), {9.99, 0.1, 0}, 1e-9);
  // Past the rim by less than an edge (2.9 mm) it is still held, as over a pinhole; by more it is free.
  EXPECT_TRUE(probe.to({10.02, 0.1, -1}).contact);
  EXPECT_FALSE(probe.to({13.0, 0.1, -1}).contact);
  // Back underneath: free there, and held from below on the way up.
  EXPECT_FALSE(probe.glide({13.0, 0.1, -1}, {5, 0.1, -1}, 0.05).contact);
  const render::Frame frame = probe.glide({5, 0.1, -1}, {5, 0.1, 0.5}, 0.05);
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
}

TEST(MeshGodObject, PinholeDoesNotSwallowTheProbe) {
  geometry::TriangleMesh mesh = test::flat_mesh(100, 10.0);
  mesh.triangles.erase(mesh.triangles.begin() + 2 * (50 * 100 + 50));
  Probe probe = make(mesh);
  probe.press({-1, 0.08, 1}, {-1, 0.08, -1}, 0.05);
  for (double x = -1; x < 1; x += 0.01) ASSERT_TRUE(probe.to({x, 0.08, -1}).contact) << x;
}

TEST(MeshGodObject, FramesAllocateNothing) {
  Probe probe = make(test::crossing_sheets(12), "mesh-godobject:mesh=original:crossings=true");
  probe.renderer->restart({2, 2, 3});
  probe.to({2, 2, 2.9});
  const house::AllocationCount count;
  std::size_t contacts = 0;
  for (int i = 0; i < 10000; ++i) {
    const double t = i * 1e-3;
    contacts += probe.to({4 * std::sin(3 * t), 5 * std::sin(2 * t), 2.9 * std::cos(7 * t)}).contact;
  }
  EXPECT_EQ(count.count(), 0u);
  EXPECT_GT(contacts, 1000u);
}

bool has_phase(const render::PrepareReport& report, std::string_view name) {
  return std::any_of(report.phases.begin(), report.phases.end(),
                     [&](const render::PreparePhase& phase) { return phase.name == name; });
}

/// What no frame needs is done where somebody asks for it, and what was left out is said.
TEST(MeshGodObject, LooksForPiecesAndCrossingsWhereAsked) {
  const geometry::TriangleMesh two = test::crossing_sheets(12);
  const Probe plain = make(two);
  EXPECT_FALSE(has_phase(plain.report, "check (OpenMesh)"));
  EXPECT_FALSE(has_phase(plain.report, "find crossing facets"));
  EXPECT_TRUE(any_says(plain.report.notes, "check=true"));
  EXPECT_FALSE(any_says(plain.report.notes, "cross others"));
  const Probe checked = make(two, "mesh-godobject:mesh=original:check=true:crossings=true");
  EXPECT_TRUE(has_phase(checked.report, "check (OpenMesh)"));
  EXPECT_TRUE(has_phase(checked.report, "find crossing facets"));
  EXPECT_TRUE(any_says(checked.report.notes, "2 components"));
  EXPECT_TRUE(any_says(checked.report.notes, "cross others"));
  const auto& said = checked.report.decisions.models.at(0).decisions;
  EXPECT_EQ(std::count_if(said.begin(), said.end(),
                          [](const render::Decision& d) {
                            return (d.about == "check" || d.about == "crossing facets") && d.given;
                          }),
            2);
  EXPECT_FALSE(test::made("mesh-godobject:mesh=original:check=perhaps").ok());
  EXPECT_FALSE(test::made("mesh-godobject:mesh=original:crossings=2").ok());
}

TEST(MeshGodObject, SaysWhatMeshItNeedsAndHandsItOut) {
  Probe probe = make(test::box_mesh(1, 1, 1));
  const auto* holder = dynamic_cast<const MeshHolder*>(probe.renderer.get());
  ASSERT_NE(holder, nullptr);
  ASSERT_NE(holder->mesh(0), nullptr);
  EXPECT_EQ(holder->mesh(0)->triangles.size(), 12u);
  EXPECT_EQ(holder->mesh(1), nullptr);
  EXPECT_GT(probe.report.bytes, 0u);
  render::SceneInput scene;
  scene.models.resize(1);
  const Error refused = test::refusal("mesh-godobject:mesh=original", scene);
  EXPECT_TRUE(test::contains(refused.message(), "advancing-front"));
}

}  // namespace
}  // namespace palpate::baselines
