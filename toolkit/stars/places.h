// Internal to stars: the points in the order of their places.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/unset_vector.h"
#include "toolkit/core/vec.h"
#include "toolkit/stars/raster_grid.h"

namespace palpate::stars {

/// A point at its place: what its neighbours read of it, together.
struct Placed {
  float x_mm = 0.0F, y_mm = 0.0F, z_mm = 0.0F;
  float weight = 0.0F;  ///< see Draft

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
};

struct Places {
  UnsetVector<Placed> point;
  std::vector<std::uint32_t> order;   ///< of each place its index in the cloud
  std::vector<std::uint8_t> doubled;  ///< 1: a point of a lower index stands at the very same coordinates
};

/// Along a Morton curve, then halved along the longest side in groups down to blocks. Parallel; the same for
/// any number of threads, and for any order of points of which no two are one.
[[nodiscard]] Places sort_places(const cloud::Cloud& cloud, int threads);

/// Of a raster nothing needs to be sorted: along a Morton curve over tiles of its rows and columns, then
/// halved as above. `doubled` is not known, all 0. Parallel; the same for any number of threads.
[[nodiscard]] Places raster_places(const cloud::Cloud& cloud, const RasterGrid& grid, int threads);

}  // namespace palpate::stars
