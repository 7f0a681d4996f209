#include "toolkit/search/uniform_grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "toolkit/core/hash.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/search/orthtree.h"
#include "toolkit/search/point_search.h"

namespace palpate::search {
namespace {

/// Finer curve inside a cell: 2^3 cubes an edge, about one surface point each at five spacings a cell.
constexpr int kFinerBits = 3;

std::uint64_t packed(std::uint64_t x, std::uint64_t y, std::uint64_t z) noexcept {
  return x | y << kMortonBits | z << (2 * kMortonBits);
}

}  // namespace

std::size_t UniformGrid::slot_of(const Cell& cell) const noexcept {
  constexpr std::int64_t kCells = std::int64_t{1} << kMortonBits;
  const auto inside = [](std::int64_t c) {
    return static_cast<std::uint64_t>(c) < static_cast<std::uint64_t>(kCells);
  };
  if (!inside(cell.x) || !inside(cell.y) || !inside(cell.z)) return kNoSlot;
  const std::uint64_t key = packed(static_cast<std::uint64_t>(cell.x), static_cast<std::uint64_t>(cell.y),
                                   static_cast<std::uint64_t>(cell.z));
  const std::size_t mask = slots_.size() - 1;
  std::size_t at = (key * kGolden64) >> shift_;
  while (slots_[at].key != kNoKey) {  // terminates: half of the slots are free
    if (slots_[at].key == key) return at;
    at = (at + 1) & mask;
  }
  return kNoSlot;
}

IndexRange UniformGrid::find(const Cell& cell) const noexcept {
  const std::size_t slot = slot_of(cell);
  return slot == kNoSlot ? IndexRange{} : slots_[slot].places;
}

void UniformGrid::insert(std::uint64_t key, IndexRange places) noexcept {
  const std::size_t mask = slots_.size() - 1;
  std::size_t at = (key * kGolden64) >> shift_;
  while (slots_[at].key != kNoKey) at = (at + 1) & mask;
  slots_[at] = {key, places};
  max_points_ = std::max(max_points_, places.end - places.begin);
}

LeafStatistics UniformGrid::statistics() const noexcept {
  LeafStatistics found;
  found.leaves = occupied_;
  found.nodes = slots_.size();
  found.max_points = max_points_;
  std::size_t points = 0;
  for (const Slot& slot : slots_) points += slot.places.end - slot.places.begin;
  if (occupied_ > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(occupied_);
  return found;
}

double UniformGrid::cell_for(const cloud::Cloud& cloud, double cell_mm, int threads) {
  return Lattice::over(local_box(cloud, threads), cell_mm / (1 << kFinerBits)).unit_mm * (1 << kFinerBits);
}

UniformGrid UniformGrid::build(const cloud::Cloud& cloud, double cell_mm, int threads) {
  UniformGrid grid;
  // Cells are 8 x 8 x 8 cubes of a finer lattice, so one sort serves both.
  Lattice fine = Lattice::over(local_box(cloud, threads), cell_mm / (1 << kFinerBits));
  MortonOrder sorted = sort_by_morton(cloud, fine, threads);
  grid.lattice_ = {fine.low_mm, fine.unit_mm * (1 << kFinerBits), fine.per_mm / (1 << kFinerBits)};
  grid.order_ = std::move(sorted.order);

  constexpr int kCellShift = 3 * kFinerBits;
  const std::size_t n = sorted.codes.size();
  std::size_t cells = 0;
  for (std::size_t i = 0; i < n; ++i)
    cells += i == 0 || (sorted.codes[i] >> kCellShift) != (sorted.codes[i - 1] >> kCellShift);
  grid.occupied_ = cells;
  const std::size_t slots = std::bit_ceil(std::max<std::size_t>(2 * cells, 2));
  grid.slots_.resize(slots);
  grid.shift_ = 64 - std::countr_zero(slots);
  std::size_t begin = 0;
  for (std::size_t i = 1; i <= n; ++i) {
    if (i < n && (sorted.codes[i] >> kCellShift) == (sorted.codes[begin] >> kCellShift)) continue;
    const auto [x, y, z] = coordinate_of_code(sorted.codes[begin] >> kCellShift);
    grid.last_cell_ = std::max<std::int64_t>(grid.last_cell_, std::max({x, y, z}));
    grid.insert(
        packed(static_cast<std::uint64_t>(x), static_cast<std::uint64_t>(y), static_cast<std::uint64_t>(z)),
        {static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(i)});
    begin = i;
  }
  return grid;
}

namespace {

/// The lattice of the smallest leaves: as fine as Morton codes allow.
Lattice finest(geometry::Aabb box, int axes, double stand_in_mm) {
  if (axes == 2) box.high_mm.z() = box.low_mm.z();
  constexpr double kCubes = static_cast<double>((1u << kMortonBits) - 2);  // as Lattice::over
  double extent = box.extent_mm().maxCoeff();
  // Coincident points have no extent; the tree then has the size of its queries.
  if (!(extent > 0.0)) extent = stand_in_mm;
  // A quotient rounded up would add a cube and make the lattice double them, losing half the depth.
  return Lattice::over(box, extent / kCubes * (1.0 + 2.0 * gamma(2)));
}

}  // namespace

template <int kAxes>
Orthtree<kAxes> Orthtree<kAxes>::build(const cloud::Cloud& cloud, const PartitionOptions& options,
                                       int threads) {
  Orthtree tree;
  tree.lattice_ = finest(local_box(cloud, threads), kAxes, options.cell_mm);
  MortonOrder sorted = sort_by_morton(cloud, tree.lattice_, threads, kAxes);
  tree.order_ = std::move(sorted.order);
  const std::vector<std::uint64_t>& codes = sorted.codes;
  const int last_level = kMortonBits - std::clamp(options.max_depth, 0, kMortonBits);

  Nodes& nodes = tree.nodes_;
  nodes.push_back({0, static_cast<std::uint32_t>(codes.size()), 0});
  std::size_t level_begin = 0;
  for (int level = kMortonBits; level > last_level; --level) {
    const std::size_t level_end = nodes.size();
    const int shift = 3 * (level - 1);
    for (std::size_t at = level_begin; at < level_end; ++at) {
      if (nodes[at].end - nodes[at].begin <= options.max_points) continue;
      nodes[at].child = static_cast<std::uint32_t>(nodes.size());
      const std::uint32_t end = nodes[at].end;
      std::uint32_t begin = nodes[at].begin;
      for (std::uint64_t child = 0; child < kChildren; ++child) {
        // The codes of a node agree above `shift` + 3 bits.
        const auto next =
            std::partition_point(codes.begin() + begin, codes.begin() + end,
                                 [&](std::uint64_t code) { return (code >> shift & 7u) <= child; });
        const auto to = static_cast<std::uint32_t>(next - codes.begin());
        nodes.push_back({begin, to, 0});
        begin = to;
      }
    }
    level_begin = level_end;
  }
  nodes.shrink_to_fit();
  return tree;
}

template <int kAxes>
LeafStatistics Orthtree<kAxes>::statistics() const {
  LeafStatistics found;
  found.nodes = nodes_.size();
  std::size_t points = 0;
  // Children come after their parents, level by level.
  std::size_t level_begin = 0, level_end = 1;
  for (int depth = 0; level_begin < level_end; ++depth) {
    std::size_t below = 0;
    for (std::size_t at = level_begin; at < level_end; ++at) {
      const TreeNode& node = nodes_[at];
      if (node.child != 0) {
        below += kChildren;
        continue;
      }
      const std::uint32_t here = node.end - node.begin;
      if (here == 0) continue;
      ++found.leaves;
      points += here;
      found.max_points = std::max(found.max_points, here);
      found.max_depth = depth;
    }
    level_begin = level_end;
    level_end += below;
  }
  if (found.leaves > 0) found.mean_points = static_cast<double>(points) / static_cast<double>(found.leaves);
  return found;
}

template class Orthtree<2>;
template class Orthtree<3>;

namespace {

constexpr double kSearchPointsPerCell = 2.0;  // for a surface over two faces of its box; few enough to scan
constexpr std::int64_t kMaxRings = 24;  // beyond, (2 x 24 + 1)^3 cells: testing every point is no slower
// Two squared distances of three differences, squares and sums, and their sum.
constexpr int kRoundedOperations = 16;

double cell_for_nearest(const geometry::Aabb& box, std::size_t points) {
  const Vec3 extent_mm = box.extent_mm();
  // A surface of n points over an area A has spacing sqrt(A / n); the box's two largest faces estimate A.
  const double area_mm2 =
      extent_mm.x() * extent_mm.y() + extent_mm.y() * extent_mm.z() + extent_mm.z() * extent_mm.x();
  const auto n = static_cast<double>(points);
  // Collinear points have no area: uses the spacing along the line.
  const double cell_mm = std::max(std::sqrt(kSearchPointsPerCell * area_mm2 / n),
                                  kSearchPointsPerCell * extent_mm.maxCoeff() / n);
  return cell_mm > 0.0 ? cell_mm : 1.0;  // coincident points: any size works
}

}  // namespace

PointSearch::PointSearch(const cloud::Cloud& cloud, const geometry::Aabb& local_box, double cell_mm,
                         int threads)
    : cloud_(cloud), local_box_(local_box), grid_(UniformGrid::build(cloud, cell_mm, threads)) {
  order_.assign(grid_.order().begin(), grid_.order().end());
  grid_.drop_order();
  for (std::size_t slot = 0; slot < grid_.slots(); ++slot) {
    const IndexRange places = grid_.places_of(slot);
    std::sort(order_.begin() + places.begin, order_.begin() + places.end);
  }
}

PointSearch::PointSearch(const cloud::Cloud& cloud, double cell_mm, int threads)
    : PointSearch(cloud, local_box(cloud, threads), cell_mm, threads) {}

PointSearch::PointSearch(const cloud::Cloud& cloud, int threads)
    : PointSearch(cloud, cell_for_nearest(local_box(cloud, threads), cloud.size()), threads) {}

std::size_t PointSearch::nearest(const Vec3& p_mm) const {
  const Vec3 p = p_mm - cloud_.origin_mm;
  // The rings grow around the box's nearest place to p.
  const Vec3 inside = p.cwiseMax(local_box_.low_mm).cwiseMin(local_box_.high_mm);
  const double outside_sq = (p - inside).squaredNorm();
  const Cell centre = grid_.cell_of(inside);
  double best_sq = std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  const auto visit = [&](std::size_t i) {
    const double sq = (cloud_.local_mm(i) - p).squaredNorm();
    if (sq < best_sq || (sq == best_sq && i < best)) best_sq = sq, best = i;
  };
  for (std::int64_t ring = 0; ring <= kMaxRings; ++ring) {
    for (std::int64_t dx = -ring; dx <= ring; ++dx) {
      for (std::int64_t dy = -ring; dy <= ring; ++dy) {
        const bool edge = std::max(std::abs(dx), std::abs(dy)) == ring;
        const std::int64_t stride = edge || ring == 0 ? 1 : 2 * ring;  // inside the shell only its two caps
        for (std::int64_t dz = -ring; dz <= ring; dz += stride)
          for (const std::uint32_t i : points_of({centre.x + dx, centre.y + dy, centre.z + dz})) visit(i);
      }
    }
    // Unseen points are farther from `inside` than the rings; from there no point of the box is at an acute
    // angle with p, so the squares add.
    const double seen_mm = std::max(0.0, static_cast<double>(ring) - kCellSlack) * grid_.cell_mm();
    if (best_sq * (1.0 + gamma(kRoundedOperations)) < outside_sq + seen_mm * seen_mm) return best;
  }
  for (std::size_t i = 0; i < cloud_.size(); ++i) visit(i);
  return best;
}

}  // namespace palpate::search
