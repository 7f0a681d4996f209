// Places that have left the range they were built into, listed by the leaf they are in now.
#pragma once

#include <bit>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/partition/partition.h"

namespace palpate::partition {

/// What a leaf of a moving partition holds beside its own range of places.
struct LeafState {
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::uint32_t head = kNone;  ///< the first place listed here
  std::uint32_t listed = 0;    ///< how many are
  std::uint32_t away = 0;      ///< how many of the own range are listed elsewhere
};

/// One list a leaf, linked through two numbers a place, so that any place can be taken out of the middle of
/// its list and no pool can run out. 8 1/8 bytes a point. All calls O(1) but visit.
class MovedPlaces {
 public:
  explicit MovedPlaces(std::size_t places = 0) : links_(places), away_((places + 63) / 64, 0) {}

  [[nodiscard]] bool is_away(std::uint32_t place) const noexcept {
    return (away_[place / 64] >> (place % 64) & 1u) != 0;
  }

  /// Takes a place into a leaf whose own range is `home`: back into the range, or onto the list.
  void enter(LeafState& leaf, PlaceRange home, std::uint32_t place) noexcept {
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
  /// Takes a place out of the leaf that it is in; it must enter another.
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
  /// A place beyond every leaf's own range: it is nowhere until it enters a leaf, and again after it left.
  void add(std::uint32_t place) noexcept { away_[place / 64] |= std::uint64_t{1} << place % 64; }
  [[nodiscard]] std::size_t places() const noexcept { return links_.size(); }

  /// Calls visit(range) for all places of a leaf: what is left of its range, in runs, then the list.
  template <class Visit>
  bool visit(const LeafState& leaf, PlaceRange home, Visit&& visit) const {
    if (leaf.away == 0) {
      if (!home.empty() && !visit(home)) return false;
    } else {
      for (std::uint32_t at = home.begin; at < home.end;) {
        const std::uint32_t run = run_end(at, home.end);
        if (run > at && !visit(PlaceRange{at, run})) return false;
        at = run + 1;
      }
    }
    for (std::uint32_t place = leaf.head; place != LeafState::kNone; place = links_[place].after)
      if (!visit(PlaceRange{place, place + 1})) return false;
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

  LargeVector<Link> links_;
  LargeVector<std::uint64_t> away_;
};

}  // namespace palpate::partition
