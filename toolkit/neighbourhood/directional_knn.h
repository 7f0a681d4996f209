// Directional kNN: the nearest neighbour in each of eight general directions (section 3.2.2.1 and figure 39).
#pragma once

#include <cstdint>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

/// Section 3.2.2.1: a point may know "its nearest neighbor in some general direction", the local space being
/// divided into partitions; figure 39 names the eight directions. How space is divided is not printed. Ours:
/// eight equal wedges of 45 degrees around the normal of a plane through the point, each with a direction in
/// its middle. East is the x axis laid into the plane, or the y axis where the normal is nearer to x than to
/// y and z; north is a left turn from east seen from the tip of the normal, which has a positive component
/// along its longest axis.
struct DirectionalKnnOptions {
  enum class Frame : std::uint8_t {
    kTangent,  ///< the plane that fits the point and its eight nearest best
    kPlan      ///< the plane z = const: east is x, north is y
  };
  Frame frame = Frame::kTangent;
  /// How far a direction is searched, in distances to the eighth nearest neighbour elsewhere; a direction
  /// with nothing in reach stays empty. On a square grid the eighth is 1.41 spacings off, so the default sees
  /// past three missing points in a row.
  double reach = 3.0;
  /// What stands off the plane by a larger angle lies above or below the point, in none of the directions.
  double steepest_deg = 45.0;
};

struct DirectionalKnnReport {
  std::uint64_t all_eight = 0;         ///< points with a neighbour in every direction
  std::uint64_t empty_directions = 0;  ///< over all points
  std::uint64_t without_plane = 0;     ///< the eight nearest stand in one line, or there are fewer than two
};

/// Every row holds at most one point per direction, nearest first, ties by index. Points at the same place
/// have no direction from one another and are never neighbours here. O(n) for clouds of bounded density
/// variation; the same for any number of threads.
[[nodiscard]] NeighbourTable directional_knn(const cloud::Cloud& cloud, const DirectionalKnnOptions& options,
                                             int threads, DirectionalKnnReport* report = nullptr);

}  // namespace palpate::neighbourhood
