#include "toolkit/points/point_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "toolkit/cloud/statistics.h"
#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/neighbourhood/builders.h"
#include "toolkit/neighbourhood/walkable.h"
#include "toolkit/render/model_store.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::render {
namespace {

/// Enough for a median that is right to some percent.
constexpr std::size_t kSampledPoints = 4096;
/// A box is as long as the cloud's resolution: in smaller cells it would reach beyond the cells around.
constexpr double kLeastCellPerResolution = 0.5;

/// The builder that the options mean.
std::string builder_name(const cloud::Cloud& cloud, const PointModelOptions& options) {
  if (options.neighbours != "auto") return options.neighbours;
  return cloud.raster ? "scanner-path" : "modified-knn";
}

/// Its links are mutual and go all ways already.
bool follows_scanner(const std::string& name) {
  const std::vector<neighbourhood::Builder> all = neighbourhood::builders();
  return std::any_of(all.begin(), all.end(), [&](const neighbourhood::Builder& builder) {
    return builder.name == name && builder.follows_scanner;
  });
}

Result<neighbourhood::NeighbourTable> neighbours_of(const cloud::Cloud& cloud,
                                                    const PointModelOptions& options,
                                                    const PrepareContext& context, PrepareReport& report) {
  NamedOptions wanted{builder_name(cloud, options), {}};
  report.notes.push_back("neighbours: " + wanted.name);
  if (wanted.name == "modified-knn")
    wanted.options.set("complete", options.complete_to_eight ? "true" : "false");
  Result<neighbourhood::Built> built = neighbourhood::build_neighbours(wanted, cloud, context.threads);
  if (!built) return std::move(built).error();
  report.notes.insert(report.notes.end(), built->notes.begin(), built->notes.end());
  return std::move(built->table);
}

/// The largest distance between immediate neighbours (section 1.6).
double worst_resolution(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table, int threads) {
  const std::size_t n = cloud.size();
  std::vector<double> worst((n + kPointsPerChunk - 1) / kPointsPerChunk, 0.0);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    double here = 0.0;
    for (std::size_t i = begin; i < end; ++i)
      for (const std::uint32_t other : table.of[i])
        here = std::max(here, (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
    worst[begin / kPointsPerChunk] = here;
  });
  return std::sqrt(*std::max_element(worst.begin(), worst.end()));
}

/// The median distance to the last neighbour, over points spread evenly through the file.
double median_local_resolution(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table) {
  const std::size_t n = cloud.size(), count = std::min(n, kSampledPoints);
  std::vector<double> square(count, 0.0);
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = k * n / count;
    for (const std::uint32_t other : table.of[i])
      square[k] = std::max(square[k], (cloud.local_mm(other) - cloud.local_mm(i)).squaredNorm());
  }
  return std::sqrt(upper_median(std::move(square)));
}

/// The thesis sizes cells by the resolution, which is that of the cloud's sparsest place. Where points
/// are unevenly spaced such cells hold thousands of them, and all are looked at while the HIP is near.
double cell_edge_mm(const cloud::Cloud& cloud, const PointModelOptions& options,
                    const neighbourhood::NeighbourTable& table, double resolution_mm) {
  if (options.cell_per_resolution > 0.0) return options.cell_per_resolution * resolution_mm;
  return std::clamp(kCellPerResolution * median_local_resolution(cloud, table),
                    kLeastCellPerResolution * resolution_mm, kCellPerResolution * resolution_mm);
}

/// Builds the partition asked for.
void partition_points(const cloud::Cloud& cloud, const PointModelOptions& options, double cell_mm,
                      int threads, PointModel& model) {
  partition::PartitionOptions o;
  o.cell_mm = model.cell_mm = cell_mm;
  o.spare_places = options.spare_points;
  switch (options.partition) {
    case PartitionKind::kGrid:
      if (options.moving) {
        model.tree = partition::DynamicGrid::build(cloud, o, threads);
        model.cell_mm = std::get<partition::DynamicGrid>(model.tree).cell_mm();
      } else {
        model.grid = partition::UniformGrid::build(cloud, o, threads);
        model.cell_mm = model.grid.cell_mm();
      }
      break;
    case PartitionKind::kOctree:
      if (options.moving)
        model.tree = partition::DynamicOctree::build(cloud, o, threads);
      else
        model.tree = partition::Octree::build(cloud, o, threads);
      break;
    case PartitionKind::kQuadtree:
      if (options.moving)
        model.tree = partition::DynamicQuadtree3d::build(cloud, o, threads);
      else
        model.tree = partition::Quadtree3d::build(cloud, o, threads);
      break;
  }
}

std::span<const std::uint32_t> order_of(const PointModel& model) {
  return with_partition(model, [](const auto& p) { return std::span<const std::uint32_t>(p.order()); });
}

