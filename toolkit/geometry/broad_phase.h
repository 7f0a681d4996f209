// Broad-phase collision detection: which of many boxes lie near the probe. The slow loop of the four-rate
// structure in section 2.2.4 of the thesis ("narrows down the area examined for collision detection to that
// which is in the vicinity of the haptic tool").
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/geometry/box_tree.h"

namespace palpate::geometry {

/// One box that a query found.
struct BoxHit {
  std::uint32_t item = 0;
  double distance_sq_mm2 = 0.0;  ///< from the middle of the query to the box, 0 inside it
};

/// What a query says besides its hits.
struct BoxQuery {
  std::uint32_t hits = 0;      ///< written to the front of the list
  std::uint32_t left_out = 0;  ///< met too, but further away than all hits of a full list
  std::uint32_t nodes = 0;     ///< of the tree, looked at
};

/// What a query finds, to be copied: the nearest boxes, at most `Most` of them.
template <std::size_t Most>
struct FoundBoxes {
  std::array<BoxHit, Most> hit{};
  BoxQuery query;
  [[nodiscard]] std::span<const BoxHit> hits() const noexcept { return {hit.data(), query.hits}; }
};

/// The boxes of a scene's models, that move. Only the constructor allocates. One thread updates and queries;
/// const calls from many are safe between updates.
class BroadPhase {
 public:
  /// A refitted tree of more than twice its surface is built anew: it then looks at about twice the nodes,
  /// and building costs some ten refits.
  static constexpr double kRebuildGrowth = 2.0;

  BroadPhase() = default;
  /// World frame, one box an item; empty ones and ones with a NaN are never found.
  explicit BroadPhase(std::span<const Aabb> boxes);

  /// The boxes moved; as many as at first (asserted). O(n), at times O(n log n).
  void update(std::span<const Aabb> boxes) noexcept;

  /// Every box that meets `region`, touching included: the nearest to its middle first, equal ones by number.
  /// Where more are met than `list` holds the nearest stay, and the others are counted. Independent of how
  /// the tree was built or refitted. Visits at most 2 n nodes, of the order of log n + hits where few are
  /// met; each hit moves at most list.size() entries.
  BoxQuery query(const Aabb& region, std::span<BoxHit> list) const noexcept;
  /// Every box within `reach_mm` of the point along each axis.
  template <std::size_t Most>
  void query(const Vec3& centre_mm, double reach_mm, FoundBoxes<Most>& out) const noexcept {
    out.query = query(Aabb{centre_mm, centre_mm}.grown(reach_mm), out.hit);
  }

  /// Every box that meets `region`, rising. `out` must have room for all.
  void within(const Aabb& region, std::vector<std::uint32_t>& out) const noexcept;
  /// The same of every box that comes within `reach_mm`, along each axis, of the segment. Of a long way
  /// through many boxes these are few where the box around the way holds nearly all.
  void on_way(const Vec3& from_mm, const Vec3& to_mm, double reach_mm,
              std::vector<std::uint32_t>& out) const noexcept;

  [[nodiscard]] std::uint32_t size() const noexcept { return tree_.size(); }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return tree_.bytes() + boxes_.capacity() * sizeof(Aabb);
  }
  [[nodiscard]] std::uint64_t rebuilds() const noexcept { return rebuilds_; }

 private:
  BoxTree tree_;
  std::vector<Aabb> boxes_;
  std::uint64_t rebuilds_ = 0;
};

}  // namespace palpate::geometry
