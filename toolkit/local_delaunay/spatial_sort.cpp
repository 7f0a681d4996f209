#include "toolkit/local_delaunay/spatial_sort.h"

#include <algorithm>
#include <array>
#include <bit>

#include "toolkit/core/parallel.h"
#include "toolkit/search/morton_order.h"

namespace palpate::local_delaunay {
namespace {

/// Cells along the longest side of the sorting lattice, as many as a code can hold: points share a cell only
/// if they agree to a float.
constexpr double kSortingCubes = 2097151.0;  // 2^21 - 1
/// Code bits sorted by counting: three passes over eight bytes a point. They distinguish nearly all of a
/// million points; the rest is sorted by comparison.
constexpr int kCountedBits = 32;
constexpr std::size_t kChunk = std::size_t{1} << 16;
constexpr std::size_t kTilesPerChunk = 32;

struct Item {
  std::uint32_t key;  ///< the highest bits of its code
  std::uint32_t index;
};

struct Codes {
  const cloud::Cloud& cloud;
  geometry::Aabb box;
  search::Lattice lattice;

  [[nodiscard]] std::uint64_t at(const Vec3& p) const noexcept {
    const auto along = [&](int axis) {
      return static_cast<std::uint32_t>((p[axis] - lattice.low_mm[axis]) * lattice.per_mm);
    };
    return search::morton_code(along(0), along(1), along(2));
  }
  [[nodiscard]] std::uint64_t operator()(std::uint32_t i) const noexcept { return at(cloud.local_mm(i)); }
  /// The code with the highest bit of any; coordinates grow with the place along each axis.
  [[nodiscard]] std::uint64_t highest() const noexcept { return at(box.high_mm); }
};

/// Sorts by the highest bits of the codes.
UninitializedVector<Item> counted(const Codes& codes, int threads) {
  const std::size_t n = codes.cloud.size();
  const int below = std::max(0, 64 - std::countl_zero(codes.highest()) - kCountedBits);
  UninitializedVector<Item> items(n);
  parallel_each(n, kChunk, threads, [&](std::size_t k) {
    const auto i = static_cast<std::uint32_t>(k);
    items[k] = {static_cast<std::uint32_t>(codes(i) >> below), i};
  });
  radix_sort(items, kCountedBits, threads, [](const Item& item) { return item.key; });
  return items;
}

std::array<float, 3> coordinates(const cloud::Cloud& cloud, std::uint32_t i) noexcept {
  return {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]};
}

/// Sorts points with equal keys by the rest of their codes, then coordinates, then index; marks duplicates.
void settle_runs(const Codes& codes, UninitializedVector<Item>& items, std::vector<std::uint8_t>& duplicate,
                 int threads) {
  const cloud::Cloud& cloud = codes.cloud;
  const std::size_t n = items.size();
  parallel_chunks(n, kChunk, threads, [&](std::size_t begin, std::size_t end) {
    // A chunk owns the runs that begin in it.
    std::size_t i = begin;
    while (i > 0 && i < end && items[i].key == items[i - 1].key) ++i;
    struct Full {
      std::uint64_t code;
      std::array<float, 3> at;
      std::uint32_t index;
      bool operator<(const Full& o) const noexcept {
        if (code != o.code) return code < o.code;
        return at != o.at ? at < o.at : index < o.index;
      }
    };
    std::vector<Full> run;
    while (i < end) {
      std::size_t last = i + 1;
      while (last < n && items[last].key == items[i].key) ++last;
      if (last - i > 1) {
        run.clear();
        for (std::size_t k = i; k < last; ++k)
          run.push_back({codes(items[k].index), coordinates(cloud, items[k].index), items[k].index});
        std::sort(run.begin(), run.end());
        for (std::size_t k = 0; k < run.size(); ++k) {
          items[i + k].index = run[k].index;
          if (k > 0 && run[k].at == run[k - 1].at) duplicate[run[k].index] = 1;
        }
      }
      i = last;
    }
  });
}

/// `index(k)`: the k-th point along a curve. Halves groups of them.
template <class Index>
SortedPoints in_groups(const cloud::Cloud& cloud, const Index& index, int threads) {
  const std::size_t n = cloud.size();
  SortedPoints places;
  places.point.resize(n);
  places.order.resize(n);
  parallel_chunks(n, kChunk, threads, [&](std::size_t first, std::size_t last) {
    std::array<GroupPoint, kGroupPoints> room;
    for (std::size_t begin = first; begin < last; begin += kGroupPoints) {
      const std::size_t end = std::min(begin + kGroupPoints, last);
      const std::span<GroupPoint> group = std::span(room).first(end - begin);
      for (std::size_t k = begin; k < end; ++k) {
        const std::uint32_t i = index(k);
        group[k - begin] = {coordinates(cloud, i), i, static_cast<std::uint32_t>(k - begin)};
      }
      // Prefetches the next group, scattered in memory for unordered points.
      for (std::size_t k = end; k < std::min(end + kGroupPoints, last); ++k) {
        const std::uint32_t i = index(k);
        __builtin_prefetch(&cloud.x_mm[i]);
        __builtin_prefetch(&cloud.y_mm[i]);
        __builtin_prefetch(&cloud.z_mm[i]);
      }
      split_at_medians(group);
      for (std::size_t k = begin; k < end; ++k) {
        const GroupPoint& p = group[k - begin];
        places.point[k] = {p.at[0], p.at[1], p.at[2], 0.0F};
        places.order[k] = p.index;
      }
    }
  });
  return places;
}
static_assert(kChunk % kGroupPoints == 0);

/// Rows of a nearly square tile of kGroupPoints positions.
std::uint32_t rows_of_tile(const cloud::Cloud& cloud, const RasterGrid& grid) {
  const double down_sq = grid.typical_step_sq(cloud, 1, 0), across_sq = grid.typical_step_sq(cloud, 0, 1);
  std::uint32_t rows = 1;
  // rows x columns = kGroupPoints: doubles the rows while they are no longer than the columns.
  while (rows < kGroupPoints) {
    const double tall = 2.0 * rows, wide = static_cast<double>(kGroupPoints) / tall;
    if (tall * tall * down_sq > wide * wide * across_sq) break;
    rows *= 2;
  }
  return rows;
}

}  // namespace

