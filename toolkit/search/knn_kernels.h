// Inner loops of the neighbour search: portable, and with AVX2 if the processor has it (checked once), with
// the same results. Internal to search.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include <palpate/vec.h>
#include "toolkit/core/simd.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::search {

inline constexpr double kNoLimit = std::numeric_limits<double>::infinity();

/// An uninitialised array; growing loses its content. Loops step by kLanes, so arrays have room for one step
/// past their size.
template <class T>
class ScratchArray {
 public:
  void at_least(std::size_t n) {
    if (n <= size_) return;
    size_ = n + n / 2;
    data_ = std::make_unique_for_overwrite<T[]>(size_);
  }
  [[nodiscard]] T* data() noexcept { return data_.get(); }
  [[nodiscard]] const T* data() const noexcept { return data_.get(); }
  [[nodiscard]] T& operator[](std::size_t i) noexcept { return data_[i]; }
  [[nodiscard]] const T& operator[](std::size_t i) const noexcept { return data_[i]; }

 private:
  std::unique_ptr<T[]> data_;
  std::size_t size_ = 0;
};

/// Possible neighbours, local coordinates in mm, floats as in the cloud. Of coincident points only the nine
/// of lowest index: a point needs at most eight others at distance 0.
class Candidates {
 public:
  ScratchArray<float> x, y, z;
  ScratchArray<std::uint32_t> index;  ///< into the cloud

  /// Room for n candidates and a step; loses the content when it grows.
  void make_room(std::size_t n) {
    x.at_least(n + 2 * kLanes);
    y.at_least(n + 2 * kLanes);
    z.at_least(n + 2 * kLanes);
    index.at_least(n + 2 * kLanes);
  }
  /// Ends the list at n with a step of coordinates beyond any limit.
  void close(std::size_t n) noexcept {
    size_ = n;
    for (std::size_t i = n; i < n + kLanes; ++i) {
      x[i] = y[i] = z[i] = std::numeric_limits<float>::quiet_NaN();
      index[i] = 0;
    }
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  std::size_t size_ = 0;
};

/// A builder's memory between the points of a chunk: sieved candidates, a guess from the last point (affects
/// time only), and three sums.
struct KnnScratch {
  std::size_t count = 0;              ///< candidates kept
  ScratchArray<std::uint32_t> index;  ///< per kept candidate, into the cloud
  ScratchArray<double> square;        ///< squared distance, mm^2
  ScratchArray<double> along;         ///< distance along the farthest axis, mm; only after keep_cube
  ScratchArray<std::uint32_t> kept;   ///< position among the candidates

  double guess = kNoLimit;
  std::size_t size_guess = 0;
  std::array<std::uint64_t, 3> sums{};

  void make_room(std::size_t candidates) {
    index.at_least(candidates + 2 * kLanes);
    square.at_least(candidates + 2 * kLanes);
    along.at_least(candidates + 2 * kLanes);
    kept.at_least(candidates + 2 * kLanes);
  }
};

/// Numbers of kept candidates in a cube and in a smaller one.
struct CubeCounts {
  std::size_t outer = 0, inner = 0;
};

struct Kernels {
  /// Keeps, in order, every candidate within the limit of `p`, and perhaps some a rounding farther.
  void (*keep_ball)(const Candidates& candidates, const Vec3& p, double limit_sq_mm2, KnnScratch& scratch);
  /// The same for the cube of half edge `half_mm`; also stores distances along the farthest axis.
  void (*keep_cube)(const Candidates& candidates, const Vec3& p, double half_mm, KnnScratch& scratch);
  /// Counts kept candidates in the cubes of half edges `outer_mm` and `inner_mm`, by KnnScratch::along.
  CubeCounts (*count_in_cubes)(const KnnScratch& scratch, double outer_mm, double inner_mm);
  /// Makes the squares of kept candidates outside the cube infinite.
  void (*exclude_cube)(KnnScratch& scratch, double half_mm);
  /// The eight kept candidates with the smallest (square, index), in order, without `self` and infinite ones;
  /// unused places hold `self`. Returns the largest square chosen, infinite for fewer than eight.
  double (*choose_eight)(std::uint32_t self, const KnnScratch& scratch, Neighbours& out);
};

[[nodiscard]] const Kernels& portable_kernels() noexcept;
/// The fastest that this processor runs.
[[nodiscard]] const Kernels& kernels() noexcept;

/// Keeps the eight smallest (key, index) pairs.
class NearestEight {
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
  /// The largest kept key; infinite with fewer than eight.
  [[nodiscard]] double worst() const noexcept { return key_[kNeighbours - 1]; }
  /// Fills `out`; unused places hold `self`.
  void store(std::uint32_t self, Neighbours& out) const noexcept {
    for (std::size_t i = 0; i < kNeighbours; ++i) out[i] = i < count_ ? index_[i] : self;
  }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double key_[kNeighbours] = {kNone, kNone, kNone, kNone, kNone, kNone, kNone, kNone};
  std::uint32_t index_[kNeighbours] = {~0u, ~0u, ~0u, ~0u, ~0u, ~0u, ~0u, ~0u};
  std::size_t count_ = 0;
};

}  // namespace palpate::search
