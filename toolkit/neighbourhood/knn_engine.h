// Internal to neighbourhood: candidates for the neighbours of every point, gathered cell by cell from a
// sorted cloud. Builders differ only in how they choose eight of the candidates.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/partition/morton_order.h"

namespace palpate::neighbourhood {

/// Points that may be neighbours, local coordinates in mm, floats as the cloud has them. Of more than nine
/// points at one place only the nine of lowest index are candidates: a point needs no more than eight others
/// at distance 0.
struct Candidates {
  std::vector<float> x, y, z;
  std::vector<std::uint32_t> index;  ///< into the cloud
  void resize(std::size_t n) {
    x.resize(n);
    y.resize(n);
    z.resize(n);
    index.resize(n);
  }
  /// Places [begin, end) of `from` to `at` and on.
  void copy(std::size_t at, const Candidates& from, std::size_t begin, std::size_t end) noexcept {
    for (std::size_t i = begin; i < end; ++i, ++at) {
      x[at] = from.x[i];
      y[at] = from.y[i];
      z[at] = from.z[i];
      index[at] = from.index[i];
    }
  }
  [[nodiscard]] std::size_t size() const noexcept { return index.size(); }
};

inline constexpr double kEverything = std::numeric_limits<double>::infinity();
/// The next guess of a squared distance where one was too small: half as far again; from 0 (piles)
/// everything.
[[nodiscard]] inline double larger_guess(double guess) noexcept {
  return guess > 0.0 ? 1.5 * 1.5 * guess : kEverything;
}

/// What a builder keeps from point to point within a chunk of cells: room for its loops, a guess from the
/// last point (it changes the time, never the result) and three sums of its own.
struct Scratch {
  std::vector<float> rough;         ///< one a candidate, rounded: for the first sieve
  std::vector<std::uint32_t> kept;  ///< candidates that passed it
  std::vector<double> key;          ///< one a kept candidate, exact
  double guess = kEverything;
  std::size_t size_guess = 0;
  std::array<std::uint64_t, 3> sums{};
};

/// Chooses the neighbours of the point `self` at `p` from candidates that hold every point within `radius_mm`
/// of it (in the Chebyshev sense too, since a cube of half edge radius_mm is covered). Returns false when a
/// larger radius is needed. Called from several threads, each with scratch of its own.
using Choose = std::function<bool(std::uint32_t self, const Vec3& p, const Candidates& candidates,
                                  double radius_mm, Neighbours& out, Scratch& scratch)>;

/// A cloud sorted for neighbour search.
class KnnEngine {
 public:
  KnnEngine(const cloud::Cloud& cloud, int threads);
  ~KnnEngine();

  /// Calls `choose` for every point until it accepts; each point's final radius covers the whole cloud. The
  /// sums of all scratches. With `wanted` (by cloud index) only for points marked there; the others' rows
  /// stay.
  std::array<std::uint64_t, 3> run(const Choose& choose, NeighbourTable& table,
                                   std::span<const std::uint8_t> wanted = {}) const;
  /// sqrt(occupied area / points), the area from occupied cells: the length that start sizes are given in.
  [[nodiscard]] double mean_spacing_mm() const noexcept { return mean_spacing_mm_; }

 private:
  struct Fallback;
  struct Level;
  struct Pass;
  void find_lattice();
  void limit_piles();
  void copy_places();
  bool gather(const Level& level, const std::array<std::int64_t, 3>& at, Candidates& candidates) const;
  void run_level(const Level& level, const Choose& choose, NeighbourTable& table, Pass& pass,
                 std::span<const std::uint8_t> pending) const;
  void run_tree(const Choose& choose, NeighbourTable& table, Pass& pass) const;

  const cloud::Cloud& cloud_;
  int threads_;
  double mean_spacing_mm_ = 1.0;
  partition::Lattice lattice_;
  partition::MortonOrder sorted_;
  Candidates places_;  ///< all points in the order of the sort
  std::vector<std::uint8_t>
      candidate_;  ///< by place: 0 for the tenth and later points of one place; or empty
  int first_level_ = 0;
  std::unique_ptr<Fallback> fallback_;
};

/// Sieves the candidates: scratch.kept gets, in order, every candidate within `limit_mm` of `p` and perhaps
/// some a rounding farther; scratch.key their squared distances.
void keep_ball(const Candidates& candidates, const Vec3& p, double limit_sq_mm2, Scratch& scratch);
/// The same for the cube of half edge `half_mm`, with the distances along the farthest axis for keys.
void keep_cube(const Candidates& candidates, const Vec3& p, double half_mm, Scratch& scratch);

/// The eight of the kept candidates with the smallest (key, index), in that order, `self` left out and put
/// into unused places. Returns the largest key chosen, infinite where there are fewer than eight.
double choose_eight(std::uint32_t self, const Candidates& candidates, const Scratch& scratch,
                    Neighbours& out) noexcept;

/// Keeps the eight smallest (key, index) pairs seen.
class BestEight {
 public:
  void offer(double key, std::uint32_t index) noexcept {
    if (!(key < key_[kNeighbours - 1] || (key == key_[kNeighbours - 1] && index < index_[kNeighbours - 1])))
      return;
    std::size_t at = kNeighbours - 1;
    while (at > 0 && (key < key_[at - 1] || (key == key_[at - 1] && index < index_[at - 1]))) {
      key_[at] = key_[at - 1];
      index_[at] = index_[at - 1];
      --at;
    }
    key_[at] = key;
    index_[at] = index;
    if (count_ < kNeighbours) ++count_;
  }
  [[nodiscard]] std::size_t count() const noexcept { return count_; }
  /// The largest key kept; infinite while fewer than eight were seen.
  [[nodiscard]] double worst() const noexcept { return key_[kNeighbours - 1]; }
  /// Fills `out`, unused places with `self`.
  void store(std::uint32_t self, Neighbours& out) const noexcept {
    for (std::size_t i = 0; i < kNeighbours; ++i) out[i] = i < count_ ? index_[i] : self;
  }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double key_[kNeighbours] = {kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
  std::uint32_t index_[kNeighbours] = {~0u, ~0u, ~0u, ~0u, ~0u, ~0u, ~0u, ~0u};
  std::size_t count_ = 0;
};

}  // namespace palpate::neighbourhood
