// Internal to neighbourhood: the shortest links that join the pieces of a cloud.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::neighbourhood {

/// Sets that are joined, each named by its lowest member.
class Pieces {
 public:
  explicit Pieces(std::size_t count);
  [[nodiscard]] std::uint32_t of(std::uint32_t member) noexcept;
  /// False where both were in one piece already.
  bool join(std::uint32_t a, std::uint32_t b) noexcept;
  [[nodiscard]] std::size_t count() const noexcept { return count_; }

 private:
  std::vector<std::uint32_t> parent_;
  std::size_t count_;
};

struct Joint {
  double square_mm2 = 0.0;
  std::uint32_t a = 0, b = 0;  ///< a < b
  friend bool operator<(const Joint& x, const Joint& y) noexcept {
    if (x.square_mm2 != y.square_mm2) return x.square_mm2 < y.square_mm2;
    return x.a != y.a ? x.a < y.a : x.b < y.b;
  }
};

/// Joins all pieces by the shortest set of links, ties by (a, b): pieces - 1 of them, in order. Boruvka's
/// rounds: every piece but the largest takes its closest other one, so their number at least halves. O(n log
/// n) a round.
[[nodiscard]] std::vector<Joint> shortest_joints(const cloud::Cloud& cloud, Pieces& pieces);

}  // namespace palpate::neighbourhood
