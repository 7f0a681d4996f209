#include "toolkit/local_delaunay/avx2_kernels.h"

#include <algorithm>
#include <array>

#include "toolkit/core/simd.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::local_delaunay {

#if defined(__x86_64__)
namespace {

constexpr std::size_t kFour = 4;

/// Byte k of entry m is all ones where bit k of m is set.
constexpr std::array<std::uint64_t, 256> kLaneBytes = [] {
  std::array<std::uint64_t, 256> all{};
  for (unsigned mask = 0; mask < 256; ++mask)
    for (unsigned k = 0; k < kLanes; ++k)
      if ((mask >> k & 1u) != 0) all[mask] |= std::uint64_t{0xFF} << (8 * k);
  return all;
}();

constexpr std::size_t kSixteen = 16;

/// For up to sixteen neighbours: the arguments of PlanarVoronoiCell::cut(), and whether they reach the cell.
struct alignas(32) LaidOut {
  std::array<double, kSixteen> u, v, half_square, half_square_sq, length_sq;
  unsigned usable = 0;  ///< bit k: present, not too steep, not directly above the point

  [[nodiscard]] bool reaches(std::size_t k, double reach_sq) const noexcept {
    return !(half_square[k] > 0.0 && half_square_sq[k] >= reach_sq * length_sq[k]);
  }
};

struct Wide3 {
  __m256d x, y, z;
};
PALPATE_AVX2 inline Wide3 spread(const Vec3& p) noexcept {
  return {_mm256_set1_pd(p.x()), _mm256_set1_pd(p.y()), _mm256_set1_pd(p.z())};
}
/// In the order of Eigen's sums of three.
PALPATE_AVX2 inline __m256d dot(const Wide3& a, const Wide3& b) noexcept {
  return _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(a.x, b.x), _mm256_mul_pd(a.y, b.y)),
                       _mm256_mul_pd(a.z, b.z));
}

PALPATE_AVX2 void lay_out_near(const PlanarFrame& frame, const SortedPoint* point, LaidOut& out) noexcept {
  const Wide3 own = spread(frame.at), e = spread(frame.e), f = spread(frame.f), n = spread(frame.normal);
  const __m256d weight = _mm256_set1_pd(frame.weight), steepest_sq = _mm256_set1_pd(frame.steepest_sq);
  out.usable = 0;
  for (std::size_t k = 0; k < frame.count; k += kFour) {
    const auto neighbour = [&](std::size_t j) { return frame.near[k + j < frame.count ? k + j : k]; };
    __m128 x = _mm_loadu_ps(&point[neighbour(0)].x_mm), y = _mm_loadu_ps(&point[neighbour(1)].x_mm);
    __m128 z = _mm_loadu_ps(&point[neighbour(2)].x_mm), w = _mm_loadu_ps(&point[neighbour(3)].x_mm);
    _MM_TRANSPOSE4_PS(x, y, z, w);
    const Wide3 d = {_mm256_sub_pd(_mm256_cvtps_pd(x), own.x), _mm256_sub_pd(_mm256_cvtps_pd(y), own.y),
                     _mm256_sub_pd(_mm256_cvtps_pd(z), own.z)};
    const __m256d square = dot(d, d), u = dot(e, d), v = dot(f, d), height = dot(n, d);
    const __m256d in_plane = _mm256_add_pd(_mm256_mul_pd(u, u), _mm256_mul_pd(v, v));
    const __m256d weights = _mm256_sub_pd(weight, _mm256_cvtps_pd(w));
    const __m256d half = _mm256_mul_pd(_mm256_set1_pd(0.5), _mm256_add_pd(square, weights));
    const __m256d unfold = _mm256_sqrt_pd(_mm256_div_pd(square, in_plane));
    const __m256d steep =
        _mm256_cmp_pd(_mm256_mul_pd(height, height), _mm256_mul_pd(steepest_sq, square), _CMP_GT_OQ);
    const __m256d beside = _mm256_cmp_pd(in_plane, _mm256_setzero_pd(), _CMP_GT_OQ);
    _mm256_store_pd(&out.u[k], _mm256_mul_pd(u, unfold));
    _mm256_store_pd(&out.v[k], _mm256_mul_pd(v, unfold));
    _mm256_store_pd(&out.length_sq[k], square);
    _mm256_store_pd(&out.half_square[k], half);
    _mm256_store_pd(&out.half_square_sq[k], _mm256_mul_pd(half, half));
    out.usable |= static_cast<unsigned>(_mm256_movemask_pd(_mm256_andnot_pd(steep, beside))) << k;
  }
  out.usable &= (1u << frame.count) - 1u;
}

}  // namespace

