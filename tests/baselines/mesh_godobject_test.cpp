// The mesh rival must be as good as it can be: exact within the facet, no lag, no jam, no pop-through.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <stdexcept>

#include "baselines/mesh/mesh_report.h"
#include "baselines/mesh_holder.h"
#include "baselines/reconstruct/advancing_front.h"
#include "baselines/reference/mesh_reference.h"
#include "baselines/register.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/replay.h"

namespace palpate::baselines {
namespace {

using geometry::TriangleMesh;
using render::Frame;

render::SceneInput scene_of(std::shared_ptr<const TriangleMesh> mesh) {
  render::SceneInput scene;
  render::ModelInput model;
  model.cloud = std::make_shared<cloud::Cloud>(
      cloud::build_cloud(mesh->vertices_mm, cloud::NonFinite::kRefuse).value());
  model.original_mesh = std::move(mesh);
  scene.models.push_back(model);
  return scene;
}

std::unique_ptr<render::HapticRenderer> prepared(const render::SceneInput& scene, const std::string& spec) {
  render::Registry registry;
  register_baseline_renderers(registry);
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  const auto report = renderer->prepare(scene, {1, nullptr});
  if (!report) throw std::runtime_error(report.error().message());
  return renderer;
}

std::shared_ptr<TriangleMesh> mesh_of(std::vector<Vec3> vertices,
                                      std::vector<std::array<std::uint32_t, 3>> triangles) {
  auto mesh = std::make_shared<TriangleMesh>();
  mesh->vertices_mm = std::move(vertices);
  mesh->triangles = std::move(triangles);
  return mesh;
}

Frame move(render::HapticRenderer& renderer, const Vec3& from, const Vec3& to, int frames) {
  Frame frame;
  for (int i = 1; i <= frames; ++i)
    frame = renderer.step(from + (static_cast<double>(i) / frames) * (to - from), 1e-3);
  return frame;
}

/// A valley along y: two planes rising at 45 degrees from the line x = z = 0.
std::shared_ptr<TriangleMesh> valley() {
  return mesh_of({{-10, -10, 10}, {-10, 10, 10}, {0, -10, 0}, {0, 10, 0}, {10, -10, 10}, {10, 10, 10}},
                 {{0, 2, 3}, {0, 3, 1}, {2, 4, 5}, {2, 5, 3}});
}

TEST(MeshGodObject, TwoPlanesHoldInAValley) {
  const auto renderer = prepared(scene_of(valley()), "mesh-godobject:mesh=original");
  renderer->reset(Vec3(1, 0.5, 6));
  const Frame f = move(*renderer, Vec3(1, 0.5, 6), Vec3(0.2, 0.5, -2), 400);
  ASSERT_TRUE(f.contact);
  EXPECT_NEAR((f.god_object_mm - Vec3(0, 0.5, 0)).norm(), 0.0, 1e-6);
  EXPECT_NEAR((f.force_n - 0.5 * Vec3(-0.2, 0, 2)).norm(), 0.0, 1e-6);
  EXPECT_FALSE(move(*renderer, Vec3(0.2, 0.5, -2), Vec3(0, 0.5, 5), 400).contact);
}

TEST(MeshGodObject, ThreePlanesHoldInACorner) {
  // The inside corner of the positive octant.
  const auto mesh = mesh_of({{0, 0, 0}, {9, 0, 0}, {0, 9, 0}, {0, 0, 9}}, {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}});
  const auto renderer = prepared(scene_of(mesh), "mesh-godobject:mesh=original");
  renderer->reset(Vec3(2, 1, 1));
  const Frame f = move(*renderer, Vec3(2, 1, 1), Vec3(-1, -0.5, -0.7), 300);
  ASSERT_TRUE(f.contact);
  EXPECT_NEAR(f.god_object_mm.norm(), 0.0, 1e-9);
}

TEST(MeshGodObject, UnconnectedSheetsThatCrossHoldTogether) {
  // A floor and a wall that share no vertex.
  const auto mesh = mesh_of({{-10, -10, 0},
                             {10, -10, 0},
                             {10, 10, 0},
                             {-10, 10, 0},
                             {3, -10, -5},
                             {3, 10, -5},
                             {3, 10, 9},
                             {3, -10, 9}},
                            {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}});
  const auto renderer = prepared(scene_of(mesh), "mesh-godobject:mesh=original");
  renderer->reset(Vec3(0, 1, 2));
  move(*renderer, Vec3(0, 1, 2), Vec3(0, 1, -0.5), 100);
  const Frame f = move(*renderer, Vec3(0, 1, -0.5), Vec3(5, 1, -0.5), 200);
  ASSERT_TRUE(f.contact);
  EXPECT_NEAR(f.god_object_mm.x(), 3.0, 1e-3);
  EXPECT_NEAR(f.god_object_mm.z(), 0.0, 1e-3);
  EXPECT_LT(f.force_n.x(), -0.9);
}

