#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

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

// Mesh renderers in scenes: several models, moving ones, properties that vary, friction, thin things.

namespace {

using test::expect_near;
using test::kStiffness;
using test::Probe;

constexpr double kRadius = 0.25;
constexpr const char* kPoint = "mesh-godobject:mesh=original";
constexpr const char* kSkin = "mesh-proxy:mesh=original:radius_mm=0.25";
constexpr const char* kCentre = "mesh-proxy:mesh=original:radius_mm=0.25:tip=centre";

render::ModelInput box_at(const Vec3& half, const geometry::RigidTransform& pose) {
  render::ModelInput model =
      test::model_of(test::subdivided(test::box_mesh(half.x(), half.y(), half.z()), 2));
  model.world_from_model = pose;
  return model;
}

geometry::RigidTransform shifted(const Vec3& by) {
  return {Eigen::Quaterniond::Identity(), by};
}

/// A floor z < 0, and walls x < 0 and y < 0 where asked for, as models of their own.
render::SceneInput room(int models) {
  render::SceneInput scene;
  const Vec3 half{10, 10, 10};
  scene.models.push_back(box_at(half, shifted({5.3, 5.1, -10})));
  if (models > 1) scene.models.push_back(box_at(half, shifted({-10, 5.2, 5.4})));
  if (models > 2) scene.models.push_back(box_at(half, shifted({5.5, -10, 5.6})));
  return scene;
}

TEST(MeshScene, TwoModelsHoldInTheirEdgeAndThreeInTheirCorner) {
  const Vec3 hip{-0.6, -0.8, -0.5};
  for (const int models : {1, 2, 3}) {
    const Vec3 corner{models > 1 ? 0.0 : hip.x(), models > 2 ? 0.0 : hip.y(), 0.0};
    const Vec3 start{2, models > 2 ? 2.0 : hip.y(), 2};
    for (const char* options : {kPoint, kSkin, kCentre}) {
      SCOPED_TRACE(options);
      Probe probe = test::prepare(room(models), options);
      const render::Frame frame = probe.press(start, hip, 0.05);
      Vec3 expected = corner;
      if (options != kPoint) {  // the centre, and from there a radius towards the HIP
        const Vec3 centre = corner + kRadius * Vec3(models > 1, models > 2, 1);
        expected = options == kCentre ? centre : Vec3(centre + kRadius * (hip - centre).normalized());
      }
      test::expect_held(frame, expected, 1e-9);
      expect_near(frame.force_n, kStiffness * (expected - hip), 1e-9);
    }
  }
}

// Eleven blocks, their tops one above the other: the deepest eight answer, and the frame says so.
TEST(MeshScene, OfMoreThanEightTouchedTheDeepestAnswer) {
  render::SceneInput scene;
  for (int i = 0; i < 11; ++i)
    scene.models.push_back(box_at({10, 10, 10}, shifted({0.1 * i, 0.3, -10 + 0.05 * i})));
  const Vec3 start{0.1, 0.3, 4}, hip{0.05, 0.3, -1};
  Probe probe = test::prepare(scene, kPoint);
  const render::Frame frame = probe.press(start, hip, 0.05);
  ASSERT_TRUE(frame.contact);
  expect_near(frame.force_n, Vec3(0, 0, kStiffness * 1.5), 1e-9);
  EXPECT_EQ(frame.model, 10);
  EXPECT_EQ(frame.status, render::FrameStatus::kBoundHit);
}

// Two blocks lean towards each other: the sum of their pushes is too much, jointly they hold the nearest
// place outside of both.
TEST(MeshScene, JointContactIsOutsideOfAllAndTheSumIsNot) {
  render::SceneInput scene;
  for (const double angle : {0.5, -0.5}) {  // of the top faces, towards the valley
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(-angle, Vec3::UnitY()));
    scene.models.push_back(box_at({10, 10, 10}, {turn, turn * Vec3(0, 0, -10)}));
  }
  // Both tops go through the origin; their normals are (-+ sin 0.5, 0, cos 0.5).
  const Vec3 start{0.1, 0.3, 4}, hip{0.05, 0.3, -1};
  Probe joint = test::prepare(scene, kPoint);
  const render::Frame frame = joint.press(start, hip, 0.02);
  expect_near(frame.god_object_mm, {0, 0.3, 0}, 1e-9);
  expect_near(frame.force_n, kStiffness * (Vec3(0, 0.3, 0) - hip), 1e-9);
  Probe sum = test::prepare(scene, "mesh-godobject:mesh=original:combine=sum");
  // Each pushes by its depth along its normal: together 2 cos^2(0.5) = 1.54 times upwards.
  EXPECT_NEAR(sum.press(start, hip, 0.02).force_n.z(), 2 * kStiffness * std::pow(std::cos(0.5), 2), 1e-6);
}

