#include "toolkit/prepared/cell_partition.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "toolkit/core/parallel.h"

namespace palpate::prepared {

// ---- counting

CountTree::CountTree(std::uint64_t expected_points) {
  Grid root;
  root.bits = std::clamp(static_cast<int>(std::bit_width(expected_points)), kLeastRootBits, kMostRootBits);
  root_shift_ = kCodeBits - root.bits;
  root.counts.resize(std::size_t{1} << root.bits);
  grids_.push_back(std::move(root));
}

CountTree::Grid CountTree::make_grid(const CellKey& key, int depth) {
  Grid grid;
  grid.key = key;
  grid.depth = depth;
  // A grid ends where the key's first word does, so that its bits are of one word.
  grid.bits = std::min(kDivideBits, (depth < kCodeBits ? kCodeBits : kKeyBits) - depth);
  grid.counts.resize(std::size_t{1} << grid.bits);
  return grid;
}

CellKey CountTree::key_below(const Grid& grid, std::uint32_t slot) noexcept {
  CellKey key = grid.key;
  if (grid.depth < kCodeBits)
    key.high |= std::uint64_t{slot} << (kCodeBits - grid.depth - grid.bits);
  else
    key.low |= std::uint64_t{slot} << (kKeyBits - grid.depth - grid.bits);
  return key;
}

CountTree::Place CountTree::find_deep(const LatticePoint& p) const noexcept {
  const CellKey key = key_of(p);
  Place at;
  for (;;) {
    const Grid& grid = grids_[at.grid];
    const int end = grid.depth + grid.bits;
    const std::uint64_t bits = end <= kCodeBits ? key.high >> (kCodeBits - end) : key.low >> (kKeyBits - end);
    at.slot = static_cast<std::uint32_t>(bits & ((std::uint64_t{1} << grid.bits) - 1));
    const std::uint32_t child = grid.children.empty() ? 0 : grid.children[at.slot];
    if (child == 0) return at;
    at.grid = child;
  }
}

bool CountTree::divide_crowded(std::uint64_t most) {
  const auto grids = static_cast<std::uint32_t>(grids_.size());
  for (std::uint32_t g = first_uncounted_; g < grids; ++g) {
    const int end = grids_[g].depth + grids_[g].bits;
    if (end == kKeyBits) continue;
    for (std::uint32_t slot = 0; slot < grids_[g].counts.size(); ++slot) {
      if (grids_[g].counts[slot] <= most) continue;
      grids_[g].children.resize(grids_[g].counts.size(), 0);
      grids_[g].children[slot] = static_cast<std::uint32_t>(grids_.size());
      Grid child = make_grid(key_below(grids_[g], slot), end);
      grids_.push_back(std::move(child));
    }
  }
  first_uncounted_ = grids;
  return grids_.size() > grids;
}

bool CountTree::emit_nodes(std::uint32_t g, const std::vector<std::uint64_t>& before, std::uint32_t slot,
                           int bits) {
  Grid& grid = grids_[g];
  const std::uint32_t past = slot + (1u << bits);
  const std::uint64_t points = before[past] - before[slot];
  if (points == 0) return true;
  if (points > kMostCellPoints && bits > 0)
    return emit_nodes(g, before, slot, bits - 1) &&
           emit_nodes(g, before, slot + (1u << (bits - 1)), bits - 1);
  const std::uint32_t child = bits == 0 && !grid.children.empty() ? grid.children[slot] : 0;
  if (child != 0) return emit_grid(child, points);
  std::fill(grid.regions.begin() + slot, grid.regions.begin() + past,
            static_cast<std::uint32_t>(nodes_.size()));
  nodes_.push_back({key_below(grid, slot), grid.depth + grid.bits - bits, points});
  return true;
}

bool CountTree::emit_grid(std::uint32_t g, std::uint64_t expected) {
  grids_[g].regions.assign(grids_[g].counts.size(), kNone);
  std::vector<std::uint64_t> before(grids_[g].counts.size() + 1, 0);
  std::partial_sum(grids_[g].counts.begin(), grids_[g].counts.end(), before.begin() + 1);
  return before.back() == expected && emit_nodes(g, before, 0, grids_[g].bits);
}

bool CountTree::make_regions(std::uint64_t most) {
  nodes_.clear();
  regions_.clear();
  const std::vector<std::uint64_t>& root = grids_.front().counts;
  if (!emit_grid(0, std::accumulate(root.begin(), root.end(), std::uint64_t{0}))) return false;
  std::vector<std::uint32_t> region_of(nodes_.size());
  for (std::uint32_t i = 0; i < nodes_.size(); ++i) {
    if (regions_.empty() || regions_.back().points + nodes_[i].points > most) {
      const std::uint64_t first = regions_.empty() ? 0 : regions_.back().first + regions_.back().points;
      regions_.push_back({first, 0, i, i});
    }
    regions_.back().points += nodes_[i].points;
    regions_.back().past_node = i + 1;
    region_of[i] = static_cast<std::uint32_t>(regions_.size() - 1);
  }
  for (Grid& grid : grids_)
    for (std::uint32_t& region : grid.regions)
      if (region != kNone) region = region_of[region];
  return true;
}

// ---- sorting and cutting

namespace {

struct CodedPoint {
  std::uint64_t code = 0;
  PackedPoint point;
};

/// Three passes of radix_sort() over eleven bits: four million cubes of a surface; what is left are few
/// points per cube, which are sorted by comparison.
constexpr int kRadixBits = 33;

bool before(const CodedPoint& a, const CodedPoint& b) noexcept {
  if (a.code != b.code) return a.code < b.code;
  return lower_code(a.point.point()) < lower_code(b.point.point());
}

/// Sorts runs of equal upper bits by comparison. A piece sorts the runs that begin in it; where they begin is
/// found before any thread sorts.
void sort_runs(std::vector<CodedPoint>& points, int shift, int threads) {
  const auto begins = [&](std::size_t i) {
    return i == 0 || points[i].code >> shift != points[i - 1].code >> shift;
  };
  const std::size_t pieces = (points.size() + kPointsPerChunk - 1) / kPointsPerChunk;
  std::vector<std::size_t> first(pieces + 1, points.size());
  for (std::size_t piece = pieces; piece-- > 0;) {
    std::size_t i = piece * kPointsPerChunk;
    const std::size_t past = std::min(points.size(), i + kPointsPerChunk);
    while (i < past && !begins(i)) ++i;
    first[piece] = i < past ? i : first[piece + 1];
  }
  parallel_chunks(pieces, 1, threads, [&](std::size_t piece, std::size_t) {
    std::size_t i = first[piece];
    while (i < first[piece + 1]) {
      std::size_t past = i + 1;
      while (past < first[piece + 1] && points[past].code >> shift == points[i].code >> shift) ++past;
      std::sort(points.begin() + static_cast<std::ptrdiff_t>(i),
                points.begin() + static_cast<std::ptrdiff_t>(past), before);
      i = past;
    }
  });
}

/// Fewer points say little of their distance; the node says more, as its parent has too many for a cell.
constexpr std::uint32_t kFewPoints = 64;
/// A step of stored coordinates, in spacings of the cell: lost in what the points say of the surface anyway.
constexpr double kQuantumSpacings = 0.1;
/// A node's edge in spacings if a surface filled it: the root of kMostCellPoints.
constexpr double kSpacingsPerEdge = 64.0;

/// Distance of neighbours, from the area of the box's largest face, or its length where it has no area.
double spacing_mm(const CellEntry& cell, const CellLattice& lattice) noexcept {
  std::array<double, 3> extent{};
  for (std::size_t axis = 0; axis < 3; ++axis)
    extent[axis] = static_cast<double>(cell.high[axis] - cell.low[axis]) * lattice.unit_mm();
  std::sort(extent.begin(), extent.end());
  const double n = cell.points;
  const double spacing = std::max(std::sqrt(extent[2] * extent[1] / n), extent[2] / n);
  if (cell.points >= kFewPoints) return spacing;
  return std::max(spacing, lattice.node_edge_mm(cell.depth) / kSpacingsPerEdge);
}

class Cutter {
 public:
  Cutter(std::span<const PackedPoint> sorted, const CutRules& rules) noexcept
      : sorted_(sorted), rules_(&rules) {}