TEST(MeshGodObject, DoesNotPopThroughAThinSlab) {
  for (const double side : {1.0, -1.0}) {
    const auto model =
        cloud::generate(parse_named_options("slab:points=6000:thickness_mm=0.2:extent_mm=20").value())
            .value();
    const auto renderer = prepared(scene_of(model.original_mesh), "mesh-godobject:mesh=original");
    const double face = side > 0 ? model.surface->box_mm().high_mm.z() : model.surface->box_mm().low_mm.z();
    renderer->reset(Vec3(0.3, 0.1, face + side));
    const Frame f = move(*renderer, Vec3(0.3, 0.1, face + side), Vec3(0.3, 0.1, face - 3 * side), 500);
    ASSERT_TRUE(f.contact);
    EXPECT_NEAR(f.god_object_mm.z(), face, 1e-6);
    EXPECT_NEAR(f.force_n.z(), side * 1.5, 1e-6);
  }
}

TEST(MeshGodObject, LeavesPastTheRimOfAnOpenSheet) {
  const auto mesh = mesh_of({{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, {-1, 1, 0}}, {{0, 1, 2}, {0, 2, 3}});
  const auto renderer = prepared(scene_of(mesh), "mesh-godobject:mesh=original");
  renderer->reset(Vec3(0.2, 0, 1));
  EXPECT_TRUE(move(*renderer, Vec3(0.2, 0, 1), Vec3(0.2, 0, -0.3), 100).contact);
  EXPECT_FALSE(move(*renderer, Vec3(0.2, 0, -0.3), Vec3(8, 0, -0.3), 300).contact);
}

TEST(MeshGodObject, NeverJamsOnADenseMesh) {
  const auto model = cloud::generate(parse_named_options("sinusoid:points=90601").value()).value();
  render::SceneInput scene = scene_of(model.original_mesh);
  const auto renderer = prepared(scene, "mesh-godobject:mesh=original");
  trace::PathTarget target;
  target.surface = model.surface.get();
  target.box_mm = model.surface->box_mm();
  const auto path = trace::make_path(parse_named_options("weave:frames=9000").value(), target).value();
  const auto truth = MeshTruth::build(*model.original_mesh, {}).value();
  renderer->reset(path.hip_mm[0]);
  int stops = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    Frame f = renderer->step(path.hip_mm[i], 1e-3);
    if (!f.contact || i % 60 != 0) continue;
    ++stops;
    const Frame held = renderer->step(path.hip_mm[i], 1e-3);
    EXPECT_EQ(held.god_object_mm, f.god_object_mm) << "it lags at frame " << i;
    // Shallow and smooth: the god object must be the closest point of the whole mesh, or the one under the
    // other facet of a convex edge, which is a true local minimum. Those differ by less than the facets stand
    // off the surface: s^2 / (8 R) = 0.02 mm for edges s of 1 mm on the steepest part and the smallest radius
    // R of 6.3 mm.
    const double distance = (held.god_object_mm - path.hip_mm[i]).norm();
    const double closest = (truth->closest(path.hip_mm[i]).point_mm - path.hip_mm[i]).norm();
    EXPECT_GE(distance, closest - 1e-9);
    EXPECT_LE(distance, closest + 0.02);
  }
  EXPECT_GT(stops, 80);
}

