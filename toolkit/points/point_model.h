// Points as point renderers read them, and their preparation. A model holds points in grid order with the
// normal of their local plane, their neighbours, their boxes and the grid. Its numbers are decided once from
// cloud, options and neighbours: build_point_model() follows the decision and decides nothing; `palpate info
// plan` stops there.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/search/neighbour_table.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/uniform_grid.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::points {

enum class BoxSize : std::uint8_t {
  kGlobal,         ///< one cube for all, of the worst resolution (section 3.1.1.1, rule of thumb)
  kPerVertex,      ///< half lengths = the largest offset to a neighbour per axis
  kPerVertexCube,  ///< a cube of the largest of the three
};

enum class PartitionKind : std::uint8_t { kGrid, kOctree, kQuadtree };

struct PointModelOptions {
  std::string neighbours = "auto";  ///< auto, or one of search::neighbour_builders()
  bool complete_to_eight = true;    ///< of modified kNN
  BoxSize box = BoxSize::kGlobal;
  double box_mm = 0.0;         ///< edge of the global cube; 0 = the resolution
  double resolution_mm = 0.0;  ///< 0 = measured
  /// 0 = five times the median local resolution: see point_model_specs().
  double cell_per_resolution = kCellPerResolution;
  PartitionKind partition = PartitionKind::kGrid;
  bool swept_sphere = false;  ///< test boxes with a swept sphere instead of a segment (section 3.1.4)
  double sphere_mm = 0.0;     ///< its radius; 0 = half the edge of the largest box
  bool normals =
      true;  ///< local planes with a side; and links back, so that a walk cannot be caught in a clump
  double blend_resolutions = 0.0;  ///< stiffness rises over at least so many resolutions; 0 = as given
  bool keep_order = false;         ///< the partition goes on to know which of the cloud's points stands where
};

/// The builder of neighbours that the options mean for a cloud.
[[nodiscard]] std::string neighbours_for(const cloud::Cloud& cloud, const PointModelOptions& options);

/// Half an edge of a box per vertex as it is stored: rounded up, so that the box still reaches the neighbour
/// it was made for.
[[nodiscard]] inline float stored_half_box(double half_mm) noexcept {
  return std::nextafter(static_cast<float>(half_mm), std::numeric_limits<float>::infinity());
}

/// With every number settled.
struct PointDecision {
  std::string neighbours;          ///< one of search::neighbour_builders()
  bool from_scan = false;          ///< the points' order tells them: nothing was searched
  double resolution_mm = 0.0;      ///< as measured, or as given
  double max_spacing_mm = 0.0;     ///< largest distance to an immediate neighbour
  double median_nearest_mm = 0.0;  ///< to the nearest point elsewhere; 0 where there is none
  bool coincident = false;         ///< all points at one place: the resolution is a stand-in
  PartitionKind partition = PartitionKind::kGrid;
  double cell_mm = 0.0;  ///< edge of the grid's cells, or what it would be
  BoxSize box = BoxSize::kGlobal;
  double box_mm = 0.0;                      ///< edge of the global box
  Vec3 largest_half_box_mm = Vec3::Zero();  ///< of any box
  double sphere_mm = 0.0;                   ///< radius of the swept sphere; 0: the segment
  bool normals = true;                      ///< local planes with a side
  double rounding_mm = 0.0;                 ///< of a stored coordinate
};

/// Findings on the way to the decision: the neighbours, with links back where the points get planes.
struct PointSurvey {
  PointDecision decision;
  search::NeighbourTable neighbours;
};

/// Finds the neighbours, measures them and decides. Phases and notes are added to `report`. An Error where
/// the cloud is empty or does not carry what the builder of neighbours reads. The same for any number of
/// threads.
[[nodiscard]] Result<PointSurvey> survey_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                                                const render::PrepareContext& context,
                                                render::PrepareReport& report);

/// Points and surface of one model.
struct PointModelDecision {
  PointDecision points;
  render::SurfaceDecision surface;
};
/// The decision that build_point_model() follows: survey_points() and decide_surface().
[[nodiscard]] Result<PointModelDecision> decide_point_model(const render::ModelInput& input,
                                                            const PointModelOptions& options,
                                                            const render::PrepareContext& context);

/// The decisions in words, and the bytes of points, neighbours, boxes and partition (an estimate: nobody has
/// counted the cells).
void describe_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                     const PointDecision& decision, render::ModelDecisions& out);

using StoredPoint = surface::OrientedPoint;

/// Points as frames read them; nothing of a renderer's own. Places are indices in the partition's order.
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
  render::ModelPose pose;
  render::SurfaceField surface;  ///< by place
  [[nodiscard]] PointModelDecision decided() const { return {points->decision, surface}; }
};

/// Prepares one model. Its points come from the context's store where it has one. Phases, notes and bytes are
/// added to `report`. The options that read themselves from a renderer's Options are point_model_specs().
[[nodiscard]] Result<PointInstance> build_point_body(const render::ModelInput& input,
                                                     const PointModelOptions& options,
                                                     const render::PrepareContext& context,
                                                     render::PrepareReport& report);

/// The points alone, for this renderer alone.
[[nodiscard]] Result<PointModel> build_point_model(const cloud::Cloud& cloud,
                                                   const PointModelOptions& options,
                                                   const render::PrepareContext& context,
                                                   render::PrepareReport& report);

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

}  // namespace palpate::points
