#include "toolkit/cloud/statistics.h"

#include <fmt/format.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"

namespace palpate::cloud {
namespace {

// The "at most 1 %" of is_single_valued(): a few outliers do not decide.
constexpr double kToleratedShare = 0.01;
// Cell size of is_single_valued() in mean plan spacings; two give four points a cell on average.
constexpr double kCellPerSpacing = 2.0;
// Largest height gap in a cell, in cell sides: a slope of four, 76 degrees.
constexpr double kGapPerCell = 4.0;

using Coordinates = std::array<const std::vector<float>*, 3>;

/// Points that share x and y with their predecessor in `order`, and z (`same_z`) or not.
std::size_t points_above_another(const Cloud& cloud, const std::vector<std::uint32_t>& order, bool same_z) {
  std::size_t found = 0;
  for (std::size_t i = 1; i < order.size(); ++i) {
    const std::uint32_t a = order[i - 1], b = order[i];
    found += cloud.x_mm[a] == cloud.x_mm[b] && cloud.y_mm[a] == cloud.y_mm[b] &&
             (cloud.z_mm[a] == cloud.z_mm[b]) == same_z;
  }
  return found;
}

/// Points above a gap of more than kGapPerCell sides in their plan cell, or those below if fewer.
std::size_t points_in_gaps(const Cloud& cloud, double side_mm, const geometry::Aabb& box) {
  struct Item {
    std::uint64_t cell;
    float z;
  };
  const Vec3 low = box.low_mm - cloud.origin_mm;
  std::vector<Item> items(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);
    const auto column = static_cast<std::uint64_t>((p.x() - low.x()) / side_mm);
    const auto row = static_cast<std::uint64_t>((p.y() - low.y()) / side_mm);
    items[i] = {(row << 32) | column, cloud.z_mm[i]};
  }
  std::sort(items.begin(), items.end(),
            [](const Item& a, const Item& b) { return a.cell != b.cell ? a.cell < b.cell : a.z < b.z; });
  std::size_t found = 0;
  for (std::size_t begin = 0; begin < items.size();) {
    std::size_t end = begin + 1, largest_group = 0, group = 1;
    for (; end < items.size() && items[end].cell == items[begin].cell; ++end) {
      const double gap = static_cast<double>(items[end].z) - static_cast<double>(items[end - 1].z);
      if (gap > kGapPerCell * side_mm) {
        largest_group = std::max(largest_group, group);
        group = 0;
      }
      ++group;
    }
    found += end - begin - std::max(largest_group, group);
    begin = end;
  }
  return found;
}

/// True if every row of `columns` points is strictly monotone in `along` and turns back at its end, and every
/// column strictly monotone in `across`, all in one sense.
bool is_raster(const std::vector<float>& along, const std::vector<float>& across, std::size_t columns,
               bool rising) {
  const bool across_rising = across[columns] > across[0];
  for (std::size_t i = 1; i < along.size(); ++i) {
    const bool new_row = i % columns == 0;
    if (along[i] == along[i - 1] || (along[i] > along[i - 1]) != (rising != new_row)) return false;
    if (i >= columns &&
        (across[i] == across[i - columns] || (across[i] > across[i - columns]) != across_rising))
      return false;
  }
  return true;
}

/// True if rows run to and fro in `along` and columns are strictly monotone in `across`, all in one sense.
bool runs_to_and_fro(const std::vector<float>& along, const std::vector<float>& across,
                     const ScanRaster& raster, bool rising) {
  const bool across_rising = across[raster.index(1, 0)] > across[raster.index(0, 0)];
  for (std::size_t row = 0; row < raster.rows; ++row)
    for (std::size_t column = 0; column < raster.columns; ++column) {
      const std::size_t i = raster.index(row, column);
      if (column > 0) {
        const std::size_t before = raster.index(row, column - 1);
        if (along[i] == along[before] || (along[i] > along[before]) != rising) return false;
      }
      if (row == 0) continue;
      const std::size_t above = raster.index(row - 1, column);
      if (across[i] == across[above] || (across[i] > across[above]) != across_rising) return false;
    }
  return true;
}

/// Length of the strictly monotone start.
std::size_t first_run(const std::vector<float>& x) {
  const bool rising = x[1] > x[0];
  std::size_t run = 1;
  while (run < x.size() && x[run] != x[run - 1] && (x[run] > x[run - 1]) == rising) ++run;
  return run;
}

bool single_valued(const Cloud& cloud, const std::vector<std::uint32_t>& order, const geometry::Aabb& box) {
  const Vec3 extent = box.extent_mm();
  if (cloud.empty() || !(extent.x() > 0.0) || !(extent.y() > 0.0)) return false;
  const auto tolerated = static_cast<std::size_t>(kToleratedShare * static_cast<double>(cloud.size()));
  if (points_above_another(cloud, order, false) > tolerated) return false;
  const double side =
      kCellPerSpacing * std::sqrt(extent.x() * extent.y() / static_cast<double>(cloud.size()));
  // Cell indices beyond 32 bits need a box as thin as one point's share, which has no plan view.
  if (!(extent.x() / side < std::numeric_limits<std::uint32_t>::max()) ||
      !(extent.y() / side < std::numeric_limits<std::uint32_t>::max()))
    return false;
  return points_in_gaps(cloud, side, box) <= tolerated;
}

}  // namespace

