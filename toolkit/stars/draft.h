// Internal to stars: what is known of every point while its star is being made.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/vec.h"
#include "toolkit/stars/flat_cell.h"
#include "toolkit/stars/places.h"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

namespace palpate::stars {

/// Nearest points that a star is made of. A random point's star reaches its twelfth neighbour in one of a
/// thousand; sixteen leave some for what the layout rejects.
inline constexpr std::size_t kNear = 16;
using Near = std::array<std::uint32_t, kNear>;
/// In place of a point: none.
inline constexpr std::uint32_t kNoPoint = 0xFFFFFFFFu;

/// The triangles around a point, as it sees them: its ring of neighbours, counter-clockwise about its normal;
/// sector k lies between ring points k and k + 1. Nobody is in a ring twice. What is read of a neighbour's
/// star is mostly in one line of cache.
struct alignas(64) Star {
  std::uint32_t size = 0;
  std::uint32_t open = 0;    ///< bit k: sector k has no triangle
  std::uint32_t agreed = 0;  ///< bit k: the stars of its two other corners have the triangle too
  std::array<std::uint32_t, kMaxCorners> ring{};

  [[nodiscard]] std::uint32_t next(std::uint32_t k) const noexcept { return k + 1 == size ? 0 : k + 1; }
  [[nodiscard]] std::uint32_t previous(std::uint32_t k) const noexcept { return k == 0 ? size - 1 : k - 1; }
  [[nodiscard]] bool has_sector(std::uint32_t k) const noexcept { return (open >> k & 1u) == 0; }
  [[nodiscard]] bool is_agreed(std::uint32_t k) const noexcept { return (agreed >> k & 1u) != 0; }
  [[nodiscard]] bool has_sectors() const noexcept { return open != (1u << size) - 1u; }
  [[nodiscard]] bool has_agreed_all() const noexcept { return agreed == (1u << size) - 1u; }
  [[nodiscard]] std::uint32_t sectors() const noexcept { return size - bits_of(open); }
  [[nodiscard]] std::uint32_t agreements() const noexcept { return bits_of(agreed); }
  /// Where the point stands in the ring, or size.
  [[nodiscard]] std::uint32_t find(std::uint32_t b) const noexcept {
    for (std::uint32_t first = 0; first < size; first += kFound) {
      const unsigned same = same_in(first, b);
      if (same == 0) continue;
      const std::uint32_t k = first + static_cast<std::uint32_t>(__builtin_ctz(same));
      return k < size ? k : size;
    }
    return size;
  }
  /// Whether the triangle with ring point k and c, on either side of k, is in the star; none where k is size.
  [[nodiscard]] bool holds(std::uint32_t k, std::uint32_t c) const noexcept {
    if (k == size) return false;
    if (ring[next(k)] == c && has_sector(k)) return true;
    const std::uint32_t before = previous(k);
    return ring[before] == c && has_sector(before);
  }
  [[nodiscard]] bool closed_and_agreed() const noexcept { return size >= 3 && has_agreed_all(); }

