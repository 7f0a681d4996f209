#include "toolkit/points/point_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

#include <palpate/model_store.h>
#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/knn.h"

namespace palpate::points {

using namespace render;

namespace {

void partition_points(const cloud::Cloud& cloud, const PointDecision& decided, int threads,
                      PointModel& model) {
  search::PartitionOptions o;
  o.cell_mm = decided.cell_mm;
  switch (decided.partition) {
    case PartitionKind::kGrid:
      model.grid = search::UniformGrid::build(cloud, o, threads);
      break;
    case PartitionKind::kOctree:
      model.tree = search::Octree::build(cloud, o, threads);
      break;
    case PartitionKind::kQuadtree:
      model.tree = search::Quadtree3d::build(cloud, o, threads);
      break;
  }
}

std::span<const std::uint32_t> order_of(const PointModel& model) {
  return with_partition(model, [](const auto& p) { return std::span<const std::uint32_t>(p.order()); });
}

std::string shape_note(const PointModel& model, PartitionKind kind) {
  const search::LeafStatistics shape = with_partition(model, [](const auto& p) { return p.statistics(); });
  if (kind == PartitionKind::kGrid)
    return fmt::format("{} cells, at most {} points a cell", shape.leaves, shape.max_points);
  return fmt::format("{} of {} leaves in {} nodes, at most {} points a leaf, {} deep",
                     kind == PartitionKind::kOctree ? "octree" : "quadtree", shape.leaves, shape.nodes,
                     shape.max_points, shape.max_depth);
}

void fill_points(const cloud::Cloud& cloud, const search::NeighbourTable& table, const PointDecision& decided,
                 int threads, PointModel& model) {
  const std::size_t n = cloud.size();
  const auto order = order_of(model);
  std::vector<std::uint32_t> place_of(n);
  parallel_each(n, kPointsPerChunk, threads,
                [&](std::size_t place) { place_of[order[place]] = static_cast<std::uint32_t>(place); });
  model.points.resize(n);
  model.neighbours.resize(n);
  if (decided.box != BoxSize::kGlobal) model.half_box_mm.resize(n);
  parallel_each(n, kPointsPerChunk, threads, [&](std::size_t place) {
    const std::uint32_t i = order[place];
    model.points[place] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], surface::kNoNormal};
    Vec3 half = Vec3::Zero();
    for (std::size_t k = 0; k < search::kNeighbours; ++k) {
      const std::uint32_t other = table.of[i][k];
      model.neighbours[place][k] = place_of[other];
      half = half.cwiseMax((cloud.local_mm(other) - cloud.local_mm(i)).cwiseAbs());
    }
    if (decided.box == BoxSize::kPerVertexCube) half.setConstant(half.maxCoeff());
    if (decided.box != BoxSize::kGlobal)
      for (int axis = 0; axis < 3; ++axis) model.half_box_mm[place][axis] = stored_half_box(half[axis]);
  });
}

}  // namespace

std::vector<OptionSpec> point_model_specs(bool complete_to_eight) {
  std::vector<std::string> names = {"auto"};
  for (const search::NeighbourBuilder& builder : search::neighbour_builders()) names.push_back(builder.name);
  return {
      option::choice("neighbours", "auto",
                     "how neighbours are found; auto: the scanner's path where the cloud is a raster",
                     std::move(names)),
      option::flag("complete", complete_to_eight ? "true" : "false",
                   "modified kNN completes to eight neighbours; false: as printed, which finds fewer where "
                   "its cubes do",
                   {{"neighbours", {"auto", "modified-knn"}}}),
      option::choice("box", "global", "vertex boxes: one size, or per vertex",
                     {"global", "per-vertex", "per-vertex-cube"}),
      option::number("box_mm", "0", "edge of the global box in mm; 0: the cloud's resolution", 0.0, 1e12,
                     {{"box", {"global"}}}),
      option::number("resolution_mm", "0", "the cloud's resolution in mm; 0: measured", 0.0, 1e12),
      option::number("cell", "5",
                     "grid cell edge in resolutions; 0: five times the median local resolution, at least "
                     "half the cloud's",
                     0.0, 1000.0),
  };
}

std::vector<OptionSpec> box_test_specs() {
  return {
      option::choice(
          "test", "box",
          "vertex boxes against the probe's segment (box) or a sphere swept along it (3.1.4's second remedy)",
          {"box", "swept-sphere"}),
      option::number("sphere_mm", "0", "radius of the swept sphere in mm; 0: half a box's edge", 0.0, 1e12,
                     {{"test", {"swept-sphere"}}}),
  };
}

OptionSpec partition_spec() {
  return option::choice(
      "partition", "grid",
      "how boxes near the probe are found: uniform grid, octree of ten points a leaf, or 3D quadtree",
      {"grid", "octree", "quadtree"});
}

std::size_t PointModel::partition_bytes() const noexcept {
  return with_partition(*this, [](const auto& p) { return p.bytes(); });
}

