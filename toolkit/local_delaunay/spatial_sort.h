// Sorts the points into the order of their places. Internal to local_delaunay.
#pragma once

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/local_delaunay/raster_cells.h"

namespace palpate::local_delaunay {

/// A point at its place: the data that its neighbours read together.
struct SortedPoint {
  float x_mm = 0.0F, y_mm = 0.0F, z_mm = 0.0F;
  float weight = 0.0F;  ///< see CandidateTriangulation

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
};

struct SortedPoints {
  UninitializedVector<SortedPoint> point;
  std::vector<std::uint32_t> order;     ///< cloud index per place
  std::vector<std::uint8_t> duplicate;  ///< 1: a point of lower index has exactly these coordinates
};

/// Sorts along a Morton curve, then halves groups along the longest side down to blocks. Parallel;
/// independent of the number of threads and of the order of distinct points.
[[nodiscard]] SortedPoints spatial_sort(const cloud::Cloud& cloud, int threads);

/// For a raster: takes a Morton curve over tiles of rows and columns without sorting, then halves as above.
/// `doubled` is unknown, all 0. Parallel; independent of the number of threads.
[[nodiscard]] SortedPoints spatial_sort_raster(const cloud::Cloud& cloud, const RasterGrid& grid,
                                               int threads);

/// Points per reordered group. Blocks across a jump of the Morton curve have oversized boxes and layers; with
/// groups only blocks across a group's middle can.
inline constexpr std::size_t kGroupPoints = 512;

/// A point of a group.
struct GroupPoint {
  std::array<float, 3> at;
  std::uint32_t index;  ///< in the cloud
  std::uint32_t place;  ///< in the group as it came
};

/// Halves the group across its longest side, recursively down to kBlockPlaces. Ties go by the other
/// coordinates, then the index. Blocks keep the input order, so all processors and standard libraries agree.
void split_at_medians(std::span<GroupPoint> group) noexcept;

}  // namespace palpate::local_delaunay
