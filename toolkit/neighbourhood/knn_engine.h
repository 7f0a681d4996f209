// Internal to neighbourhood: candidates for the neighbours of every point, gathered cell by cell from a
// sorted cloud. Builders differ only in how they choose eight of the candidates.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/neighbourhood/knn_kernels.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/partition/morton_order.h"

namespace palpate::neighbourhood {

/// A point's squared limit is guessed from that of the point before, with an eighth of the distance to spare.
inline constexpr double kGuessRoom = 1.125 * 1.125;
/// The next guess of a squared distance where one was too small: half as far again; from 0 (piles)
/// everything.
[[nodiscard]] inline double larger_guess(double guess) noexcept {
  return guess > 0.0 ? 1.5 * 1.5 * guess : kEverything;
}

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
  [[nodiscard]] Vec3 local_at(std::size_t place) const noexcept {
    return {static_cast<double>(places_.x[place]), static_cast<double>(places_.y[place]),
            static_cast<double>(places_.z[place])};
  }
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
  int search_level_ = 0;
  std::unique_ptr<Fallback> fallback_;
};

}  // namespace palpate::neighbourhood