std::string shape_note(const PointModel& model, PartitionKind kind) {
  const partition::LeafStatistics shape = with_partition(model, [](const auto& p) { return p.statistics(); });
  if (kind == PartitionKind::kGrid)
    return fmt::format("{} cells, at most {} points a cell", shape.leaves, shape.max_points);
  return fmt::format("{} of {} leaves in {} nodes, at most {} points a leaf, {} deep",
                     kind == PartitionKind::kOctree ? "octree" : "quadtree", shape.leaves, shape.nodes,
                     shape.max_points, shape.max_depth);
}

void fill_points(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table,
                 const PointModelOptions& options, int threads, PointModel& model) {
  const std::size_t n = cloud.size();
  const auto order = order_of(model);
  std::vector<std::uint32_t> place_of(n);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t place = begin; place < end; ++place)
      place_of[order[place]] = static_cast<std::uint32_t>(place);
  });
  if (options.moving) model.place_of = place_of;
  model.points.resize(n);
  model.neighbours.resize(n);
  if (options.box != BoxSize::kGlobal) model.half_box_mm.resize(n);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t place = begin; place < end; ++place) {
      const std::uint32_t i = order[place];
      model.points[place] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], surface::kNoNormal};
      Vec3 half = Vec3::Zero();
      for (std::size_t k = 0; k < neighbourhood::kNeighbours; ++k) {
        const std::uint32_t other = table.of[i][k];
        model.neighbours[place][k] = place_of[other];
        half = half.cwiseMax((cloud.local_mm(other) - cloud.local_mm(i)).cwiseAbs());
      }
      if (options.box == BoxSize::kPerVertexCube) half.setConstant(half.maxCoeff());
      // Rounded up, so that the box still reaches the neighbour it was made for.
      if (options.box != BoxSize::kGlobal)
        for (int axis = 0; axis < 3; ++axis)
          model.half_box_mm[place][axis] =
              std::nextafter(static_cast<float>(half[axis]), std::numeric_limits<float>::infinity());
    }
  });
}

}  // namespace

std::vector<OptionSpec> point_model_specs(bool complete_to_eight) {
  using enum OptionKind;
  std::vector<std::string> names = {"auto"};
  for (const neighbourhood::Builder& builder : neighbourhood::builders()) names.push_back(builder.name);
  return {
      {"neighbours", kChoice, "auto",
       "how neighbours are found; auto: the scanner's path where the cloud is a raster", std::move(names)},
      {"complete",
       kFlag,
       complete_to_eight ? "true" : "false",
       "modified kNN completes to eight neighbours; false: as printed, which finds fewer where its cubes do",
       {},
       0,
       0,
       {{"neighbours", {"auto", "modified-knn"}}}},
      {"box",
       kChoice,
       "global",
       "vertex boxes: one size, or per vertex",
       {"global", "per-vertex", "per-vertex-cube"}},
      {"box_mm",
       kNumber,
       "0",
       "edge of the global box in mm; 0: the cloud's resolution",
       {},
       0.0,
       1e12,
       {{"box", {"global"}}}},
      {"resolution_mm", kNumber, "0", "the cloud's resolution in mm; 0: measured", {}, 0.0, 1e12},
      {"cell",
       kNumber,
       "5",
       "grid cell edge in resolutions; 0: five times the median local resolution, at least half the cloud's",
       {},
       0.0,
       1000.0},
  };
}

std::vector<OptionSpec> box_test_specs() {
  using enum OptionKind;
  return {
      {"test",
       kChoice,
       "box",
       "vertex boxes against the probe's segment (box) or a sphere swept along it (3.1.4's second remedy)",
       {"box", "swept-sphere"}},
      {"sphere_mm",
       kNumber,
       "0",
       "radius of the swept sphere in mm; 0: half a box's edge",
       {},
       0.0,
       1e12,
       {{"test", {"swept-sphere"}}}},
  };
}

