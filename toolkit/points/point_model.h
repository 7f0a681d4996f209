// What the point renderers read in a frame, and how it is prepared from a cloud: points in grid order with
// the normal of their local plane, their neighbours, their boxes and the grid.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/result.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/core/vec.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/partition/dynamic_grid.h"
#include "toolkit/partition/dynamic_tree.h"
#include "toolkit/partition/space_tree.h"
#include "toolkit/partition/uniform_grid.h"
#include "toolkit/points/point_decision.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/renderer.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/surface/planes.h"

namespace palpate::render {

using StoredPoint = surface::SurfacePoint;

/// What frames read of the points; nothing of a renderer's own. Places are indices in the partition's order.
/// Immutable after build and shared, but where points move.
struct PointModel {
  Vec3 origin_mm = Vec3::Zero();  ///< of the local coordinates, in the model frame
  LargeVector<StoredPoint> points;
  LargeVector<neighbourhood::Neighbours> neighbours;
  LargeVector<Vec3f> half_box_mm;  ///< per place; empty when the box is global
  Vec3 global_half_box_mm = Vec3::Zero();
  Vec3 largest_half_box_mm = Vec3::Zero();
  partition::UniformGrid grid;  ///< empty where a tree was chosen
  /// Instead of the grid.
  std::variant<std::monostate, partition::Octree, partition::Quadtree3d, partition::DynamicGrid,
               partition::DynamicOctree, partition::DynamicQuadtree3d>
      tree;
  std::vector<std::uint32_t> place_of;  ///< where they move: the place of each of the cloud's points
  double sphere_mm = 0.0;               ///< radius of the swept sphere; 0: boxes are tested with the segment
  std::size_t closed_pieces = 0;        ///< pieces that enclose a volume
  LargeVector<std::uint32_t>
      closed_piece_of;     ///< per place, see OrientReport; empty where there is no second
  PointDecision decision;  ///< what was followed

  [[nodiscard]] Vec3 half_box(std::uint32_t place) const noexcept {
    return half_box_mm.empty() ? global_half_box_mm : Vec3(half_box_mm[place].cast<double>());
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points.capacity() * sizeof(StoredPoint) +
           neighbours.capacity() * sizeof(neighbourhood::Neighbours) +
           half_box_mm.capacity() * sizeof(Vec3f) + partition_bytes() +
           (place_of.capacity() + closed_piece_of.capacity()) * sizeof(std::uint32_t);
  }
  [[nodiscard]] std::size_t partition_bytes() const noexcept;
};

/// One model as one renderer holds it.
struct PointBody {
  std::shared_ptr<const PointModel> points;
  std::shared_ptr<PointModel> moving;  ///< where points may move: the same, this renderer's own
  ModelPose pose;
  SurfaceField surface;  ///< by place
  [[nodiscard]] PointModelDecision decided() const { return {points->decision, surface}; }
};

/// Prepares one model. Its points come from the context's store where it has one and they do not move.
/// Phases, notes and bytes are added to `report`. The options that read themselves from a renderer's Options
/// are point_model_specs().
[[nodiscard]] Result<PointBody> build_point_body(const ModelInput& input, const PointModelOptions& options,
                                                 const PrepareContext& context, PrepareReport& report);

/// The points alone, for this renderer alone.
[[nodiscard]] Result<PointModel> build_point_model(const cloud::Cloud& cloud,
                                                   const PointModelOptions& options,
                                                   const PrepareContext& context, PrepareReport& report);

/// use(tree) for what a model has instead of the grid. Not std::visit, which may throw.
template <class Model, class Use>
auto with_tree(Model& model, Use&& use) {
  if (auto* octree = std::get_if<partition::Octree>(&model.tree)) return use(*octree);
  if (auto* quadtree = std::get_if<partition::Quadtree3d>(&model.tree)) return use(*quadtree);
  if (auto* grid = std::get_if<partition::DynamicGrid>(&model.tree)) return use(*grid);
  if (auto* moving = std::get_if<partition::DynamicOctree>(&model.tree)) return use(*moving);
  return use(*std::get_if<partition::DynamicQuadtree3d>(&model.tree));
}
/// use(partition) for the one that a model has.
template <class Model, class Use>
auto with_partition(Model& model, Use&& use) {
  return model.tree.index() == 0 ? use(model.grid) : with_tree(model, use);
}

/// The options every point renderer understands. `complete_to_eight`: the default of "complete".
[[nodiscard]] std::vector<OptionSpec> point_model_specs(bool complete_to_eight = true);
/// The partition, for renderers that scan boxes through any.
[[nodiscard]] OptionSpec partition_spec();
/// The test of the narrow phase, for renderers that have one.
[[nodiscard]] std::vector<OptionSpec> box_test_specs();
[[nodiscard]] PointModelOptions point_model_options(const Options& options);

}  // namespace palpate::render