std::vector<std::uint32_t> indices_by_place(const Cloud& cloud) {
  std::vector<std::uint32_t> order(cloud.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    if (cloud.x_mm[a] != cloud.x_mm[b]) return cloud.x_mm[a] < cloud.x_mm[b];
    if (cloud.y_mm[a] != cloud.y_mm[b]) return cloud.y_mm[a] < cloud.y_mm[b];
    return cloud.z_mm[a] != cloud.z_mm[b] ? cloud.z_mm[a] < cloud.z_mm[b] : a < b;
  });
  return order;
}

std::size_t count_duplicates(const Cloud& cloud) {
  return points_above_another(cloud, indices_by_place(cloud), true);
}

std::optional<ScanRaster> find_raster(const Cloud& cloud) {
  const Coordinates axes = {&cloud.x_mm, &cloud.y_mm, &cloud.z_mm};
  const std::size_t n = cloud.size();
  if (n < 4) return std::nullopt;  // two rows of two
  for (std::size_t along = 0; along < 3; ++along) {
    const std::vector<float>& x = *axes[along];
    if (x[1] == x[0]) continue;
    const bool rising = x[1] > x[0];
    const std::size_t run = first_run(x);
    // Running to and fro, the second row may begin slightly beyond the end of the first.
    for (const std::size_t columns : {run, run - 1}) {
      if (columns < 2 || columns == n || n % columns != 0) continue;
      if (n / columns > std::numeric_limits<std::uint32_t>::max()) continue;
      ScanRaster raster{static_cast<std::uint32_t>(columns), static_cast<std::uint32_t>(n / columns)};
      ScanRaster fro = raster;
      fro.order = ScanOrder::kBoustrophedon;
      for (std::size_t across = 0; across < 3; ++across) {
        if (across == along) continue;
        if (is_raster(x, *axes[across], columns, rising)) return raster;
        if (runs_to_and_fro(x, *axes[across], fro, rising)) return fro;
      }
    }
  }
  return std::nullopt;
}

bool is_single_valued(const Cloud& cloud) {
  return single_valued(cloud, indices_by_place(cloud), cloud.box_mm());
}

