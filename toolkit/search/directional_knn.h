// Directional kNN: the nearest neighbour in each of eight directions (section 3.2.2.1 and figure 39).
#pragma once

#include <cstdint>

#include <palpate/cloud.h>
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// Section 3.2.2.1: a point may know "its nearest neighbor in some general direction", the local space being
/// divided into partitions; figure 39 names eight directions. The division is not printed. Ours: eight
/// 45-degree wedges around the normal of a plane through the point, centred on the directions. East is the x
/// axis in the plane (y if the normal is nearest to x); north is left of east seen from the tip of the
/// normal, whose largest component is positive.
struct DirectionalKnnOptions {
  enum class Frame : std::uint8_t {
    kTangent,  ///< the best-fitting plane of the point and its eight nearest
    kPlan      ///< the plane z = const: east is x, north is y
  };
  Frame frame = Frame::kTangent;
  /// Search range of a direction, in distances to the eighth non-coincident neighbour; a direction without
  /// points stays empty. On a square grid the eighth is 1.41 spacings away, so the default bridges three
  /// missing points.
  double reach = 3.0;
  /// Points off the plane by a larger angle are above or below, in no direction.
  double steepest_deg = 45.0;
};

struct DirectionalKnnReport {
  std::uint64_t all_eight = 0;         ///< points with a neighbour in every direction
  std::uint64_t empty_directions = 0;  ///< over all points
  std::uint64_t without_plane = 0;     ///< the eight nearest are collinear, or fewer than two
};

/// Rows hold at most one point per direction, nearest first, ties by index. Coincident points are never
/// neighbours here. O(n) for clouds of bounded density variation; independent of the number of threads.
[[nodiscard]] NeighbourTable directional_knn(const cloud::Cloud& cloud, const DirectionalKnnOptions& options,
                                             int threads, DirectionalKnnReport* report = nullptr);

}  // namespace palpate::search