/// A cell of up to eight corners in fixed slots; their order around the cell is one byte each in a word.
class Avx2VoronoiCell {
 public:
  enum class Outcome : std::uint8_t { kKept, kCut, kBeyond };

  PALPATE_AVX2 void load(const PlanarVoronoiCell& cell) noexcept {
    size_ = static_cast<unsigned>(cell.size_);
    live_ = (1u << size_) - 1u;
    order_ = 0x0706050403020100u;
    reach_sq_ = cell.reach_sq_;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const bool there = i < size_;
      u_[i] = there ? cell.u_[i] : 0.0;
      v_[i] = there ? cell.v_[i] : 0.0;
      side_[i] = there ? cell.side_[i] : kOpenSide;
    }
    measured_ = true;
  }
  PALPATE_AVX2 void store(PlanarVoronoiCell& cell) noexcept {
    for (unsigned i = 0; i < size_; ++i) {
      const std::size_t slot = slot_of(i);
      cell.put(i, {u_[slot], v_[slot]}, side_[slot]);
    }
    cell.size_ = size_;
    cell.reach_sq_ = reach_sq();
  }
  [[nodiscard]] static bool holds(const PlanarVoronoiCell& cell) noexcept {
    return cell.size_ > 0 && cell.size_ <= kLanes;
  }
  /// The squared distance of the farthest corner, measured on demand: by then scalar stores can be loaded by
  /// fours.
  PALPATE_AVX2 double reach_sq() noexcept {
    if (!measured_) measure();
    return reach_sq_;
  }

  /// As PlanarVoronoiCell::cut(); kBeyond, with nothing changed, if the cell would have too many corners or
  /// none, or loses several runs.
  PALPATE_AVX2 Outcome cut(double u, double v, double half_square, std::uint32_t side) noexcept {
    const unsigned beyond = corners_beyond(u, v, half_square) & live_;
    if (beyond == 0) return Outcome::kKept;
    const unsigned n = size_, all = (1u << n) - 1u;
    const unsigned around = in_turn(beyond) & all;
    const unsigned before_run = ~around & (around >> 1 | around << (n - 1)) & all;
    if (before_run == 0) return Outcome::kBeyond;
    const auto first = static_cast<unsigned>(__builtin_ctz(before_run));
    const unsigned begin = first + 1 == n ? 0 : first + 1;
    const unsigned run = (around >> begin | around << (n - begin)) & all;
    const auto gone = static_cast<unsigned>(__builtin_ctz(~run));
    if (n + 2 - gone > kLanes || run >> gone != 0) return Outcome::kBeyond;
    const unsigned end = begin + gone - 1, last = end < n ? end : end - n;
    const unsigned after = last + 1 == n ? 0 : last + 1;
    const std::size_t into = slot_of(begin), out_of = slot_of(last);
    const __m128d t = share(slot_of(first), into, slot_of(after), out_of);
    const __m128d new_u = between(u_, t, slot_of(first), into, slot_of(after), out_of);
    const __m128d new_v = between(v_, t, slot_of(first), into, slot_of(after), out_of);
    // New corners take the first and last slots of the removed ones, or a free slot.
    const std::size_t spare = gone > 1 ? out_of : static_cast<std::size_t>(__builtin_ctz(~live_));
    live_ = (live_ & ~beyond) | 1u << into | 1u << spare;
    side_[spare] = side_[out_of];
    side_[into] = side;
    put_in_turn(begin, last, into, spare);
    size_ = n + 2 - gone;
    _mm_storel_pd(&u_[into], new_u);
    _mm_storeh_pd(&u_[spare], new_u);
    _mm_storel_pd(&v_[into], new_v);
    _mm_storeh_pd(&v_[spare], new_v);
    measured_ = false;
    return Outcome::kCut;
  }

 private:
  [[nodiscard]] std::size_t slot_of(unsigned turn) const noexcept { return order_ >> (8 * turn) & 0xFFu; }

  /// By slot; leaves the excess in over_.
  PALPATE_AVX2 unsigned corners_beyond(double u, double v, double half_square) noexcept {
    const __m256d qu = _mm256_set1_pd(u), qv = _mm256_set1_pd(v), half = _mm256_set1_pd(half_square);
    const auto over = [&](std::size_t first) PALPATE_AVX2 {
      const __m256d along_u = _mm256_mul_pd(_mm256_load_pd(&u_[first]), qu);
      const __m256d along_v = _mm256_mul_pd(_mm256_load_pd(&v_[first]), qv);
      return _mm256_sub_pd(_mm256_add_pd(along_u, along_v), half);
    };
    const __m256d low = over(0), high = over(kFour);
    _mm256_store_pd(&over_[0], low);
    _mm256_store_pd(&over_[kFour], high);
    const __m256d none = _mm256_setzero_pd();
    return static_cast<unsigned>(_mm256_movemask_pd(_mm256_cmp_pd(low, none, _CMP_GT_OQ))) |
           static_cast<unsigned>(_mm256_movemask_pd(_mm256_cmp_pd(high, none, _CMP_GT_OQ))) << kFour;
  }
  /// Converts bits by slot to bits by turn.
  [[nodiscard]] PALPATE_AVX2 unsigned in_turn(unsigned slots) const noexcept {
    const __m128i bytes = _mm_cvtsi64_si128(static_cast<long long>(kLaneBytes[slots]));
    const __m128i order = _mm_cvtsi64_si128(static_cast<long long>(order_));
    return static_cast<unsigned>(_mm_movemask_epi8(_mm_shuffle_epi8(bytes, order)));
  }
  /// For two edges, each from a kept to a removed corner: the share up to the bisector.
  [[nodiscard]] PALPATE_AVX2 __m128d share(std::size_t stays, std::size_t goes, std::size_t stays2,
                                           std::size_t goes2) const noexcept {
    const __m128d kept = _mm_setr_pd(over_[stays], over_[stays2]);
    return _mm_div_pd(kept, _mm_sub_pd(kept, _mm_setr_pd(over_[goes], over_[goes2])));
  }
  PALPATE_AVX2 static __m128d between(const std::array<double, kLanes>& of, __m128d t, std::size_t stays,
                                      std::size_t goes, std::size_t stays2, std::size_t goes2) noexcept {
    const __m128d kept = _mm_setr_pd(of[stays], of[stays2]);
    return _mm_add_pd(kept, _mm_mul_pd(t, _mm_sub_pd(_mm_setr_pd(of[goes], of[goes2]), kept)));
  }
  /// Removes the corners from turn `begin` to `last` and adds two. Around the end of the turns the second
  /// comes first, as in PlanarVoronoiCell.
  void put_in_turn(unsigned begin, unsigned last, std::size_t into, std::size_t spare) noexcept {
    const auto bytes = [](unsigned count) { return (std::uint64_t{1} << (8 * count)) - 1u; };  // count < 8
    const std::uint64_t behind = order_ >> (8 * last) >> 8;
    const std::uint64_t straight =
        (order_ & bytes(begin)) | (std::uint64_t{into} | std::uint64_t{spare} << 8 | behind << 16)
                                      << (8 * begin);
    const unsigned kept = begin > last ? begin - last - 1 : 0;
    const std::uint64_t around =
        std::uint64_t{spare} | (behind & bytes(kept)) << 8 | std::uint64_t{into} << (8 * kept) << 8;
    order_ = last < begin ? around : straight;
  }
  PALPATE_AVX2 void measure() noexcept {
    const __m128i bytes = _mm_cvtsi64_si128(static_cast<long long>(kLaneBytes[live_]));
    const __m256d low_live = _mm256_castsi256_pd(_mm256_cvtepi8_epi64(bytes));
    const __m256d high_live = _mm256_castsi256_pd(_mm256_cvtepi8_epi64(_mm_srli_si128(bytes, kFour)));
    const auto corner_sq = [this](std::size_t first) PALPATE_AVX2 {
      const __m256d u = _mm256_load_pd(&u_[first]), v = _mm256_load_pd(&v_[first]);
      return _mm256_add_pd(_mm256_mul_pd(u, u), _mm256_mul_pd(v, v));
    };
    const __m256d four =
        _mm256_max_pd(_mm256_and_pd(corner_sq(0), low_live), _mm256_and_pd(corner_sq(kFour), high_live));
    const __m128d two = _mm_max_pd(_mm256_castpd256_pd128(four), _mm256_extractf128_pd(four, 1));
    reach_sq_ = _mm_cvtsd_f64(_mm_max_sd(two, _mm_unpackhi_pd(two, two)));
    measured_ = true;
  }

  // By slot.
  alignas(32) std::array<double, kLanes> u_, v_, over_;
  std::array<std::uint32_t, kLanes> side_;
  std::uint64_t order_;   ///< byte k: the slot of the k-th corner around
  unsigned size_, live_;  ///< number of corners, and bits of their slots
  double reach_sq_;
  bool measured_;  ///< reach_sq_ is up to date
};