void split_at_medians(std::span<GroupPoint> group) noexcept {
  const std::size_t blocks = (group.size() + kBlockPlaces - 1) / kBlockPlaces;
  if (blocks < 2) {
    std::sort(group.begin(), group.end(),
              [](const GroupPoint& a, const GroupPoint& b) { return a.place < b.place; });
    return;
  }
  std::array<float, 3> low = group[0].at, high = low;
  for (const GroupPoint& p : group)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], p.at[axis]);
      high[axis] = std::max(high[axis], p.at[axis]);
    }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const std::size_t left = (blocks + 1) / 2 * kBlockPlaces;
  std::nth_element(group.begin(), group.begin() + static_cast<std::ptrdiff_t>(left), group.end(),
                   [longest](const GroupPoint& a, const GroupPoint& b) {
                     if (a.at[longest] != b.at[longest]) return a.at[longest] < b.at[longest];
                     return a.at != b.at ? a.at < b.at : a.index < b.index;
                   });
  split_at_medians(group.first(left));
  split_at_medians(group.subspan(left));
}

SortedPoints spatial_sort(const cloud::Cloud& cloud, int threads) {
  const std::size_t n = cloud.size();
  const geometry::Aabb box = search::local_box(cloud, threads);
  const double extent = box.extent_mm().maxCoeff();
  const Codes codes{cloud, box, search::Lattice::over(box, extent > 0.0 ? extent / kSortingCubes : 1.0)};
  std::vector<std::uint8_t> duplicate(n, 0);
  UninitializedVector<Item> items = counted(codes, threads);
  settle_runs(codes, items, duplicate, threads);
  SortedPoints places = in_groups(
      cloud, [&items](std::size_t k) { return items[k].index; }, threads);
  places.duplicate.resize(n);
  parallel_each(n, kChunk, threads, [&](std::size_t k) { places.duplicate[k] = duplicate[places.order[k]]; });
  return places;
}

SortedPoints spatial_sort_raster(const cloud::Cloud& cloud, const RasterGrid& grid, int threads) {
  const std::uint32_t tall = rows_of_tile(cloud, grid);
  const auto wide = static_cast<std::uint32_t>(kGroupPoints / tall);
  struct Tile {
    std::uint64_t code;
    std::uint32_t row, column;
    std::uint32_t first;  ///< place, once they are sorted
  };
  std::vector<Tile> tiles;
  for (std::uint32_t row = 0; row < grid.rows(); row += tall)
    for (std::uint32_t column = 0; column < grid.columns(); column += wide)
      tiles.push_back({search::morton_code(column / wide, row / tall, 0), row, column, 0});
  std::sort(tiles.begin(), tiles.end(), [](const Tile& a, const Tile& b) { return a.code < b.code; });
  const auto visit = [&](const Tile& tile, auto&& use) {
    const std::uint32_t last_row = std::min(tile.row + tall, grid.rows());
    const std::uint32_t last_column = std::min(tile.column + wide, grid.columns());
    for (std::uint32_t row = tile.row; row < last_row; ++row)
      for (std::uint32_t column = tile.column; column < last_column; ++column)
        if (const std::uint32_t i = grid.point(row, column); i != kNoPlace) use(i);
  };
  std::uint32_t places = 0;
  for (Tile& tile : tiles) {
    tile.first = places;
    visit(tile, [&](std::uint32_t) { ++places; });
  }
  UninitializedVector<std::uint32_t> curve(cloud.size());
  parallel_each(tiles.size(), kTilesPerChunk, threads, [&](std::size_t t) {
    std::uint32_t place = tiles[t].first;
    visit(tiles[t], [&](std::uint32_t i) { curve[place++] = i; });
  });
  SortedPoints made = in_groups(
      cloud, [&curve](std::size_t k) { return curve[k]; }, threads);
  made.duplicate.assign(cloud.size(), 0);
  return made;
}

}  // namespace palpate::local_delaunay
