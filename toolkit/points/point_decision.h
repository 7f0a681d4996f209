// What a point renderer builds of a cloud, with which numbers: decided once from cloud, options and
// neighbours. build_point_model() follows it and decides nothing; `palpate info plan` stops there.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/tolerances.h"
#include "toolkit/render/surface_field.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::render {

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

/// What was found on the way to the decision: the neighbours, with links back where the points get planes.
struct PointSurvey {
  PointDecision decision;
  search::NeighbourTable neighbours;
};

/// Finds the neighbours, measures them and decides. Phases and notes are added to `report`. An Error where
/// the cloud is empty or does not carry what the builder of neighbours reads. The same for any number of
/// threads.
[[nodiscard]] Result<PointSurvey> survey_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                                                const PrepareContext& context, PrepareReport& report);

/// Points and surface of one model.
struct PointModelDecision {
  PointDecision points;
  SurfaceDecision surface;
};
/// What build_point_model() will follow: survey_points() and decide_surface().
[[nodiscard]] Result<PointModelDecision> decide_point_model(const ModelInput& input,
                                                            const PointModelOptions& options,
                                                            const PrepareContext& context);

/// The decisions in words, and the bytes of points, neighbours, boxes and partition (an estimate: nobody has
/// counted the cells).
void describe_points(const cloud::Cloud& cloud, const PointModelOptions& options,
                     const PointDecision& decision, ModelDecisions& out);

}  // namespace palpate::render