  void cut(std::size_t begin, std::size_t end, const CellKey& key, int depth,
           std::vector<CellEntry>& cells) const {
    if (depth == kKeyBits) return cut_equal(begin, end, key, cells);
    if (end - begin <= kMostCellPoints) {
      const CellEntry cell = measured(begin, end, key, depth);
      if (fine_enough(cell)) {
        cells.push_back(cell);
        return;
      }
    }
    const int axis = 2 - depth % 3;
    const int bit = kAxisBits - 1 - depth / 3;
    const auto upper = [&](const PackedPoint& p) {
      return (p.point()[static_cast<std::size_t>(axis)] >> bit & 1u) != 0;
    };
    const auto first = sorted_.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto past = sorted_.begin() + static_cast<std::ptrdiff_t>(end);
    const auto middle = std::partition_point(first, past, [&](const PackedPoint& p) { return !upper(p); });
    const std::size_t split = static_cast<std::size_t>(middle - sorted_.begin());
    if (split > begin) cut(begin, split, key, depth + 1, cells);
    if (split == end) return;
    CellKey above = key;
    if (depth < kCodeBits)
      above.high |= std::uint64_t{1} << (kCodeBits - 1 - depth);
    else
      above.low |= std::uint64_t{1} << (kKeyBits - 1 - depth);
    cut(split, end, above, depth + 1, cells);
  }

