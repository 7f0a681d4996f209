// What the point renderers read in a frame, and how it is prepared from a cloud: points in grid order with
// the normal of their local plane, their neighbours, their boxes and the grid.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/large_pages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/points/point_decision.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/search/neighbour_table.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/uniform_grid.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::render {

using StoredPoint = surface::OrientedPoint;

/// What frames read of the points; nothing of a renderer's own. Places are indices in the partition's order.
/// Immutable after build and shared.
struct PointModel {
  Vec3 origin_mm = Vec3::Zero();  ///< of the local coordinates, in the model frame
  LargePageVector<StoredPoint> points;
  LargePageVector<search::Neighbours> neighbours;
  LargePageVector<Vec3f> half_box_mm;  ///< per place; empty when the box is global
  Vec3 global_half_box_mm = Vec3::Zero();
  Vec3 largest_half_box_mm = Vec3::Zero();
  search::UniformGrid grid;  ///< empty where a tree was chosen
  /// Instead of the grid.
  std::variant<std::monostate, search::Octree, search::Quadtree3d> tree;
  double sphere_mm = 0.0;             ///< radius of the swept sphere; 0: boxes are tested with the segment
  std::size_t closed_components = 0;  ///< pieces that enclose a volume
  LargePageVector<std::uint32_t>
      closed_component_of;  ///< per place, see OrientReport; empty where there is no second
  PointDecision decision;   ///< what was followed

  [[nodiscard]] Vec3 half_box(std::uint32_t place) const noexcept {
    return half_box_mm.empty() ? global_half_box_mm : Vec3(half_box_mm[place].cast<double>());
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return points.capacity() * sizeof(StoredPoint) + neighbours.capacity() * sizeof(search::Neighbours) +
           half_box_mm.capacity() * sizeof(Vec3f) + partition_bytes() +
           closed_component_of.capacity() * sizeof(std::uint32_t);
  }
  [[nodiscard]] std::size_t partition_bytes() const noexcept;
};

/// One model as one renderer holds it.
struct PointInstance {
  std::shared_ptr<const PointModel> points;
  ModelPose pose;
  SurfaceField surface;  ///< by place
  [[nodiscard]] PointModelDecision decided() const { return {points->decision, surface}; }
};

/// Prepares one model. Its points come from the context's store where it has one. Phases, notes and bytes are
/// added to `report`. The options that read themselves from a renderer's Options are point_model_specs().
[[nodiscard]] Result<PointInstance> build_point_body(const ModelInput& input,
                                                     const PointModelOptions& options,
                                                     const PrepareContext& context, PrepareReport& report);

/// The points alone, for this renderer alone.
[[nodiscard]] Result<PointModel> build_point_model(const cloud::Cloud& cloud,
                                                   const PointModelOptions& options,
                                                   const PrepareContext& context, PrepareReport& report);

/// use(tree) for what a model has instead of the grid. Not std::visit, which may throw.
template <class Model, class Use>
auto with_tree(Model& model, Use&& use) {
  if (auto* octree = std::get_if<search::Octree>(&model.tree)) return use(*octree);
  return use(*std::get_if<search::Quadtree3d>(&model.tree));
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