namespace {

PALPATE_AVX2 void cut_avx2(const SortedPoint* point, const std::array<PlanarFrame, kFour>& frames,
                           std::array<PlanarVoronoiCell, kFour>& cells,
                           std::array<std::size_t, kFour>& done) noexcept {
  std::array<Avx2VoronoiCell, kFour> wide;
  std::array<LaidOut, kFour> laid_out;
  std::size_t most = 0;
  for (std::size_t c = 0; c < kFour; ++c) {
    done[c] = Avx2VoronoiCell::holds(cells[c]) ? frames[c].count : 0;
    laid_out[c].usable = 0;
    if (done[c] == 0) continue;
    wide[c].load(cells[c]);
    lay_out_near(frames[c], point, laid_out[c]);
    most = std::max(most, frames[c].count);
  }
  for (std::size_t k = 0; k < most; ++k)
    for (std::size_t c = 0; c < kFour; ++c) {
      const LaidOut& by = laid_out[c];
      if ((by.usable >> k & 1u) == 0 || !by.reaches(k, wide[c].reach_sq())) continue;
      if (wide[c].cut(by.u[k], by.v[k], by.half_square[k], frames[c].near[k]) ==
          Avx2VoronoiCell::Outcome::kBeyond) {
        done[c] = k;
        laid_out[c].usable = 0;
      }
    }
  for (std::size_t c = 0; c < kFour; ++c)
    if (frames[c].count > 0 && Avx2VoronoiCell::holds(cells[c])) wide[c].store(cells[c]);
}

}  // namespace
#endif

std::array<std::size_t, 4> cut_four(const SortedPoint* point, const std::array<PlanarFrame, 4>& frames,
                                    std::array<PlanarVoronoiCell, 4>& cells) noexcept {
  std::array<std::size_t, 4> done{};
#if defined(__x86_64__)
  if (has_avx2()) cut_avx2(point, frames, cells, done);
#else
  (void)point;
  (void)frames;
  (void)cells;
#endif
  return done;
}

}  // namespace palpate::local_delaunay
