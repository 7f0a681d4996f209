#include "toolkit/search/spacing.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/percentiles.h"
#include "toolkit/core/tolerances.h"

namespace palpate::search {
namespace {

Percentiles percentiles(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  return {values.front(), nearest_rank(values, 50.0), nearest_rank(values, 99.0), nearest_rank(values, 99.9),
          values.back()};
}

}  // namespace

Spacing describe_spacing(const cloud::Cloud& cloud, const NeighbourTable& table) {
  Spacing found;
  std::vector<double> nearest, eighth, index_distance;
  nearest.reserve(table.size());
  eighth.reserve(table.size());
  index_distance.reserve(table.size());
  double longest_sq = 0.0, longest_plan_sq = 0.0;
  for (std::size_t i = 0; i < table.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);
    double nearest_sq = 0.0, last_sq = 0.0;
    std::size_t closest_in_order = cloud.size();
    bool repeated = false;  // coincides with an earlier point
    for (const std::uint32_t other : table.of[i]) {
      if (other == i) continue;
      const Vec3 offset = cloud.local_mm(other) - p;
      const double sq = offset.squaredNorm();
      last_sq = std::max(last_sq, sq);
      longest_plan_sq = std::max(longest_plan_sq, offset.head<2>().squaredNorm());
      if (sq == 0.0) {
        repeated = repeated || other < i;
      } else {
        if (nearest_sq == 0.0 || sq < nearest_sq) nearest_sq = sq;
        closest_in_order = std::min(closest_in_order, other > i ? other - i : i - other);
      }
    }
    longest_sq = std::max(longest_sq, last_sq);
    eighth.push_back(std::sqrt(last_sq));
    if (repeated) continue;
    if (nearest_sq > 0.0) {
      nearest.push_back(std::sqrt(nearest_sq));
      index_distance.push_back(static_cast<double>(closest_in_order));
    } else {
      ++found.without_nearest;
    }
  }
  found.resolution_mm = std::sqrt(longest_sq);
  found.plan_resolution_mm = std::sqrt(longest_plan_sq);
  found.nearest_mm = percentiles(std::move(nearest));
  found.eighth_mm = percentiles(std::move(eighth));
  found.median_index_distance = percentiles(std::move(index_distance)).p50;
  found.high_resolution = found.resolution_mm <= kHighResolutionMm;
  return found;
}

}  // namespace palpate::search
