// Height fields with posts that have no point: over gaps the surface goes on, over voids there is none.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/heightfield/heightfield_model.h"
#include "toolkit/points/point_model.h"

namespace palpate::render {
namespace {

using cloud::at_random;
using cloud::box;
using cloud::Gone;
constexpr std::size_t kColumns = 60, kRows = 50;

/// How a sheet of posts lies in the world.
struct Lie {
  double scale = 1.0;   ///< of everything
  double step_y = 1.0;  ///< columns are one apart
  Vec3 corner = Vec3::Zero();
  geometry::RigidTransform pose;
};

double wave(double x, double y) {
  return 2.0 * std::cos(0.1 * x) * std::cos(0.1 * y);
}

SceneInput sheet(const Gone& gone, const Lie& lie = {}) {
  std::vector<Vec3> points;
  for (std::size_t row = 0; row < kRows; ++row)
    for (std::size_t column = 0; column < kColumns; ++column) {
      if (gone(column, row)) continue;
      const double x = static_cast<double>(column), y = lie.step_y * static_cast<double>(row);
      points.push_back(lie.scale * (lie.corner + Vec3(x, y, wave(x, y / lie.step_y))));
    }
  SceneInput scene = cloud_of(points);
  scene.models[0].surface.stiffness_n_per_mm = 1.0 / lie.scale;
  scene.models[0].world_from_model = lie.pose;
  return scene;
}

bool nothing(std::size_t, std::size_t) {
  return false;
}

const std::map<std::string, Gone>& patterns() {
  static const std::map<std::string, Gone> all = {
      {"5 %", at_random(0.05, 3)},
      {"30 %", at_random(0.3, 4)},
      {"70 %", at_random(0.7, 5)},
      {"clusters", [](std::size_t c, std::size_t r) { return c % 14 >= 5 && c % 14 < 10 && r % 13 < 5; }},
      {"a row", [](std::size_t, std::size_t r) { return r == 20; }},
      {"a column", [](std::size_t c, std::size_t) { return c == 31; }},
      {"a chessboard", [](std::size_t c, std::size_t r) { return (c + r) % 2 == 1; }},
      {"at the border", [](std::size_t c, std::size_t r) {
         return (r == 0 || r == kRows - 1 || c == 0 || c == kColumns - 1) && (c + r) % 3 == 1 && c + r > 1 &&
                c + r < kColumns + kRows - 3;
       }}};
  return all;
}

/// In and out of the sheet while crossing it, the k-th of `frames`: world frame.
Vec3 place(int k, const Lie& lie) {
  const double t = 0.001 * k;
  const double x = 29.5 + 26.0 * std::sin(2.3 * t), y = 24.5 + 21.0 * std::sin(3.7 * t + 0.4);
  const double over = 0.5 * std::cos(31.0 * t) - 0.3;
  return lie.pose * Vec3(lie.scale * (lie.corner + Vec3(x, lie.step_y * y, wave(x, y) + over)));
}

/// Frames of both along one path: how many contacts differ, and by how much the forces do at most.
struct Difference {
  int contacts = 0, contact_frames = 0;
  double force = 0.0;
};
Difference along_the_path(const test::Stepped& a, const test::Stepped& b, const Lie& lie) {
  constexpr int kFrames = 8000;
  Difference found;
  a->restart(place(0, lie));
  b->restart(place(0, lie));
  for (int k = 0; k < kFrames; ++k) {
    const Frame one = a->step(place(k, lie), 1e-3), other = b->step(place(k, lie), 1e-3);
    found.contacts += one.contact != other.contact;
    found.contact_frames += one.contact;
    if (one.contact && other.contact)
      found.force = std::max(found.force, (one.force_n - other.force_n).norm());
  }
  return found;
}

struct Laid {
  std::string name;
  Gone gone;
  Lie lie;
};

TEST(HeightFieldHoles, AGapIsFeltAsTheSurfaceWhateverItsScaleAspectPlaceAndPose) {
  geometry::RigidTransform turned;
  turned.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  turned.translation_mm = {10.0, -3.0, 2.0};
  const Gone third = patterns().at("30 %");
  std::vector<Laid> all = {{"small", third, {1e-3, 1.0, Vec3::Zero(), {}}},
                           {"large", third, {1e6, 1.0, Vec3::Zero(), {}}},
                           {"long", third, {1.0, 3.0, Vec3::Zero(), {}}},
                           {"far", third, {1.0, 1.0, {4e5, -7e5, 1e4}, {}}},
                           {"turned", third, {1.0, 1.0, Vec3::Zero(), turned}}};
  for (const auto& [name, gone] : patterns()) all.push_back({name, gone, {}});
  for (const Laid& laid : all) {
    SCOPED_TRACE(laid.name);
    const auto whole = prepared(sheet(nothing, laid.lie), "heightfield");
    const auto holed = prepared(sheet(laid.gone, laid.lie), "heightfield");
    const Difference found = along_the_path(whole, holed, laid.lie);
    EXPECT_GT(found.contact_frames, 4000);
    // Heights differ by at most 0.02 (five of the wave's in AFilledWaveIsTheWave), at 0.03 mm a frame.
    EXPECT_LE(found.contacts, laid.name == "70 %" ? 40 : 10);
    EXPECT_LT(found.force, 0.03) << "of up to 0.8 N";
    EXPECT_EQ(holed->counters().edges, 0u);
  }
}

TEST(HeightFieldHoles, JitteredHeightsAreBridged) {
  const auto renderer =
      prepared(cloud_of(cloud::posts(kColumns, kRows, 1.0,
                                     cloud::without(patterns().at("30 %"), cloud::rough(0.5, 8)))),
               "heightfield");
  Random random(3);
  for (int i = 0; i < 500; ++i) {
    const double x = random.uniform(1.0, kColumns - 2.0), y = random.uniform(1.0, kRows - 2.0);
    renderer->restart({x, y, 3.0});
    EXPECT_FALSE(renderer->step({x, y, 2.0}, 1e-3).contact);
    ASSERT_TRUE(renderer->step({x, y, -1.0}, 1e-3).contact) << x << " " << y;
  }
}

TEST(HeightFieldHoles, AGapHasTheSurfaceOfItsNearestPoint) {
  SceneInput scene = cloud_of(cloud::posts(kColumns, kRows, 1.0, cloud::without(box(28, 24, 5, 1))));
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < scene.models[0].cloud->size(); ++i) {
    const bool left = scene.models[0].cloud->point_mm(i).x() < 29.5;
    properties->static_friction.push_back(left ? 0.6f : 0.2f);
    properties->dynamic_friction.push_back(left ? 0.6f : 0.2f);
    properties->stiffness_n_per_mm.push_back(0.25f);
  }
  scene.models[0].surface.stiffness_n_per_mm = 4.0;
  scene.models[0].surface.per_point = properties;
  const auto renderer = prepared(scene, "heightfield");
  for (const auto& [x, friction] : {std::pair{28.0, 0.6}, std::pair{32.0, 0.2}}) {
    renderer->restart({x, 23.0, 1.0});
    (void)renderer->step({x, 23.0, 1.0}, 1e-3);
    Frame frame;
    for (int k = 0; k <= 100; ++k) frame = renderer->step({x, 23.0 + 0.01 * k, -1.0}, 1e-3);
    EXPECT_NEAR(frame.force_n.z(), 0.25, 1e-6) << x;
    EXPECT_NEAR(frame.force_n.y(), -0.25 * friction, 1e-6) << x;
  }
}

TEST(HeightFieldHoles, AVoidIsFreeSpaceAndSaid) {
  const test::Stepped renderer = renderer_of("heightfield");
  const PrepareReport report = renderer->prepare(sheet(box(20, 20, 12, 10)), {1, nullptr}).value();
  EXPECT_TRUE(test::contains(report.notes.back(), "120 of them without a point"));
  ASSERT_EQ(report.warnings.size(), 1u);
  EXPECT_TRUE(test::contains(report.warnings[0], "over 120 posts"));
  renderer->restart({26, 25, 5});
  EXPECT_FALSE(renderer->step({26, 25, -5}, 1e-3).contact) << "through the void";
  EXPECT_FALSE(renderer->step({10, 25, -5}, 1e-3).contact) << "under the sheet";
  EXPECT_EQ(renderer->counters().edges, 1u);
}

TEST(HeightFieldHoles, WhatIsStrewnThinlyIsRefusedWithARemedy) {
  for (const char* name : {"heightfield", "heightfield-literal"}) {
    const auto report = prepare_report(sheet(at_random(0.92, 5)), name);
    ASSERT_TRUE(test::refused(report, "one post in 16")) << name;
    EXPECT_TRUE(test::contains(report.error().remedy, "cloud"));
  }
}

// What is printed knows nothing of missing posts: over one nothing is felt, and it is counted.
TEST(HeightFieldHoles, ToTheLetterTheHipFallsThroughAndIsCounted) {
  for (const char* name : {"heightfield-literal", "heightfield-literal:response=lookup"}) {
    SCOPED_TRACE(name);
    const auto holed = prepared(sheet(box(30, 24, 1, 1)), name);
    const auto whole = prepared(sheet(nothing), name);
    EXPECT_FALSE(holed->step({30.2, 24.1, -3}, 1e-3).contact);
    EXPECT_EQ(holed->counters().edges, 1u);
    EXPECT_FALSE(holed->step({29.8, 24.1, -3}, 1e-3).contact) << "still there";
    EXPECT_EQ(holed->counters().edges, 1u);
    EXPECT_FALSE(holed->step({30.2, 24.1, 3}, 1e-3).contact) << "and out";
    EXPECT_FALSE(holed->step({30.2, 24.1, -3}, 1e-3).contact);
    EXPECT_EQ(holed->counters().edges, 2u);
    // Elsewhere as on a whole sheet, to the last bit.
    holed->restart({});
    for (int k = 0; k < 2000; ++k) {
      const Vec3 hip = place(k, {}) - Vec3(0, 0, 1);
      if (std::hypot(hip.x() - 30, hip.y() - 24) < 6.0) continue;
      const Frame one = holed->step(hip, 1e-3), other = whole->step(hip, 1e-3);
      ASSERT_EQ(one.contact, other.contact);
      ASSERT_EQ(one.force_n, other.force_n);
    }
  }
}

TEST(HeightFieldHoles, WhoFallsThroughIsWarned) {
  const auto warnings = [&](const std::string& spec, const Gone& gone) {
    return prepare_report(sheet(gone), spec)->warnings;
  };
  const Gone gone = patterns().at("5 %");
  EXPECT_TRUE(warnings("heightfield", gone).empty());
  EXPECT_TRUE(warnings("heightfield-literal", nothing).empty());
  for (const char* open : {"heightfield:holes=open", "heightfield-literal"}) {
    ASSERT_EQ(warnings(open, gone).size(), 1u) << open;
    EXPECT_TRUE(test::contains(warnings(open, gone)[0], "holes=fill")) << open;
  }
}

// Friction and texture on height fields: the shared stage, read from the posts.

constexpr std::size_t kSide = 41;
constexpr double kStiffness = 0.5;

/// A plane of the given slope in x, posts 0.25 mm apart.
SceneInput tilted(double slope) {
  SceneInput scene = cloud_of(cloud::posts(kSide, kSide, 0.25, [&](std::size_t column, std::size_t) {
    return slope * 0.25 * static_cast<double>(column);
  }));
  scene.models[0].surface.stiffness_n_per_mm = kStiffness;
  return scene;
}

test::Stepped stepped_field(const SceneInput& scene) {
  return prepared(scene, "heightfield");
}

TEST(HeightFieldSurface, SlipHasTheDynamicCoefficientStickDoesNotDrift) {
  for (const double slope : {0.0, 0.75}) {
    SceneInput scene = tilted(slope);
    scene.models[0].surface.friction = {0.5, 0.3};
    const auto renderer = stepped_field(scene);
    const Vec3 normal = Vec3(-slope, 0.0, 1.0).normalized(), along = Vec3(1.0, 0.0, slope).normalized();
    const Vec3 start = Vec3(3.0, 5.0, slope * 3.0) - normal;
    renderer->restart(start + 3.0 * normal);
    for (int i = 60; i >= 0; --i) (void)renderer->step(start + 0.05 * i * normal, 1e-3);
    Frame frame;
    for (int i = 0; i < 400; ++i) frame = renderer->step(start + 0.01 * i * along, 1e-3);
    const double push = frame.force_n.dot(normal), drag = -frame.force_n.dot(along);
    EXPECT_NEAR(push, kStiffness, 1e-4);
    EXPECT_NEAR(drag / push, 0.3, 1e-4);
    // Back a little: it sticks, and stays where it is, to the bit.
    const Vec3 rest = start + 3.8 * along;
    const Vec3 held = renderer->step(rest, 1e-3).god_object_mm;
    for (int i = 0; i < 6000; ++i) frame = renderer->step(rest, 1e-3);
    EXPECT_EQ(frame.god_object_mm, held);
  }
}

TEST(HeightFieldSurface, ALiteralGodObjectIsRolledBack) {
  SceneInput scene = tilted(0.0);
  scene.models[0].surface.friction = {1.0, 1.0};
  const auto renderer = prepared(scene, "heightfield-literal");
  renderer->restart({3.0, 5.0, 1.0});
  (void)renderer->step({3.0, 5.0, -1.0}, 1e-3);
  const Frame frame = renderer->step({5.0, 5.0, -1.0}, 1e-3);
  EXPECT_NEAR(frame.god_object_mm.x(), 4.0, 1e-6) << "one depth behind the HIP";
}

// The numbers of a decision are those of what is built from it.

const std::vector<std::string> kModels = {"sphere:points=5000", "sinusoid:points=10201:jitter=0.4",
                                          "slab:points=4000:extent_mm=20:thickness_mm=1.6"};

points::PointModelOptions options_of(points::PartitionKind partition, points::BoxSize box) {
  points::PointModelOptions o;
  o.partition = partition;
  o.box = box;
  o.cell_per_resolution = 0.0;
  o.swept_sphere = true;
  return o;
}

void expect_built(const ModelInput& input, const points::PointModelOptions& options) {
  PrepareReport unused, report;
  const auto survey = points::survey_points(*input.cloud, options, {1, nullptr}, unused);
  const auto built = points::build_point_model(*input.cloud, options, {1, nullptr}, report);
  ASSERT_TRUE(survey && built);
  const points::PointDecision& said = survey->decision;
  if (options.partition == points::PartitionKind::kGrid) {
    EXPECT_EQ(said.cell_mm, built->grid.cell_mm());
  }
  EXPECT_EQ(std::holds_alternative<std::monostate>(built->tree),
            options.partition == points::PartitionKind::kGrid);
  Vec3 largest = built->global_half_box_mm;
  if (!built->half_box_mm.empty()) {
    largest = Vec3::Zero();
    for (const Vec3f& half : built->half_box_mm) largest = largest.cwiseMax(half.cast<double>());
  }
  EXPECT_EQ(said.largest_half_box_mm, largest);
  EXPECT_EQ(said.sphere_mm, largest.maxCoeff());
  if (!said.from_scan) return;
  // No link was mended: those stored are those measured.
  double spacing_sq = 0.0;
  for (std::size_t place = 0; place < built->points.size(); ++place)
    for (const std::uint32_t other : built->neighbours[place])
      spacing_sq =
          std::max(spacing_sq, (built->points[other].at() - built->points[place].at()).squaredNorm());
  EXPECT_NEAR(said.max_spacing_mm, std::sqrt(spacing_sq), 1e-6 * said.max_spacing_mm);
}

TEST(PointDecisions, AreFollowed) {
  for (const std::string& model : kModels)
    for (const points::PartitionKind kind :
         {points::PartitionKind::kGrid, points::PartitionKind::kOctree, points::PartitionKind::kQuadtree})
      for (const points::BoxSize box :
           {points::BoxSize::kGlobal, points::BoxSize::kPerVertex, points::BoxSize::kPerVertexCube}) {
        SCOPED_TRACE(model);
        expect_built(generated(model).input.models[0], options_of(kind, box));
      }
  expect_built(generated("sinusoid:points=10201").input.models[0], {.swept_sphere = true});
}

/// A grid doubles its cells where the cloud would span too many of them.
TEST(PointDecisions, KnowThatTheGridTakesLargerCells) {
  const SceneInput far = cloud_of({{0, 0, 0}, {0.001, 0, 0}, {0, 0.001, 0}, {1e5, 0, 0}, {1e5, 0.001, 0}});
  points::PointModelOptions o;
  o.resolution_mm = 0.001;
  o.swept_sphere = true;
  PrepareReport unused;
  EXPECT_GT(points::survey_points(*far.models[0].cloud, o, {1, nullptr}, unused)->decision.cell_mm, 0.005);
  expect_built(far.models[0], o);
}

/// Every 7th point is gone, a square of 30 x 30 posts too.
ModelInput holed() {
  const Scene scene = generated("sinusoid:points=10201");
  const cloud::Cloud& whole = *scene.input.models[0].cloud;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const std::size_t column = i % 101, row = i / 101;
    if (i % 7 != 3 && !(column > 40 && column <= 70 && row > 40 && row <= 70))
      points.push_back(whole.point_mm(i));
  }
  return cloud_of(points).models[0];
}

TEST(HeightFieldDecisions, AreFollowed) {
  const ModelInput input = holed();
  for (const bool fills : {true, false}) {
    const heightfield::HeightFieldOptions build{fills, !fills, 0.0};
    PrepareReport report;
    const auto decided = heightfield::decide_heightfield(input, build);
    const auto built = heightfield::build_height_field_model(input, build, {1, nullptr}, report);
    ASSERT_TRUE(decided && built);
    const heightfield::LatticeDecision& said = decided->lattice;
    EXPECT_EQ(said.posts(), built->field().posts());
    EXPECT_EQ(said.posts(), 10201u);
    EXPECT_GE(said.missing, 900u);
    EXPECT_EQ(said.missing - said.filled, built->field().holes);
    EXPECT_EQ(said.filled > 0, fills);
    EXPECT_EQ(said.plan_resolution_mm, built->field().plan_resolution_mm());
    ModelDecisions out;
    heightfield::describe_heightfield(input, build, *decided, kAllOfRigidSurfaces, out);
    EXPECT_EQ(out.bytes, report.bytes);
  }
}

}  // namespace
}  // namespace palpate::render