// Two curved models, one mesh: the joint rest is outside of both and cannot be bettered nearby.
TEST(MeshScene, CurvedModelsMeetInAValley) {
  const auto ball = test::height_mesh(200, 10.0, [](double x, double y) { return -0.05 * (x * x + y * y); });
  render::SceneInput scene;
  for (const double side : {1.0, -1.0}) {
    scene.models.push_back(test::model_of(ball));
    scene.models.back().world_from_model = {Eigen::Quaterniond(Eigen::AngleAxisd(side * -0.7, Vec3::UnitY())),
                                            Vec3(side * 3.0, 0, 0)};
  }
  for (const char* options : {kPoint, kCentre}) {
    Probe probe = test::prepare(scene, options);
    std::vector<Probe> alone;
    for (const auto& model : scene.models) alone.push_back(test::prepare(model, options));
    const Vec3 start{0.1, 0.4, 6}, hip{0.2, 0.5, -4.5};
    render::Frame frame = probe.press(start, hip, 0.02);
    for (int i = 0; i < 5; ++i) frame = probe.to(hip);
    ASSERT_TRUE(frame.contact);
    // Each model alone lets a probe at that place stay there, but for curvature's second order that is left.
    for (Probe& one : alone) {
      const Vec3 there = one.press(start, frame.god_object_mm, 0.02).god_object_mm;
      expect_near(there, frame.god_object_mm, 2e-3);
    }
    EXPECT_GT(frame.force_n.z(), 0.0);
  }
}

// A thousand models answer what the one that is touched answers alone, bit for bit.
TEST(MeshScene, FarModelsChangeNothing) {
  render::SceneInput one, many;
  one.models.push_back(box_at({5, 5, 5}, shifted({0.1, 0.2, 0.3})));
  many.models = one.models;
  for (int i = 0; i < 999; ++i) {
    many.models.push_back(one.models[0]);
    many.models.back().world_from_model.translation_mm +=
        Vec3(30.0 * (1 + i % 10), 30.0 * (i / 10 % 10), 30.0 * (i / 100));
  }
  for (const char* options : {kPoint, kSkin}) {
    Probe few = test::prepare(one, options), crowd = test::prepare(many, options);
    few.renderer->restart({0, 0, 20});
    crowd.renderer->restart({0, 0, 20});
    std::size_t touched = 0;
    for (int i = 0; i < 4000; ++i) {
      const double t = i * 1e-3;
      const Vec3 hip{7 * std::sin(3 * t), 7 * std::sin(2 * t + 1), 12 * std::cos(8 * t)};
      const render::Frame a = few.to(hip), b = crowd.to(hip);
      touched += a.contact;
      ASSERT_EQ(a.contact, b.contact) << i;
      ASSERT_LT((a.god_object_mm - b.god_object_mm).norm(), 1e-12) << i;
      ASSERT_LT((a.force_n - b.force_n).norm(), 1e-12) << i;
    }
    EXPECT_GT(touched, 500u);
    // And the neighbour is met where the HIP goes there.
    EXPECT_TRUE(crowd.press({30.1, 0, 20}, {30.1, 0, 5}, 1.0).contact);
  }
}

TEST(MeshScene, AModelThatMovesMeetsAHipThatRests) {
  for (const char* options : {kPoint, kSkin}) {
    auto simulation = std::make_shared<render::ScriptedSimulation>();
    render::SceneInput scene;
    scene.models.push_back(box_at({5, 5, 5}, shifted({0, 0, -10})));
    render::ScriptedMotion motion;
    motion.start = shifted({0, 0, -10});
    motion.velocity_mm_s = {0, 0, 20};
    scene.models[0].motion = simulation->add(motion);
    scene.simulation = simulation;
    Probe probe = test::prepare(scene, options);
    probe.renderer->drive(simulation);
    probe.renderer->restart({0.3, 0.2, 1});
    render::Frame frame;
    for (int i = 0; i < 400; ++i) frame = probe.to({0.3, 0.2, 1});
    // After 0.4 s the top is at -10 + 8 + 5 = 3.
    test::expect_held(frame, {0.3, 0.2, 3.0}, 1e-6);
  }
}

/// A plane whose stiffness and friction rise with x from point to point.
render::SceneInput graded_plane(bool friction) {
  render::SceneInput scene;
  scene.models.push_back(test::model_of(test::flat_mesh(40, 10.0)));
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < scene.models[0].cloud->size(); ++i) {
    const double x = scene.models[0].cloud->point_mm(i).x();
    properties->stiffness_n_per_mm.push_back(static_cast<float>(0.5 + 0.02 * x));
    if (friction) properties->static_friction.push_back(static_cast<float>(0.5 + 0.03 * x));
  }
  scene.models[0].surface.per_point = properties;
  return scene;
}