 private:
  /// Equal points are interchangeable: cut by their number.
  void cut_equal(std::size_t begin, std::size_t end, const CellKey& key,
                 std::vector<CellEntry>& cells) const {
    for (; begin < end; begin += kMostCellPoints)
      cells.push_back(measured(begin, std::min<std::size_t>(end, begin + kMostCellPoints), key, kKeyBits));
  }
  [[nodiscard]] CellEntry measured(std::size_t begin, std::size_t end, const CellKey& key, int depth) const {
    CellEntry cell;
    cell.key = key;
    cell.depth = static_cast<std::uint8_t>(depth);
    cell.points = static_cast<std::uint32_t>(end - begin);
    cell.low = cell.high = sorted_[begin].point();
    for (std::size_t i = begin + 1; i < end; ++i) {
      const LatticePoint p = sorted_[i].point();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        cell.low[axis] = std::min(cell.low[axis], p[axis]);
        cell.high[axis] = std::max(cell.high[axis], p[axis]);
      }
    }
    cell.halo_mm = rules_->halo_spacings * spacing_mm(cell, rules_->lattice);
    return cell;
  }
  /// True if a cell is fine enough with the widest halo that it may get.
  [[nodiscard]] bool fine_enough(const CellEntry& cell) const noexcept {
    const auto grow =
        static_cast<std::uint64_t>(std::ceil(std::ldexp(cell.halo_mm, -rules_->lattice.unit_exponent)));
    LatticePoint low = cell.low, high = cell.high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] -= std::min(low[axis], grow);
      high[axis] += grow;
    }
    const double quantum_mm = std::ldexp(rules_->lattice.unit_mm(), quantum_shift(low, high));
    const double spacing = spacing_mm(cell, rules_->lattice);
    return quantum_mm <= rules_->quantum_mm && (quantum_mm <= kQuantumSpacings * spacing || spacing == 0.0);
  }

  std::span<const PackedPoint> sorted_;
  const CutRules* rules_;
};

}  // namespace

void sort_points(std::vector<PackedPoint>& points, int threads) {
  std::vector<CodedPoint> coded(points.size());
  const std::size_t pieces = (points.size() + kPointsPerChunk - 1) / kPointsPerChunk;
  std::vector<std::uint64_t> differ(pieces, 0);
  const std::uint64_t some = points.empty() ? 0 : upper_code(points.front().point());
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      coded[i] = {upper_code(points[i].point()), points[i]};
      differ[begin / kPointsPerChunk] |= coded[i].code ^ some;
    }
  });
  const std::uint64_t all =
      std::accumulate(differ.begin(), differ.end(), std::uint64_t{0}, std::bit_or<std::uint64_t>());
  const int bits = 64 - std::countl_zero(all);
  const int shift = std::max(bits - kRadixBits, 0);
  radix_sort(coded, bits - shift, threads, [shift](const CodedPoint& p) { return p.code >> shift; });
  sort_runs(coded, shift, threads);
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) points[i] = coded[i].point;
  });
}

std::uint8_t quantum_shift(const LatticePoint& low, const LatticePoint& high) noexcept {
  std::uint8_t shift = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    while ((high[axis] >> shift) - (low[axis] >> shift) > kMostSteps) ++shift;
  return shift;
}

std::vector<CellEntry> cut_cells(std::span<const PackedPoint> sorted, std::span<const CountedNode> nodes,
                                 const CutRules& rules, int threads) {
  const Cutter cutter(sorted, rules);
  std::vector<std::size_t> first(nodes.size() + 1, 0);
  for (std::size_t i = 0; i < nodes.size(); ++i)
    first[i + 1] = first[i] + static_cast<std::size_t>(nodes[i].points);
  std::vector<std::vector<CellEntry>> cells(nodes.size());
  parallel_chunks(nodes.size(), 1, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      cutter.cut(first[i], first[i + 1], nodes[i].key, nodes[i].depth, cells[i]);
  });
  std::vector<CellEntry> all;
  for (const std::vector<CellEntry>& some : cells) all.insert(all.end(), some.begin(), some.end());
  return all;
}

}  // namespace palpate::prepared
