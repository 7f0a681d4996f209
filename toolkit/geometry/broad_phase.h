// Broad-phase collision detection: which of many boxes are near the probe. The slow loop of the four-rate
// structure in section 2.2.4 of the thesis.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/geometry/aabb_tree.h"

namespace palpate::geometry {

/// One box found by a query.
struct BoxHit {
  std::uint32_t item = 0;
  double distance_sq_mm2 = 0.0;  ///< from the query's centre to the box, 0 inside
};

/// A query's result besides its hits.
struct BoxQuery {
  std::uint32_t hits = 0;      ///< written to the front of the list
  std::uint32_t left_out = 0;  ///< also met, but farther than all hits of a full list
  std::uint32_t nodes = 0;     ///< tree nodes visited
};

/// A query's result as a value: the nearest boxes, at most `Most`.
template <std::size_t Most>
struct FoundBoxes {
  std::array<BoxHit, Most> hit{};
  BoxQuery query;
  [[nodiscard]] std::span<const BoxHit> hits() const noexcept { return {hit.data(), query.hits}; }
};

/// The moving boxes of a scene's models. Only the constructor allocates. One thread updates; concurrent const
/// calls are safe between updates.
class BroadPhase {
 public:
  /// A refitted tree is rebuilt beyond this growth of surface: it visits about twice the nodes, and
  /// rebuilding costs some ten refits.
  static constexpr double kRebuildAreaRatio = 2.0;

  BroadPhase() = default;
  /// World frame, one box per item; empty and NaN boxes are never found.
  explicit BroadPhase(std::span<const Aabb> boxes);

  /// Moves the boxes; their number must not change (asserted). O(n), at times O(n log n).
  void update(std::span<const Aabb> boxes) noexcept;

  /// Finds boxes that meet `region` (touching included), sorted by distance to its centre, ties by number. A
  /// full `list` keeps the nearest and counts the rest. The result does not depend on the tree's history.
  /// Visits at most 2 n nodes, usually O(log n + hits); each hit moves at most list.size() entries.
  BoxQuery query(const Aabb& region, std::span<BoxHit> list) const noexcept;
  /// Boxes within `reach_mm` of the point along each axis.
  template <std::size_t Most>
  void query(const Vec3& centre_mm, double reach_mm, FoundBoxes<Most>& out) const noexcept {
    out.query = query(Aabb{centre_mm, centre_mm}.grown(reach_mm), out.hit);
  }

  /// All boxes that meet `region`, by rising number. `out` must have room for all.
  void within(const Aabb& region, std::vector<std::uint32_t>& out) const noexcept;
  /// The same for boxes within `reach_mm`, along each axis, of the segment. On long ways these are far fewer
  /// than in the box around the way.
  void along_segment(const Vec3& from_mm, const Vec3& to_mm, double reach_mm,
                     std::vector<std::uint32_t>& out) const noexcept;

  [[nodiscard]] std::uint32_t size() const noexcept { return tree_.size(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return tree_.bytes() + boxes_.capacity() * sizeof(Aabb);
  }
  [[nodiscard]] std::uint64_t rebuilds() const noexcept { return rebuilds_; }

 private:
  AabbTree tree_;
  std::vector<Aabb> boxes_;
  std::uint64_t rebuilds_ = 0;
};

}  // namespace palpate::geometry
