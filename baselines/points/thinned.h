// Clouds too dense in places for a proxy's buffer: one point of each small cell is kept, so that everything
// within its reach is always at hand.
#pragma once

#include <cstddef>
#include <memory>

#include "baselines/points/near_points.h"

namespace palpate::baselines {

/// What a proxy walks on.
struct Thinned {
  /// The one given, where nowhere more than kMaxNear of its points are within reach.
  std::shared_ptr<const cloud::Cloud> cloud;
  double cell_mm = 0.0;  ///< edge of the cells of which one point each was kept; 0: all are there
};

/// Whether so many points a cell could put more than kMaxNear within reach of a place. False says they
/// cannot.
[[nodiscard]] bool may_be_too_many(std::size_t most_in_cell, double cell_mm, double reach_mm) noexcept;

/// Keeps the point nearest to the middle of each cell, of a sixteenth of the radius, or as many times twice
/// that as is needed. A point that is left out has one within the cell's diagonal: on a ball of the radius
/// that is, along the surface, less than 0.6 % of the radius in height. Independent of the order of points
/// but for ties. Properties and raster are not kept. O(n log n) where points are dense, else O(n).
[[nodiscard]] Thinned thinned_to_reach(std::shared_ptr<const cloud::Cloud> cloud, double radius_mm,
                                       double reach_mm, render::PrepareReport& report);

}  // namespace palpate::baselines