Statistics describe(const Cloud& cloud) {
  Statistics found;
  found.points = cloud.size();
  found.box_mm = cloud.box_mm();
  const Vec3 extent = found.box_mm.extent_mm();
  const double volume = extent.x() * extent.y() * extent.z();
  found.density_per_mm3 =
      volume > 0.0 ? static_cast<double>(cloud.size()) / volume : std::numeric_limits<double>::infinity();
  const std::vector<std::uint32_t> order = indices_by_place(cloud);
  found.duplicates = points_above_another(cloud, order, true);
  found.raster = cloud.raster ? cloud.raster : find_raster(cloud);
  found.single_valued = single_valued(cloud, order, found.box_mm);
  return found;
}

double stored_rounding_mm(const Cloud& cloud) {
  return cloud.size() == 0 ? 0.0 : kUnitRoundoffFloat * 0.5 * cloud.box_mm().extent_mm().norm();
}

double fallback_spacing_mm(const Cloud& cloud) noexcept {
  constexpr double kShare = 1e-6;  // far above coordinate rounding, far below the sought sizes
  const double size = cloud.origin_mm.cwiseAbs().maxCoeff();
  return size > 0.0 ? kShare * size : 1.0;
}

namespace {

// Points nearer to a line than this share of its length are collinear; text files have five digits or more.
constexpr double kThinnest = 1e-5;

/// The point farthest from `from`.
Vec3 farthest_from(const Cloud& cloud, const Vec3& from) {
  Vec3 best = from;
  double best_sq = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double distance_sq = (cloud.local_mm(i) - from).squaredNorm();
    if (distance_sq <= best_sq) continue;
    best_sq = distance_sq;
    best = cloud.local_mm(i);
  }
  return best;
}

}  // namespace

std::optional<std::string> degeneracy_of(const Cloud& cloud) {
  if (cloud.empty()) return "it has no points";
  const Vec3 one_end = cloud.local_mm(0), other_end = farthest_from(cloud, one_end);
  const double length = (other_end - one_end).norm();
  if (length > 0.0) {
    const Vec3 along = (other_end - one_end) / length;
    for (std::size_t i = 0; i < cloud.size(); ++i)
      if ((cloud.local_mm(i) - one_end).cross(along).norm() > kThinnest * length) return std::nullopt;
  }
  const std::size_t places = cloud.size() - count_duplicates(cloud);
  const std::string where = places == 1                   ? std::string("in one place")
                            : places < kMinDistinctPoints ? fmt::format("in {} places", places)
                                                          : std::string("in one line");
  return cloud.size() == 1
             ? fmt::format("it has one point; a surface needs at least {} that are not in one line",
                           kMinDistinctPoints)
             : fmt::format("its {} points stand {}; a surface needs at least {} that are not in one line",
                           cloud.size(), where, kMinDistinctPoints);
}

std::vector<float> taken(const std::vector<float>& values, std::span<const std::uint32_t> of) {
  std::vector<float> some;
  if (values.empty()) return some;
  some.reserve(of.size());
  for (const std::uint32_t i : of) some.push_back(values[i]);
  return some;
}

Cloud subset_of(const Cloud& cloud, std::span<const std::uint32_t> of) {
  Cloud part;
  part.origin_mm = cloud.origin_mm;
  part.x_mm = taken(cloud.x_mm, of);
  part.y_mm = taken(cloud.y_mm, of);
  part.z_mm = taken(cloud.z_mm, of);
  for (const Property& property : cloud.properties)
    part.properties.push_back({property.name, taken(property.values, of)});
  return part;
}

Cloud random_subset(const Cloud& cloud, std::size_t count, std::uint64_t seed) {
  std::vector<std::uint32_t> kept(cloud.size());
  std::iota(kept.begin(), kept.end(), 0u);
  if (count < kept.size()) {
    Random random(seed);
    for (std::size_t i = 0; i < count; ++i) std::swap(kept[i], kept[i + random.below(kept.size() - i)]);
    kept.resize(count);
    std::sort(kept.begin(), kept.end());
  }
  Cloud some = subset_of(cloud, kept);
  some.properties.clear();
  return some;
}

}  // namespace palpate::cloud