OptionSpec partition_spec() {
  return {"partition",
          OptionKind::kChoice,
          "grid",
          "how boxes near the probe are found: uniform grid, octree of ten points a leaf, or 3D quadtree",
          {"grid", "octree", "quadtree"}};
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
  if (cloud.empty()) return Error{"the cloud has no points", "give a file with at least one point", {}, 0};

  PreparePhases phases(report, context);
  phases.begin("neighbours");
  Result<neighbourhood::NeighbourTable> table = neighbours_of(cloud, options, context, report);
  if (!table) return std::move(table).error();
  phases.end();
  phases.begin("resolution");

  PointModel model;
  model.origin_mm = cloud.origin_mm;
  model.max_spacing_mm = worst_resolution(cloud, *table, context.threads);
  model.resolution_mm = options.resolution_mm > 0.0 ? options.resolution_mm : model.max_spacing_mm;
  if (!(model.resolution_mm > 0.0)) {
    model.resolution_mm = cloud::stand_in_spacing_mm(cloud);
    report.notes.push_back("all points coincide: the resolution is a stand-in");
  }
  phases.end();

  // The resolution is that of the nearest eight; links out of clumps may be longer. The scanner's path has a
  // link back for each of its own.
  if (options.normals && !follows_scanner(builder_name(cloud, options))) {
    phases.begin("links");
    const neighbourhood::WalkableReport mended = neighbourhood::make_walkable(cloud, *table, context.threads);
    if (mended.spread + mended.returned > 0)
      report.notes.push_back(fmt::format("neighbours spread at {} points, links back given to {}",
                                         mended.spread, mended.returned));
    phases.end();
  }

  phases.begin("partition");
  partition_points(cloud, options, cell_edge_mm(cloud, options, *table, model.resolution_mm), context.threads,
                   model);
  phases.end();

  phases.begin("store");
  fill_points(cloud, *table, options, context.threads, model);
  if (!options.keep_order) with_partition(model, [](auto& p) { p.drop_order(); });
  const double edge = options.box_mm > 0.0 ? options.box_mm : model.resolution_mm;
  model.global_half_box_mm = Vec3::Constant(0.5 * edge);
  model.largest_half_box_mm = model.global_half_box_mm;
  if (!model.half_box_mm.empty()) {
    model.largest_half_box_mm = Vec3::Zero();
    for (const Vec3f& half : model.half_box_mm)
      model.largest_half_box_mm = model.largest_half_box_mm.cwiseMax(half.cast<double>());
  }
  if (options.swept_sphere)
    model.sphere_mm = options.sphere_mm > 0.0 ? options.sphere_mm : model.largest_half_box_mm.maxCoeff();
  phases.end();
  if (options.normals) {
    phases.begin("planes");
    surface::fit_planes(model.points, model.neighbours, context.threads);
    phases.end();
    phases.begin("sides");
    surface::OrientReport sides = surface::orient_planes(model.points, model.neighbours, context.threads);
    model.closed_pieces = sides.closed_pieces;
    model.closed_piece_of = std::move(sides.closed_piece_of);
    report.notes.push_back(
        fmt::format("{} pieces, {} of them closed; {} points on those, touched from the side of the start",
                    sides.pieces, sides.closed_pieces, sides.one_sided_points));
    phases.end();
  }
  report.bytes += model.bytes();
  report.notes.push_back(fmt::format("resolution {:.6g} mm, cell {:.6g} mm, box {:.6g} mm, {}",
                                     model.resolution_mm, model.cell_mm, edge,
                                     shape_note(model, options.partition)));
  return model;
}

namespace {

/// All that the points of a model depend on.
std::string key_of(const cloud::Cloud& cloud, const PointModelOptions& o) {
  return fmt::format("points {:016x} {} {} {} {} {:a} {:a} {:a} {} {} {} {:a} {} {} {}",
                     cloud::content_hash(cloud), cloud.size(), o.neighbours, o.complete_to_eight,
                     static_cast<int>(o.box), o.box_mm, o.resolution_mm, o.cell_per_resolution,
                     static_cast<int>(o.partition), o.moving, o.swept_sphere, o.sphere_mm, o.normals,
                     o.spare_points, o.keep_order);
}

/// What this renderer's surface is at each place.
Status prepare_surface(const ModelInput& input, const PointModelOptions& options, PointBody& body,
                       PrepareReport& report) {
  const PointModel& points = *body.points;
  Result<SurfaceField> field = build_surface_field(input, order_of(points), report);
  if (!field) return std::move(field).error();
  body.surface = *std::move(field);
  const double blend_mm = options.blend_resolutions * points.resolution_mm;
  if (const std::size_t softer = blend_stiffness(body.surface, points.points, points.neighbours, blend_mm);
      softer > 0)
    report.notes.push_back(
        fmt::format("stiffness blended over {:.3g} mm: {} points made softer", blend_mm, softer));
  report.bytes += body.surface.bytes();
  return Done{};
}

}  // namespace

Result<PointBody> build_point_body(const ModelInput& input, const PointModelOptions& options,
                                   const PrepareContext& context, PrepareReport& report) {
  PointModelOptions o = options;
  o.keep_order = input.surface.per_point != nullptr;
  PointBody body;
  std::shared_ptr<PointModel> own;  // nobody else's, and not in the store
  const bool shared = context.store != nullptr && !o.moving;
  PrepareContext from = context;
  if (!shared) from.store = nullptr;
  Result<std::shared_ptr<const PointModel>> points = held_or_made<PointModel>(
      from, report, [&] { return key_of(*input.cloud, o); },
      [&](PrepareReport& to) -> Result<std::shared_ptr<const PointModel>> {
        Result<PointModel> built = build_point_model(*input.cloud, o, context, to);
        if (!built) return std::move(built).error();
        auto made = std::make_shared<PointModel>(*std::move(built));
        if (!shared) own = made;
        return std::shared_ptr<const PointModel>(std::move(made));
      });
  if (!points) return std::move(points).error();
  body.points = *std::move(points);
  body.pose = ModelPose(input, body.points->origin_mm);
  if (const Status done = prepare_surface(input, o, body, report); !done) return done.error();
  if (own != nullptr && o.keep_order) with_partition(*own, [](auto& p) { p.drop_order(); });
  if (o.moving) body.moving = std::move(own);
  return body;
}

}  // namespace palpate::render
