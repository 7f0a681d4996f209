// Lists, per leaf, the places that left the range they were built into.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/search/partition.h"

namespace palpate::search {

/// A leaf's state in a moving partition, besides its range.
struct LeafState {
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::uint32_t head = kNone;  ///< first place of the list
  std::uint32_t listed = 0;    ///< length of the list
  std::uint32_t away = 0;      ///< places of the own range that are listed elsewhere
};

/// A doubly linked list per leaf, stored as two numbers a place: any place can be removed, and no pool runs
/// out. 8 1/8 bytes a point. O(1) except visit.
class MovedPoints {
 public:
  explicit MovedPoints(std::size_t places = 0) : links_(places), away_((places + 63) / 64, 0) {}

  [[nodiscard]] bool is_away(std::uint32_t place) const noexcept {
    return (away_[place / 64] >> (place % 64) & 1u) != 0;
  }

  /// Adds a place to a leaf with range `home`: back into the range, or to the list.
  void enter(LeafState& leaf, IndexRange home, std::uint32_t place) noexcept {
    if (home.begin <= place && place < home.end) {
      away_[place / 64] &= ~(std::uint64_t{1} << place % 64);
      --leaf.away;
      return;
    }
    links_[place] = {LeafState::kNone, leaf.head};
    if (leaf.head != LeafState::kNone) links_[leaf.head].before = place;
    leaf.head = place;
    ++leaf.listed;
  }
  /// Removes a place from its leaf; it must enter another.
  void leave(LeafState& leaf, std::uint32_t place) noexcept {
    if (!is_away(place)) {
      away_[place / 64] |= std::uint64_t{1} << place % 64;
      ++leaf.away;
      return;
    }
    const Link link = links_[place];
    if (link.before != LeafState::kNone)
      links_[link.before].after = link.after;
    else
      leaf.head = link.after;
    if (link.after != LeafState::kNone) links_[link.after].before = link.before;
    --leaf.listed;
  }

  /// Calls visit(range) for all places of a leaf: its remaining range in runs, then the list.
  template <class Visit>
  bool visit(const LeafState& leaf, IndexRange home, Visit&& visit) const {
    if (leaf.away == 0) {
      if (!home.empty() && !visit(home)) return false;
    } else {
      for (std::uint32_t at = home.begin; at < home.end;) {
        const std::uint32_t run = run_end(at, home.end);
        if (run > at && !visit(IndexRange{at, run})) return false;
        at = run + 1;
      }
    }
    for (std::uint32_t place = leaf.head; place != LeafState::kNone; place = links_[place].after)
      if (!visit(IndexRange{place, place + 1})) return false;
    return true;
  }
  [[nodiscard]] std::uint32_t after(std::uint32_t place) const noexcept { return links_[place].after; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return links_.capacity() * sizeof(Link) + away_.capacity() * sizeof(std::uint64_t);
  }

 private:
  struct Link {
    std::uint32_t before = LeafState::kNone, after = LeafState::kNone;
  };
  /// The first place from `at` that is away, at most `end`.
  [[nodiscard]] std::uint32_t run_end(std::uint32_t at, std::uint32_t end) const noexcept {
    while (at < end) {
      const std::uint64_t rest = away_[at / 64] >> at % 64;
      if (rest != 0) return std::min(end, at + static_cast<std::uint32_t>(std::countr_zero(rest)));
      at = (at / 64 + 1) * 64;
    }
    return end;
  }

  LargePageVector<Link> links_;
  LargePageVector<std::uint64_t> away_;
};

}  // namespace palpate::search