 private:
  static constexpr std::uint32_t kFound = 8;  ///< ring points compared at once
  static_assert(kMaxCorners % kFound == 0 && kMaxCorners < 32);
  /// Bit k: ring point first + k is b, or what stands beyond the ring's end is.
  [[nodiscard]] unsigned same_in(std::uint32_t first, std::uint32_t b) const noexcept {
#if defined(__SSE2__)
    const __m128i wanted = _mm_set1_epi32(static_cast<int>(b));
    const auto four = [&](std::uint32_t at) {
      const __m128i these = _mm_loadu_si128(reinterpret_cast<const __m128i*>(&ring[at]));
      return _mm_cmpeq_epi32(these, wanted);
    };
    const __m128i eight = _mm_packs_epi32(four(first), four(first + kFound / 2));
    return static_cast<unsigned>(_mm_movemask_epi8(_mm_packs_epi16(eight, _mm_setzero_si128())));
#else
    unsigned same = 0;
    for (std::uint32_t k = 0; k < kFound; ++k) same |= static_cast<unsigned>(ring[first + k] == b) << k;
    return same;
#endif
  }
  [[nodiscard]] static std::uint32_t bits_of(std::uint32_t x) noexcept {
    return static_cast<std::uint32_t>(std::popcount(x));
  }
};

struct Draft {
  int threads = 0;
  bool both_sides = false;  ///< see StarBuild
  /// With, as weight, what settles lattices: see find_near.cpp.
  UnsetVector<Placed> point;
  UnsetVector<Near> near;              ///< nearest first, unused places the point's own index
  std::vector<Vec3f> normal;           ///< unit, either sign; zero where there is none
  std::vector<std::uint8_t> welded;    ///< 1: another point stands (nearly) there, it has no star
  std::vector<std::uint8_t> sparse;    ///< 1: `near` are the nearest in each direction, others lie between
  std::vector<std::uint8_t> rough;     ///< 1: its star is flat, see Layout
  std::vector<std::uint8_t> crossed;   ///< 1: another sheet goes through this one here
  std::vector<std::uint8_t> doubtful;  ///< 1: not all that meet in its star agreed, see fill_gaps()
  UnsetVector<Star> star;

  [[nodiscard]] std::size_t size() const noexcept { return point.size(); }
  [[nodiscard]] Vec3 at(std::uint32_t i) const noexcept { return point[i].at(); }
};

/// The nearest points, normals and weights; welds what is `doubled` or nearly. Parallel.
void find_near(Draft& draft, const std::vector<std::uint8_t>& doubled);
/// A star for every point, and where they agree. Parallel.
void make_stars(Draft& draft);
/// The same where some stars are known: near_of_stars() makes the rings of stars the nearest and gives
/// weights for all, find_near_of() finds what `wanted` marks, make_stars_of() lays out the wanted and asks
/// the `asked` for agreement. Empty: all. Parallel.
void near_of_stars(Draft& draft);
void find_near_of(Draft& draft, const std::vector<std::uint8_t>& doubled,
                  std::span<const std::uint8_t> wanted);
void make_stars_of(Draft& draft, std::span<const std::uint8_t> wanted, std::span<const std::uint8_t> asked);
/// Points whose stars the neighbours do not confirm get new ones, laid out along the plane of what is
/// confirmed. Parallel.
void mend_stars(Draft& draft);

/// Squared radius of the ball that holds a point's nearest.
[[nodiscard]] inline double ball_sq(const Draft& draft, std::uint32_t point) noexcept {
  const Near& near = draft.near[point];
  std::size_t last = kNear - 1;
  while (last > 0 && near[last] == point) --last;
  return (draft.at(near[last]) - draft.at(point)).squaredNorm();
}
/// A triangle's circle may be so many times as wide as that ball: of random points one circle of a million
/// is 2.4 mean spacings in radius, the ball 2.3.
inline constexpr double kReachPerBall = 1.5;

/// How a point's surroundings are laid out.
struct Layout {
  Vec3 normal = Vec3::Zero();
  double steepest = 1.0;  ///< a neighbour that rises more than this share of its distance is left out
  bool apart = false;     ///< a neighbour on a sheet that crosses this one is left out
  /// Neighbours are laid out where they stand above the plane, instead of with their distances in space: on a
  /// surface these are what two points agree on, in noise they are what no two do.
  bool flat = false;
};
/// Of the nearest points and `more`. `crossed`, where given, is set to 1 if one was left out as on a sheet
/// that crosses.
[[nodiscard]] Star lay_out(const Draft& draft, std::uint32_t point, const Layout& layout,
                           std::span<const std::uint32_t> more = {}, std::uint8_t* crossed = nullptr);
/// The variance of the nearest across the point's plane, as a part of all: nothing on a plane.
[[nodiscard]] double share_across(const Draft& draft, std::uint32_t point);
/// Bits of the star's sectors that the stars of their corners have too.
[[nodiscard]] std::uint32_t agreed_sectors(const Draft& draft, std::uint32_t point, const Star& star);

}  // namespace palpate::stars
