// Gathers neighbour candidates of every point, cell by cell. The cloud is sorted; builders choose eight
// candidates. Internal to search.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include "toolkit/search/knn_kernels.h"
#include "toolkit/search/morton_order.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

/// A point's squared limit is the last point's, with an eighth of the distance to spare.
inline constexpr double kGuessMarginSq = 1.125 * 1.125;
/// The next guess of a squared distance: 1.5 times as far; from 0 (piles) everything.
[[nodiscard]] inline double larger_guess(double guess) noexcept {
  return guess > 0.0 ? 1.5 * 1.5 * guess : kNoLimit;
}

/// Chooses the neighbours of point `self` at `p` from candidates that include every point within `radius_mm`
/// (also in the Chebyshev sense: the cube of half edge radius_mm is covered). Returns false to request a
/// larger radius. Called from several threads, each with its own scratch.
using NeighbourChooser = std::function<bool(std::uint32_t self, const Vec3& p, const Candidates& candidates,
                                            double radius_mm, Neighbours& out, KnnScratch& scratch)>;

/// A cloud sorted for neighbour search.
class KnnEngine {
 public:
  KnnEngine(const cloud::Cloud& cloud, int threads);
  ~KnnEngine();

  /// Calls `choose` for every point until it accepts; the final radius covers the whole cloud. Returns the
  /// sums of all scratches. With `wanted` (by cloud index) only marked points are processed; other rows stay.
  std::array<std::uint64_t, 3> run(const NeighbourChooser& choose, NeighbourTable& table,
                                   std::span<const std::uint8_t> wanted = {}) const;
  /// sqrt(occupied area / points), with the area of occupied cells; the unit of start sizes.
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
  void run_level(const Level& level, const NeighbourChooser& choose, NeighbourTable& table, Pass& pass,
                 std::span<const std::uint8_t> pending) const;
  void run_tree(const NeighbourChooser& choose, NeighbourTable& table, Pass& pass) const;

  const cloud::Cloud& cloud_;
  int threads_;
  double mean_spacing_mm_ = 1.0;
  search::Lattice lattice_;
  search::MortonOrder sorted_;           ///< its order is places_.index, once that is there
  Candidates places_;                    ///< all points in sorted order
  std::vector<std::uint8_t> candidate_;  ///< by place: 0 for the tenth and later coincident points; or empty
  int search_level_ = 0;
  std::unique_ptr<Fallback> fallback_;
};

}  // namespace palpate::search
