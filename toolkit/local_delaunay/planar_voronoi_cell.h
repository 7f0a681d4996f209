// A point's Voronoi cell among neighbours in its plane; the cell's corners are the triangles of the point's
// Delaunay star.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace palpate::local_delaunay {

/// A neighbour in the plane, relative to the point.
struct PlanarPoint {
  double u = 0.0, v = 0.0;
  double half_square = 0.0;  ///< half its power: (|q|^2 + the point's weight - its own) / 2
};

/// Most corners. Random points have six on average and practically never more than 24; further ones are
/// dropped.
inline constexpr std::size_t kMaxCorners = 24;
/// Stands for the cell's initial border instead of a neighbour.
inline constexpr std::uint32_t kOpenSide = 0xFFFFFFFFu;

/// A convex polygon around the origin, counter-clockwise. Allocates nothing.
class PlanarVoronoiCell {
 public:
  /// Starts as the square of half edge `reach`.
  void start(double reach) noexcept {
    static_assert(kMaxCorners % 2 == 0 && kMaxCorners < 32);
    size_ = 4;
    put(0, {reach, reach}, kOpenSide);
    put(1, {-reach, reach}, kOpenSide);
    put(2, {-reach, -reach}, kOpenSide);
    put(3, {reach, -reach}, kOpenSide);
    reach_sq_ = 2.0 * reach * reach;
  }
  /// Removes what is nearer to `q` than to the origin; false if nothing.
  bool cut(const PlanarPoint& q, std::uint32_t side) noexcept;

  [[nodiscard]] bool has_side(std::uint32_t side) const noexcept {
    for (std::size_t i = 0; i < size_; ++i)
      if (side_[i] == side) return true;
    return false;
  }
  [[nodiscard]] std::size_t size() const noexcept { return size_; }
  [[nodiscard]] std::size_t next(std::size_t i) const noexcept { return i + 1 == size_ ? 0 : i + 1; }
  /// The neighbour whose bisector holds the edge from corner i to the next.
  [[nodiscard]] std::uint32_t side(std::size_t i) const noexcept { return side_[i]; }
  /// Squared distance of a corner, and of the farthest.
  [[nodiscard]] double corner_sq(std::size_t i) const noexcept { return u_[i] * u_[i] + v_[i] * v_[i]; }
  [[nodiscard]] double reach_sq() const noexcept { return reach_sq_; }

 private:
  friend class Avx2VoronoiCell;
  struct Corner {
    double u, v;
  };
  [[nodiscard]] Corner between(std::size_t a, double over_a, std::size_t b, double over_b) const noexcept {
    const double t = over_a / (over_a - over_b);
    return {u_[a] + t * (u_[b] - u_[a]), v_[a] + t * (v_[b] - v_[a])};
  }
  void put(std::size_t i, const Corner& corner, std::uint32_t side) noexcept {
    u_[i] = corner.u;
    v_[i] = corner.v;
    side_[i] = side;
  }
  /// Moves the corners from `from` on to `to`. Inlined: memmove calls cost more for so few.
  void move(std::size_t from, std::size_t to) noexcept {
    const auto copy = [this](std::size_t of, std::size_t into) { put(into, {u_[of], v_[of]}, side_[of]); };
    if (to < from)
      for (std::size_t i = from; i < size_; ++i) copy(i, i - from + to);
    else
      for (std::size_t i = size_; i-- > from;) copy(i, i - from + to);
    size_ = size_ + to - from;
  }

  // Separate arrays, for vectorised comparison with a bisector.
  alignas(16) std::array<double, kMaxCorners> u_, v_;
  std::array<std::uint32_t, kMaxCorners> side_;
  std::size_t size_ = 0;
  double reach_sq_ = 0.0;
};

inline bool PlanarVoronoiCell::cut(const PlanarPoint& q, std::uint32_t side) noexcept {
  alignas(16) std::array<double, kMaxCorners> over;
  std::uint32_t beyond = 0;  // bit i: corner i is cut off
#if defined(__SSE2__)
  const __m128d qu = _mm_set1_pd(q.u), qv = _mm_set1_pd(q.v), half_square = _mm_set1_pd(q.half_square);
  for (std::size_t i = 0; i < size_; i += 2) {
    const __m128d along =
        _mm_add_pd(_mm_mul_pd(_mm_load_pd(&u_[i]), qu), _mm_mul_pd(_mm_load_pd(&v_[i]), qv));
    const __m128d two = _mm_sub_pd(along, half_square);
    _mm_store_pd(&over[i], two);
    beyond |= static_cast<std::uint32_t>(_mm_movemask_pd(_mm_cmpgt_pd(two, _mm_setzero_pd()))) << i;
  }
  beyond &= (1u << size_) - 1u;
#else
  for (std::size_t i = 0; i < size_; ++i) {
    over[i] = u_[i] * q.u + v_[i] * q.v - q.half_square;
    beyond |= static_cast<std::uint32_t>(over[i] > 0.0) << i;
  }
#endif
  if (beyond == 0) return false;
  const auto n = static_cast<unsigned>(size_);
  const std::uint32_t all = (1u << n) - 1u;
  // The corners cut off are consecutive; a new corner replaces each end.
  const std::uint32_t before_run = ~beyond & (beyond >> 1 | beyond << (n - 1)) & all;
  if (before_run == 0) {  // all cut off: the point is doubled
    size_ = 0;
    return true;
  }
  const auto first = static_cast<std::size_t>(__builtin_ctz(before_run));  // the last kept corner before the
                                                                           // cut
  const std::size_t begin = next(first);
  const std::uint32_t from_run = (beyond >> begin | beyond << (n - begin)) & all;
  const auto gone = static_cast<std::size_t>(__builtin_ctz(~from_run));
  const std::size_t last = begin + gone - 1 < n ? begin + gone - 1 : begin + gone - 1 - n;
  const std::size_t after = next(last);
  if (size_ - gone + 2 > kMaxCorners) return false;
  const Corner in = between(first, over[first], begin, over[begin]);
  const Corner out = between(after, over[after], last, over[last]);
  const std::uint32_t side_after = side_[last];
  if (gone == 1) {
    move(begin, begin + 1);
    put(begin, in, side);
    put(begin + 1, out, side_after);
  } else {
    put(begin, in, side);
    put(last, out, side_after);
    if (last > begin) {
      if (gone > 2) move(last, begin + 1);
    } else {
      size_ = begin + 1;
      if (last > 0) move(last, 0);
    }
  }
  reach_sq_ = 0.0;
  for (std::size_t i = 0; i < size_; ++i) reach_sq_ = std::max(reach_sq_, corner_sq(i));
  return true;
}

}  // namespace palpate::local_delaunay
