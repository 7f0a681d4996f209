// Concept of a spatial partition (section 3.1.2). The choice is made in preparation, so frames have no
// dispatch cost.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include "toolkit/search/morton_order.h"

namespace palpate::search {

/// Places [begin, end) in a partition's order.
struct IndexRange {
  std::uint32_t begin = 0;
  std::uint32_t end = 0;
  [[nodiscard]] bool empty() const noexcept { return begin == end; }
};

/// Section 3.1.2.1: a node of the modified octree holds up to ten points.
inline constexpr std::uint32_t kPointsPerLeaf = 10;

struct PartitionOptions {
  /// Edge of a grid cell, > 0. Trees use it only if all points coincide.
  double cell_mm = 1.0;
  std::uint32_t max_points = kPointsPerLeaf;  ///< of a tree's leaf; exceeded where `max_depth` stops division
  int max_depth = kMortonBits;                ///< of a tree, 0 .. kMortonBits; 0: the root only
  /// For moving points: spare cells, as a share of those built.
  double spare = 0.25;
};

/// The current shape of a partition.
struct LeafStatistics {
  std::size_t leaves = 0;        ///< non-empty cells or leaves
  std::size_t nodes = 0;         ///< hash slots of a grid; all nodes of a tree
  std::uint32_t max_points = 0;  ///< of a leaf
  double mean_points = 0.0;      ///< of a non-empty leaf
  int max_depth = 0;             ///< from the root to the deepest leaf; 0 for a grid
};

namespace detail {
/// Any visitor of type bool(IndexRange), for the concept.
struct AnyVisitor {
  bool operator()(IndexRange) const noexcept { return true; }
};
}  // namespace detail

/// Positions are local coordinates, mm; a place is an index into the partition's order.
/// - P::build(cloud, options, threads): O(n log n), independent of the number of threads.
/// - order(): cloud index per place; a leaf's points are contiguous.
/// - visit_segment_ranges(p, a, b, reach, visit): calls visit(range) for every leaf that the segment a b,
///  widened by `reach` per axis, touches; also some near corners and empty ranges. Every place comes at
///  most once, in an order fixed by the partition. Stops, and returns false, when visit returns false.
///  Allocates nothing; stack bounded by the depth. Non-finite ends touch nothing.
/// - visit_point_range(p, point, visit): the same for the leaf that holds `point`.
/// - bytes(), statistics().
template <class P>
concept Partition = requires(const P& p, const Vec3& at_mm, const cloud::Cloud& cloud,
                             const PartitionOptions& options, detail::AnyVisitor visit) {
  { P::build(cloud, options, 0) } -> std::same_as<P>;
  { p.order() } -> std::convertible_to<std::span<const std::uint32_t>>;
  { p.bytes() } -> std::convertible_to<std::size_t>;
  { p.statistics() } -> std::same_as<LeafStatistics>;
  { visit_segment_ranges(p, at_mm, at_mm, at_mm, visit) } -> std::same_as<bool>;
  { visit_point_range(p, at_mm, visit) } -> std::same_as<bool>;
};

}  // namespace palpate::search
