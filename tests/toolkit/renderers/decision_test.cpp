// The numbers of a decision are those of what is built from it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/deformer.h"
#include "toolkit/deformation/moving_vertices.h"
#include "toolkit/heightfield/heightfield_model.h"
#include "toolkit/points/point_model.h"

namespace palpate::render {
namespace {

const std::vector<std::string> kModels = {"sphere:points=5000", "sinusoid:points=10201:jitter=0.4",
                                          "slab:points=4000:extent_mm=20:thickness_mm=1.6"};

PointModelOptions options_of(PartitionKind partition, BoxSize box, bool moving) {
  PointModelOptions o;
  o.partition = partition;
  o.box = box;
  o.moving = moving;
  o.spare_points = moving ? 100 : 0;
  o.cell_per_resolution = 0.0;
  o.swept_sphere = true;
  return o;
}

void expect_built(const ModelInput& input, const PointModelOptions& options) {
  PrepareReport unused, report;
  const auto survey = survey_points(*input.cloud, options, {1, nullptr}, unused);
  const auto built = build_point_model(*input.cloud, options, {1, nullptr}, report);
  ASSERT_TRUE(survey && built);
  const PointDecision& said = survey->decision;
  if (options.partition == PartitionKind::kGrid) {
    const double cell =
        options.moving ? std::get<partition::DynamicGrid>(built->tree).cell_mm() : built->grid.cell_mm();
    EXPECT_EQ(said.cell_mm, cell);
  }
  EXPECT_EQ(std::holds_alternative<std::monostate>(built->tree),
            options.partition == PartitionKind::kGrid && !options.moving);
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
    for (const PartitionKind kind : {PartitionKind::kGrid, PartitionKind::kOctree, PartitionKind::kQuadtree})
      for (const BoxSize box : {BoxSize::kGlobal, BoxSize::kPerVertex, BoxSize::kPerVertexCube})
        for (const bool moving : {false, true}) {
          SCOPED_TRACE(model);
          expect_built(generated(model).input.models[0], options_of(kind, box, moving));
        }
  expect_built(generated("sinusoid:points=10201").input.models[0], {.swept_sphere = true});
}

/// A grid doubles its cells where the cloud would span too many of them.
TEST(PointDecisions, KnowThatTheGridTakesLargerCells) {
  const SceneInput far = cloud_of({{0, 0, 0}, {0.001, 0, 0}, {0, 0.001, 0}, {1e5, 0, 0}, {1e5, 0.001, 0}});
  PointModelOptions o;
  o.resolution_mm = 0.001;
  o.swept_sphere = true;
  PrepareReport unused;
  EXPECT_GT(survey_points(*far.models[0].cloud, o, {1, nullptr}, unused)->decision.cell_mm, 0.005);
  expect_built(far.models[0], o);
}

TEST(PointDecisions, ADeformersBytesAreKnown) {
  PrepareReport report;
  const Scene scene = generated("sphere:points=5000");
  PointBody body =
      build_point_body(scene.input.models[0], options_of(PartitionKind::kGrid, BoxSize::kGlobal, true),
                       {1, nullptr}, report)
          .value();
  const DeformerRoom room{100, 1000};
  const std::size_t points = body.moving->points.size();
  MovingVertices moving(*body.moving, body.surface, room.spare_points);
  EXPECT_EQ(Deformer(moving, room.journal_points).bytes(),
            Deformer::bytes_for(points, room) + MovingVertices::bytes_for(points, room.journal_points));
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
    const HeightFieldBuild build{fills, !fills, 0.0};
    PrepareReport report;
    const auto decided = decide_heights(input, build);
    const auto built = build_height_field_model(input, build, {1, nullptr}, report);
    ASSERT_TRUE(decided && built);
    const LatticeDecision& said = decided->lattice;
    EXPECT_EQ(said.posts(), built->field().posts());
    EXPECT_EQ(said.posts(), 10201u);
    EXPECT_GE(said.missing, 900u);
    EXPECT_EQ(said.missing - said.filled, built->field().holes);
    EXPECT_EQ(said.filled > 0, fills);
    EXPECT_EQ(said.plan_resolution_mm, built->field().plan_resolution_mm());
    ModelDecisions out;
    say_heights(input, build, *decided, kAllOfRigidSurfaces, out);
    EXPECT_EQ(out.bytes, report.bytes);
  }
}

}  // namespace
}  // namespace palpate::render