PointModelOptions point_model_options(const Options& options) {
  PointModelOptions o;
  o.neighbours = options.text("neighbours");
  o.complete_to_eight = options.flag("complete");
  const std::string& box = options.text("box");
  o.box = box == "global"       ? BoxSize::kGlobal
          : box == "per-vertex" ? BoxSize::kPerVertex
                                : BoxSize::kPerVertexCube;
  o.box_mm = options.number("box_mm");
  o.resolution_mm = options.number("resolution_mm");
  if (options.has("cell")) o.cell_per_resolution = options.number("cell");
  if (options.has("partition")) {
    const std::string& partition = options.text("partition");
    o.partition = partition == "grid"     ? PartitionKind::kGrid
                  : partition == "octree" ? PartitionKind::kOctree
                                          : PartitionKind::kQuadtree;
  }
  if (options.has("test")) {
    o.swept_sphere = options.text("test") == "swept-sphere";
    o.sphere_mm = options.number("sphere_mm");
  }
  return o;
}

Result<PointModel> build_point_model(const cloud::Cloud& cloud, const PointModelOptions& options,
                                     const PrepareContext& context, PrepareReport& report) {
  PALPATE_ASSIGN(PointSurvey survey, survey_points(cloud, options, context, report));

  PointModel model;
  model.origin_mm = cloud.origin_mm;
  model.decision = survey.decision;
  const PointDecision& decided = model.decision;
  PreparePhases phases(report, context);
  phases.begin("partition");
  partition_points(cloud, decided, context.threads, model);
  phases.end();

  phases.begin("store");
  fill_points(cloud, survey.neighbours, decided, context.threads, model);
  if (!options.keep_order) with_partition(model, [](auto& p) { p.drop_order(); });
  model.global_half_box_mm = Vec3::Constant(0.5 * decided.box_mm);
  model.largest_half_box_mm = decided.largest_half_box_mm;
  model.sphere_mm = decided.sphere_mm;
  phases.end();
  if (decided.normals) {
    phases.begin("planes");
    surface::fit_planes(model.points, model.neighbours, context.threads);
    phases.end();
    phases.begin("sides");
    surface::OrientReport sides = surface::orient_planes(model.points, model.neighbours, context.threads);
    model.closed_components = sides.closed_components;
    model.closed_component_of = std::move(sides.closed_component_of);
    report.notes.push_back(
        fmt::format("{} pieces, {} of them closed; {} points on those, touched from the side of the start",
                    sides.pieces, sides.closed_components, sides.one_sided_points));
    phases.end();
  }
  report.bytes += model.bytes();
  report.notes.push_back(fmt::format("resolution {:.6g} mm, cell {:.6g} mm, box {:.6g} mm, {}",
                                     decided.resolution_mm, decided.cell_mm, decided.box_mm,
                                     shape_note(model, decided.partition)));
  return model;
}

namespace {

/// All that the points of a model depend on.
std::string key_of(const cloud::Cloud& cloud, const PointModelOptions& o) {
  return fmt::format("points {:016x} {} {} {} {} {:a} {:a} {:a} {} {} {:a} {} {}", cloud::content_hash(cloud),
                     cloud.size(), o.neighbours, o.complete_to_eight, static_cast<int>(o.box), o.box_mm,
                     o.resolution_mm, o.cell_per_resolution, static_cast<int>(o.partition), o.swept_sphere,
                     o.sphere_mm, o.normals, o.keep_order);
}

/// Prepares this renderer's surface at each place.
Status prepare_surface(const ModelInput& input, const PointModelOptions& options, PointInstance& body,
                       PrepareReport& report) {
  const PointModel& points = *body.points;
  PALPATE_ASSIGN(body.surface, build_surface_field(input, order_of(points), report));
  const double blend_mm = options.blend_resolutions * points.decision.resolution_mm;
  if (const std::size_t softer = blend_stiffness(body.surface, points.points, points.neighbours, blend_mm);
      softer > 0)
    report.notes.push_back(
        fmt::format("stiffness blended over {:.3g} mm: {} points made softer", blend_mm, softer));
  report.bytes += body.surface.bytes();
  return Done{};
}

}  // namespace

Result<PointInstance> build_point_body(const ModelInput& input, const PointModelOptions& options,
                                       const PrepareContext& context, PrepareReport& report) {
  PointModelOptions o = options;
  o.keep_order = varies(input.surface);
  PointInstance body;
  std::shared_ptr<PointModel> own;  // nobody else's, and not in the store
  PALPATE_ASSIGN(body.points, get_or_build<PointModel>(
                                  context, report, [&] { return key_of(*input.cloud, o); },
                                  [&](PrepareReport& to) -> Result<std::shared_ptr<const PointModel>> {
                                    Result<PointModel> built =
                                        build_point_model(*input.cloud, o, context, to);
                                    if (!built) return std::move(built).error();
                                    auto made = std::make_shared<PointModel>(*std::move(built));
                                    if (context.store == nullptr) own = made;
                                    return std::shared_ptr<const PointModel>(std::move(made));
                                  }));
  body.pose = ModelPose(input, body.points->origin_mm);
  PALPATE_TRY(prepare_surface(input, o, body, report));
  if (own != nullptr && o.keep_order) with_partition(*own, [](auto& p) { p.drop_order(); });
  return body;
}

}  // namespace palpate::points