TEST(MeshScene, PropertiesAreInterpolatedOverFacets) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(false), options);
    probe.renderer->restart({-7, 0.3, 1});
    for (double x = -7; x < 7; x += 0.0371) {
      const render::Frame frame = probe.to({x, 0.3, -1});
      ASSERT_TRUE(frame.contact);
      ASSERT_NEAR(frame.force_n.z(), 0.5 + 0.02 * x, 1e-6) << x;
      // The potential's part along the surface: -d^2 / 2 of the stiffness's slope.
      ASSERT_NEAR(frame.force_n.x(), -0.5 * 0.02, 1e-6) << x;
    }
  }
}

TEST(MeshScene, FrictionFollowsItsConeAndItsPlace) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(true), options);
    probe.press({-7, 0.3, 1}, {-7, 0.3, -1}, 0.05);
    // The coefficient is read at the frictionless contact: at every place of the slip the ratio is its own.
    for (double x = -7; x < 7; x += 0.05) {
      const render::Frame frame = probe.to({x, 0.3, -1});
      if (x < -5.5) continue;  // sticks at first
      const double gradient = -0.5 * 0.02 * (1 + std::pow(0.5 + 0.03 * x, 2));
      ASSERT_NEAR((frame.force_n.x() - gradient) / frame.force_n.z(), -(0.5 + 0.03 * x), 2e-3) << x;
    }
  }
  // Uniform friction on tilted ground: in slip exactly dynamic x normal, on a facet's plane.
  render::SceneInput tilted;
  tilted.models.push_back(
      test::model_of(test::height_mesh(30, 10.0, [](double x, double) { return 0.5 * x; })));
  tilted.models[0].surface.friction = {0.7, 0.4};
  const Vec3 n = Vec3(-0.5, 0, 1).normalized();
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(tilted, options);
    probe.press({0, -5, 3}, {0.2, -5, -1}, 0.05);
    const render::Frame frame = probe.glide({0.2, -5, -1}, {0.2, 5, -1}, 0.05);
    const double normal = n.dot(frame.force_n);
    EXPECT_NEAR((frame.force_n - normal * n).norm(), 0.4 * normal, 1e-9);
  }
}

// Without friction a closed way over stiffness that varies gives no work.
TEST(MeshScene, VaryingStiffnessMakesNoEnergy) {
  for (const char* options : {kPoint, kSkin}) {
    Probe probe = test::prepare(graded_plane(false), options);
    probe.press({5, 0, 1}, {5, 0, -1}, 0.05);
    double work = 0.0, moved = 0.0;
    constexpr int kSteps = 20'000;
    const auto at = [](int i) {
      const double t = 2 * 3.14159265358979323846 * i / kSteps;
      return Vec3(5 * std::cos(t), 5 * std::sin(t), -1 - 0.5 * std::sin(3 * t));
    };
    Vec3 force = probe.to(at(0)).force_n;
    for (int i = 1; i <= kSteps; ++i) {
      const Vec3 next = probe.to(at(i)).force_n;
      const double part = 0.5 * (force + next).dot(at(i) - at(i - 1));
      work += part;
      moved += std::abs(part);
      force = next;
    }
    EXPECT_LT(std::abs(work), 1e-4 * moved);
  }
}

// Thin slabs at any speed and slant: the god object of a HIP beyond is on the face that it came in by.
TEST(MeshScene, NothingPassesThinSlabs) {
  constexpr std::uint64_t kSeed = 5;
  Random random(kSeed);
  for (const double thickness : {1.0, 0.3, 0.1, 0.03, 0.01}) {
    const auto slab = test::subdivided(test::box_mesh(20, 20, thickness / 2), 3);
    for (const std::string options :
         {kPoint, kSkin, "mesh-proxy:mesh=original:radius=0.01", "mesh-proxy:mesh=original:radius_mm=1e-4",
          "mesh-proxy:mesh=original:radius_mm=0.1", "mesh-proxy:mesh=original:radius_mm=1"}) {
      Probe probe = test::make(slab, options);
      for (const double step : {0.005, 0.05, 0.5, 1.0, 5.0})
        for (int i = 0; i < 20; ++i) {
          SCOPED_TRACE(testing::Message()
                       << options << ", " << thickness << ", " << step << ", seed " << kSeed);
          const double side = i % 2 == 0 ? 1.0 : -1.0;
          const Vec3 from{random.uniform(-10, 10), random.uniform(-10, 10), 3 * side};
          const Vec3 to{random.uniform(-10, 10), random.uniform(-10, 10), -2.5 * side};
          probe.press(from, to, step);
          for (int k = 0; k < 49; ++k) (void)probe.to(to);
          test::expect_held(probe.to(to), {to.x(), to.y(), side * thickness / 2}, 1e-8);
        }
    }
  }
}

}  // namespace

}  // namespace palpate::baselines