TEST(SegmentIndex, NothingSlipsThroughEdgesAndCorners) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const auto model = cloud::generate(parse_named_options("sphere:points=3000").value()).value();
    TriangleMesh mesh = *model.original_mesh;
    for (Vec3& v : mesh.vertices_mm) v = scale * (v + Vec3(1000, -500, 200));
    const SurfaceMesh surface = SurfaceMesh::build(mesh, 1).value();
    const SegmentIndex index = SegmentIndex::build(surface, 1).value();
    Random random(6);
    int missed = 0;
    for (int i = 0; i < 40000; ++i) {
      const Facet& f = surface.facet(static_cast<std::uint32_t>(random.below(surface.facets().size())));
      const double t = i % 3 == 0 ? 0.0 : random.uniform();
      const Vec3 aim = f.corner[0] + t * (f.corner[1] - f.corner[0]);  // a corner or an edge point
      missed += !index.first_hit(1.5 * aim, 0.5 * aim).has_value();
    }
    EXPECT_EQ(missed, 0) << "scale " << scale;
  }
}

TEST(AdvancingFront, MeshesASphereAndSaysWhatItMade) {
  const auto model = cloud::generate(parse_named_options("sphere:points=3000:jitter=0.2").value()).value();
  const auto mesh = advancing_front(model.cloud, no_progress());
  ASSERT_TRUE(mesh);
  const MeshReport report = check_mesh(*mesh);
  EXPECT_EQ(report.components, 1u);
  EXPECT_TRUE(report.closed()) << report.text();
  EXPECT_EQ(report.faces, 2 * report.vertices - 4);  // Euler
  const auto flat = advancing_front(
      cloud::build_cloud({{Vec3(0, 0, 0), Vec3(1, 0, 0)}}, cloud::NonFinite::kRefuse).value(), no_progress());
  EXPECT_FALSE(flat);
}

TEST(MeshReport, CountsWhatIsWrong) {
  TriangleMesh mesh;
  mesh.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {9, 9, 9}};
  mesh.triangles = {{0, 1, 2}, {1, 0, 3}, {0, 1, 4}, {0, 0, 1}};  // an edge of three, and a collapsed face
  const MeshReport report = check_mesh(mesh);
  EXPECT_EQ(report.faces, 2u);
  EXPECT_EQ(report.refused_faces, 2u);
  EXPECT_EQ(report.components, 1u);
  EXPECT_EQ(report.boundary_loops, 1u);
  EXPECT_EQ(report.isolated_vertices, 2u);
}

TEST(MeshReference, AgreesWithTheFormulaOnASphere) {
  const auto model = cloud::generate(parse_named_options("sphere:points=20000").value()).value();
  trace::PathTarget target;
  target.surface = model.surface.get();
  target.box_mm = model.surface->box_mm();
  const auto path = trace::make_path(parse_named_options("weave:frames=1500").value(), target).value();
  const auto truth = MeshTruth::build(*model.original_mesh, {}).value();
  const auto reference = mesh_reference(*truth, path, 0.5, 0, no_progress()).value();
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double exact = model.surface->signed_distance_mm(path.hip_mm[i]);
    // A chord of the mesh lies below the sphere by at most s^2 / (8 R) x 2 (facets), far below a hundredth of
    // a mm here.
    EXPECT_NEAR(reference.frames[i].signed_distance_mm, exact, 0.05);
    contacts += reference.frames[i].frame.contact;
  }
  EXPECT_GT(contacts, 700u);
}

TEST(MeshGodObject, RefusesWhatItCannotRender) {
  render::Registry registry;
  register_baseline_renderers(registry);
  render::SceneInput scene = scene_of(valley());
  scene.models[0].original_mesh.reset();
  Options original;
  original.set("mesh", "original");
  EXPECT_FALSE(registry.make("mesh-godobject", original).value()->prepare(scene, {}));
  const auto renderer = prepared(scene_of(valley()), "mesh-godobject:mesh=original");
  EXPECT_NE(dynamic_cast<MeshHolder*>(renderer.get())->mesh(0), nullptr);
}

}  // namespace
}  // namespace palpate::baselines
