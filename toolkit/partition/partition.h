// What every spatial partition answers: the three of section 3.1.2 behind one concept, chosen when a model is
// prepared, so that a frame pays for none but its own.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/vec.h"
#include "toolkit/partition/morton_order.h"

namespace palpate::partition {

/// Places [begin, end) in a partition's order.
struct PlaceRange {
  std::uint32_t begin = 0;
  std::uint32_t end = 0;
  [[nodiscard]] bool empty() const noexcept { return begin == end; }
};

/// Section 3.1.2.1: a node of the modified octree holds up to ten points.
inline constexpr std::uint32_t kPointsPerLeaf = 10;

struct PartitionOptions {
  /// Edge of a grid cell, > 0. Trees choose their own sizes and ask for it only where all points coincide.
  double cell_mm = 1.0;
  std::uint32_t max_points = kPointsPerLeaf;  ///< of a tree's leaf; more where `max_depth` stops dividing
  int max_depth = kMortonBits;                ///< of a tree, 0 .. kMortonBits; 0 is the root alone
  /// Of partitions that follow moving points: spare cells or nodes, as a share of those built.
  double spare = 0.25;
  /// Of partitions that follow moving points: places beyond the cloud's that may be added later.
  std::size_t spare_places = 0;
};

/// The shape of a partition as it stands.
struct LeafStatistics {
  std::size_t leaves = 0;        ///< cells or leaves that hold points
  std::size_t nodes = 0;         ///< hash slots of a grid; all nodes of a tree, empty and inner ones too
  std::uint32_t max_points = 0;  ///< of a leaf
  double mean_points = 0.0;      ///< of a leaf that holds points
  int max_depth = 0;             ///< steps from the root to the deepest leaf; 0 for a grid
};

namespace detail {
/// Any visitor: stands in the concept for callables of type bool(PlaceRange).
struct AnyVisitor {
  bool operator()(PlaceRange) const noexcept { return true; }
};
}  // namespace detail

/// All positions are in the cloud's local coordinates, mm; a place is an index into the partition's order.
///
/// - P::build(cloud, options, threads): O(n log n), the same for any number of threads.
/// - order(): the cloud's index of each place; the points of a leaf are contiguous.
/// - visit_ranges(p, a, b, reach, visit): calls visit(range) for every leaf that the segment from a to b,
///   widened by `reach` on each axis, touches; some more near corners, and ranges may be empty. Every place
///   comes at most once. The order is fixed by the partition alone. visit returns false to stop; the call
///   returns false when stopped. Allocates nothing; stack bounded by the depth. Ends that are not finite
///   touch nothing.
/// - visit_at(p, point, visit): the same for the one leaf that holds `point`.
/// - bytes(), statistics().
template <class P>
concept Partition = requires(const P& p, const Vec3& at_mm, const cloud::Cloud& cloud,
                             const PartitionOptions& options, detail::AnyVisitor visit) {
  { P::build(cloud, options, 0) } -> std::same_as<P>;
  { p.order() } -> std::convertible_to<std::span<const std::uint32_t>>;
  { p.bytes() } -> std::convertible_to<std::size_t>;
  { p.statistics() } -> std::same_as<LeafStatistics>;
  { visit_ranges(p, at_mm, at_mm, at_mm, visit) } -> std::same_as<bool>;
  { visit_at(p, at_mm, visit) } -> std::same_as<bool>;
};

/// A stored point in double, exactly. A function in a unit of its own on purpose: where both conversions of
/// double -> float -> double stand in one function, GCC 12 vectorises them away at -O2 (three components of a
/// point are enough), and a point would be looked for a rounding beside where it is stored.
[[nodiscard]] Vec3 widened(const Vec3f& stored) noexcept;

/// What became of a moved point.
enum class MoveStatus : std::uint8_t {
  kStays,  ///< in its leaf: nothing had to change
  kMoved,
  kFull,  ///< no spare room, or too far away: nothing was changed, and the point must stay where it was
};

namespace detail {
/// Any answer to "where is this place now?".
struct AnyPositions {
  Vec3f operator()(std::uint32_t) const noexcept { return Vec3f::Zero(); }
};
}  // namespace detail

/// A partition that follows points as they move, also out of the cloud's first box. The points stay with
/// their owner, as floats: p.move(place, to, at) is told where every point is by at(place), `to` not yet
/// applied, and keeps no positions. After anything but kFull the owner stores `to`. A point that is not
/// finite is refused as too far away. Places keep their numbers; a place far from its leaf's others is
/// visited as a range of its own, so every place still comes at most once. move allocates nothing and its
/// work is bounded by the depth and the points of a leaf, not by the cloud. Not to be read while it moves.
/// p.add(place, where, at) takes in a point that the cloud did not have, its place beyond the cloud's, below
/// its size plus PartitionOptions::spare_places and not taken in already: kMoved or kFull. p.remove(place,
/// where) takes out one that was added.
template <class P>
concept DynamicPartition = Partition<P> && requires(P& p, const Vec3f& to_mm, detail::AnyPositions at) {
  { p.move(0u, to_mm, at) }
  noexcept->std::same_as<MoveStatus>;
  { p.add(0u, to_mm, at) }
  noexcept->std::same_as<MoveStatus>;
  p.remove(0u, to_mm);
  { p.spare_left() } -> std::same_as<std::size_t>;
};

}  // namespace palpate::partition
