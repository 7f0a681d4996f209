// Internal to neighbourhood: the inner loops of the neighbour search. Every processor runs the portable ones;
// where the processor has AVX2 (asked once, at run time) the same results come from wider registers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "toolkit/core/vec.h"
#include "toolkit/neighbourhood/neighbour_table.h"

namespace palpate::neighbourhood {

inline constexpr double kEverything = std::numeric_limits<double>::infinity();

/// What one step of the loops handles: arrays that they read or write have room for a step past their size.
inline constexpr std::size_t kStep = 8;

/// An array whose elements are written before they are read: growing neither clears nor keeps them.
template <class T>
class Room {
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

/// Points that may be neighbours, local coordinates in mm, floats as the cloud has them. Of more than nine
/// points at one place only the nine of lowest index are candidates: a point needs no more than eight others
/// at distance 0.
class Candidates {
 public:
  Room<float> x, y, z;
  Room<std::uint32_t> index;  ///< into the cloud

  /// Room for n candidates and a step; what was there is lost when it grows.
  void make_room(std::size_t n) {
    x.at_least(n + 2 * kStep);
    y.at_least(n + 2 * kStep);
    z.at_least(n + 2 * kStep);
    index.at_least(n + 2 * kStep);
  }
  /// Ends the list at n: a step of coordinates that no limit lets through follows.
  void close(std::size_t n) noexcept {
    size_ = n;
    for (std::size_t i = n; i < n + kStep; ++i) {
      x[i] = y[i] = z[i] = std::numeric_limits<float>::quiet_NaN();
      index[i] = 0;
    }
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }

 private:
  std::size_t size_ = 0;
};

/// What a builder keeps from point to point within a chunk of cells: the candidates that passed a sieve, a
/// guess from the last point (it changes the time, never the result) and three sums of its own.
struct Scratch {
  std::size_t count = 0;      ///< candidates kept
  Room<std::uint32_t> index;  ///< of each kept candidate, into the cloud
  Room<double> square;        ///< its squared distance, mm^2
  Room<double> along;         ///< its distance along the farthest axis, mm; only after keep_cube
  Room<std::uint32_t> kept;   ///< its position among the candidates

  double guess = kEverything;
  std::size_t size_guess = 0;
  std::array<std::uint64_t, 3> sums{};

  void make_room(std::size_t candidates) {
    index.at_least(candidates + 2 * kStep);
    square.at_least(candidates + 2 * kStep);
    along.at_least(candidates + 2 * kStep);
    kept.at_least(candidates + 2 * kStep);
  }
};

/// How many of the kept lie in a cube, and how many in a smaller one.
struct Held {
  std::size_t outer = 0, inner = 0;
};

struct Kernels {
  /// Sieves the candidates: scratch gets, in order, every candidate within the limit of `p` and perhaps some
  /// a rounding farther.
  void (*keep_ball)(const Candidates& candidates, const Vec3& p, double limit_sq_mm2, Scratch& scratch);
  /// The same for the cube of half edge `half_mm`, with the distances along the farthest axis as well.
  void (*keep_cube)(const Candidates& candidates, const Vec3& p, double half_mm, Scratch& scratch);
  /// Kept candidates in the cubes of half edges `outer_mm` and `inner_mm`, by Scratch::along.
  Held (*count_in_cubes)(const Scratch& scratch, double outer_mm, double inner_mm);
  /// Puts the kept candidates outside the cube out of reach: their squares become infinite.
  void (*leave_out)(Scratch& scratch, double half_mm);
  /// The eight kept candidates with the smallest (square, index), in that order; `self` and those out of
  /// reach left out; `self` in unused places. Returns the largest square chosen, infinite where there are
  /// fewer than eight.
  double (*choose_eight)(std::uint32_t self, const Scratch& scratch, Neighbours& out);
};

[[nodiscard]] const Kernels& portable_kernels() noexcept;
/// The fastest that this processor runs.
[[nodiscard]] const Kernels& kernels() noexcept;

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
