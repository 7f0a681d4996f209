#include "toolkit/search/knn_kernels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "toolkit/core/simd.h"
#include "toolkit/core/tolerances.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::search {
namespace {

/// Relative error of rough float keys: three differences squared and summed, and the rounded limit. Eight
/// roundings stay within nine units; the floor covers underflowing squares.
constexpr double kRoughRoom = 1.0 + 9.0 * 2.0 * kUnitRoundoffFloat;
constexpr double kRoughFloor = 2.0 * static_cast<double>(std::numeric_limits<float>::min());

float rough_limit(double limit) noexcept {
  const double wide = limit * kRoughRoom + kRoughFloor;
  return wide < static_cast<double>(std::numeric_limits<float>::max())
             ? static_cast<float>(wide)
             : std::numeric_limits<float>::infinity();
}

double insert_eight(std::uint32_t self, const KnnScratch& scratch, Neighbours& out) {
  NearestEight best;
  for (std::size_t k = 0; k < scratch.count; ++k)
    if (scratch.square[k] <= best.worst() && scratch.square[k] < kNoLimit && scratch.index[k] != self)
      best.offer(scratch.square[k], scratch.index[k]);
  best.store(self, out);
  return best.worst();
}

namespace portable {

/// Selects, branch-free, candidates whose rough keys (written by `rough`) are within the limit.
template <class Rough>
void sieve(const Candidates& c, const Vec3& p, float limit, KnnScratch& scratch, Rough&& rough) {
  const std::size_t n = c.size();
  scratch.make_room(n);
  const float *x = c.x.data(), *y = c.y.data(), *z = c.z.data();
  std::uint32_t* kept = scratch.kept.data();
  // The points' coordinates are floats.
  const auto px = static_cast<float>(p.x()), py = static_cast<float>(p.y()), pz = static_cast<float>(p.z());
  std::size_t count = 0;
  float key[kLanes];
  for (std::size_t i = 0; i < n; i += kLanes) {
    for (std::size_t k = 0; k < kLanes; ++k) key[k] = rough(x[i + k] - px, y[i + k] - py, z[i + k] - pz);
    for (std::size_t k = 0; k < kLanes; ++k) {
      kept[count] = static_cast<std::uint32_t>(i + k);
      count += static_cast<std::size_t>(key[k] <= limit);
    }
  }
  scratch.count = count;
}

/// Exact keys of the sieved candidates.
template <bool kAlong>
void measure(const Candidates& c, const Vec3& p, KnnScratch& scratch) {
  for (std::size_t k = 0; k < scratch.count; ++k) {
    const std::uint32_t i = scratch.kept[k];
    const double dx = static_cast<double>(c.x[i]) - p.x(), dy = static_cast<double>(c.y[i]) - p.y(),
                 dz = static_cast<double>(c.z[i]) - p.z();
    scratch.index[k] = c.index[i];
    scratch.square[k] = dx * dx + dy * dy + dz * dz;
    if constexpr (kAlong) scratch.along[k] = std::max(std::max(std::abs(dx), std::abs(dy)), std::abs(dz));
  }
}

void keep_ball(const Candidates& c, const Vec3& p, double limit_sq_mm2, KnnScratch& scratch) {
  sieve(c, p, rough_limit(limit_sq_mm2), scratch,
        [](float dx, float dy, float dz) { return dx * dx + dy * dy + dz * dz; });
  measure<false>(c, p, scratch);
}

void keep_cube(const Candidates& c, const Vec3& p, double half_mm, KnnScratch& scratch) {
  sieve(c, p, rough_limit(half_mm), scratch, [](float dx, float dy, float dz) {
    return std::max(std::max(std::abs(dx), std::abs(dy)), std::abs(dz));
  });
  measure<true>(c, p, scratch);
}

CubeCounts count_in_cubes(const KnnScratch& scratch, double outer_mm, double inner_mm) {
  CubeCounts held;
  for (std::size_t k = 0; k < scratch.count; ++k) {
    held.outer += static_cast<std::size_t>(scratch.along[k] <= outer_mm);
    held.inner += static_cast<std::size_t>(scratch.along[k] <= inner_mm);
  }
  return held;
}

void exclude_cube(KnnScratch& scratch, double half_mm) {
  for (std::size_t k = 0; k < scratch.count; ++k)
    scratch.square[k] = scratch.along[k] <= half_mm ? scratch.square[k] : kNoLimit;
}

constexpr Kernels kKernels = {keep_ball, keep_cube, count_in_cubes, exclude_cube, insert_eight};

}  // namespace portable

#if defined(__x86_64__)
namespace avx2 {

/// Appends those positions i .. i + 7 whose bit is set.
PALPATE_AVX2 inline std::size_t append(std::uint32_t* kept, std::size_t count, __m256 yes, __m256i base) {
  const auto mask = static_cast<unsigned>(_mm256_movemask_ps(yes));
  const __m128i bytes = _mm_cvtsi64_si128(static_cast<long long>(kLanePositions[mask]));
  const __m256i at = _mm256_add_epi32(_mm256_cvtepu8_epi32(bytes), base);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(kept + count), at);
  return count + static_cast<std::size_t>(__builtin_popcount(mask));
}

PALPATE_AVX2 inline __m256 magnitude(__m256 v) {
  return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), v);
}
PALPATE_AVX2 inline __m256d magnitude(__m256d v) {
  return _mm256_andnot_pd(_mm256_set1_pd(-0.0), v);
}

/// Four elements by position; gather instructions are slower with mitigations.
PALPATE_AVX2 inline __m128 pick(const float* from, const std::uint32_t* at) {
  return _mm_setr_ps(from[at[0]], from[at[1]], from[at[2]], from[at[3]]);
}

template <bool kCube>
PALPATE_AVX2 void keep(const Candidates& c, const Vec3& p, double limit, KnnScratch& scratch) {
  const std::size_t n = c.size();
  scratch.make_room(n);
  const float *x = c.x.data(), *y = c.y.data(), *z = c.z.data();
  std::uint32_t* kept = scratch.kept.data();
  const __m256 px = _mm256_set1_ps(static_cast<float>(p.x())), py = _mm256_set1_ps(static_cast<float>(p.y())),
               pz = _mm256_set1_ps(static_cast<float>(p.z())), within = _mm256_set1_ps(rough_limit(limit));
  __m256i base = _mm256_setzero_si256();
  std::size_t count = 0;
  for (std::size_t i = 0; i < n; i += kLanes) {
    const __m256 dx = _mm256_sub_ps(_mm256_loadu_ps(x + i), px);
    const __m256 dy = _mm256_sub_ps(_mm256_loadu_ps(y + i), py);
    const __m256 dz = _mm256_sub_ps(_mm256_loadu_ps(z + i), pz);
    __m256 key;
    if constexpr (kCube)
      key = _mm256_max_ps(_mm256_max_ps(magnitude(dx), magnitude(dy)), magnitude(dz));
    else
      key = _mm256_add_ps(_mm256_add_ps(_mm256_mul_ps(dx, dx), _mm256_mul_ps(dy, dy)), _mm256_mul_ps(dz, dz));
    count = append(kept, count, _mm256_cmp_ps(key, within, _CMP_LE_OQ), base);
    base = _mm256_add_epi32(base, _mm256_set1_epi32(kLanes));
  }
  scratch.count = count;
  // The loop below reads whole groups of four, so unused ones need a valid position.
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(kept + count), _mm256_setzero_si256());
  const __m256d qx = _mm256_set1_pd(p.x()), qy = _mm256_set1_pd(p.y()), qz = _mm256_set1_pd(p.z());
  for (std::size_t k = 0; k < count; k += 4) {
    const __m256d dx = _mm256_sub_pd(_mm256_cvtps_pd(pick(x, kept + k)), qx);
    const __m256d dy = _mm256_sub_pd(_mm256_cvtps_pd(pick(y, kept + k)), qy);
    const __m256d dz = _mm256_sub_pd(_mm256_cvtps_pd(pick(z, kept + k)), qz);
    const __m256d square =
        _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(dx, dx), _mm256_mul_pd(dy, dy)), _mm256_mul_pd(dz, dz));
    _mm256_storeu_pd(scratch.square.data() + k, square);
    for (std::size_t j = k; j < k + 4; ++j) scratch.index[j] = c.index[kept[j]];
    if constexpr (kCube)
      _mm256_storeu_pd(scratch.along.data() + k,
                       _mm256_max_pd(_mm256_max_pd(magnitude(dx), magnitude(dy)), magnitude(dz)));
  }
  // Padding beyond every cube and reach.
  _mm256_storeu_pd(scratch.square.data() + count, _mm256_set1_pd(kNoLimit));
  if constexpr (kCube)
    _mm256_storeu_pd(scratch.along.data() + count, _mm256_set1_pd(std::numeric_limits<double>::quiet_NaN()));
}

PALPATE_AVX2 inline std::size_t sum_of(__m256i v) {
  const __m128i two = _mm_add_epi64(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
  return static_cast<std::size_t>(_mm_cvtsi128_si64(_mm_add_epi64(two, _mm_unpackhi_epi64(two, two))));
}

PALPATE_AVX2 CubeCounts count_in_cubes(const KnnScratch& scratch, double outer_mm, double inner_mm) {
  const __m256d outer = _mm256_set1_pd(outer_mm), inner = _mm256_set1_pd(inner_mm);
  __m256i in_outer = _mm256_setzero_si256(), in_inner = in_outer;
  for (std::size_t k = 0; k < scratch.count; k += 4) {
    const __m256d along = _mm256_loadu_pd(scratch.along.data() + k);
    in_outer = _mm256_sub_epi64(in_outer, _mm256_castpd_si256(_mm256_cmp_pd(along, outer, _CMP_LE_OQ)));
    in_inner = _mm256_sub_epi64(in_inner, _mm256_castpd_si256(_mm256_cmp_pd(along, inner, _CMP_LE_OQ)));
  }
  return {sum_of(in_outer), sum_of(in_inner)};
}

PALPATE_AVX2 void exclude_cube(KnnScratch& scratch, double half_mm) {
  const __m256d half = _mm256_set1_pd(half_mm), never = _mm256_set1_pd(kNoLimit);
  for (std::size_t k = 0; k < scratch.count; k += 4) {
    const __m256d in = _mm256_cmp_pd(_mm256_loadu_pd(scratch.along.data() + k), half, _CMP_LE_OQ);
    const __m256d square = _mm256_loadu_pd(scratch.square.data() + k);
    _mm256_storeu_pd(scratch.square.data() + k, _mm256_blendv_pd(never, square, in));
  }
}

/// Candidates up to which ranks are counted pairwise without branches (a guess from the last point keeps
/// about fourteen). Beyond, insertion is used.
constexpr std::size_t kMostRanked = 24;

/// Bits of four times the smallest normal double. Added to a non-negative double's bits they keep the order
/// and leave room for one less.
constexpr long long kLifted = 2ll << 52;
/// The bits of 2^52: with it, an unsigned integer as low mantissa keeps its order among doubles.
constexpr long long kIntegers = 0x433ll << 52;

PALPATE_AVX2 double choose_eight(std::uint32_t self, const KnnScratch& scratch, Neighbours& out) {
  const std::size_t n = scratch.count, groups = (n + 3) / 4;
  if (n > kMostRanked) return insert_eight(self, scratch, out);
  // Ranks by counting predecessors. Non-negative doubles order like their bits, so (square, index) comes
  // first if its square's bits, less one for a lower index, are below the other's. The largest double stands
  // for "out of reach": no square of floats gets there.
  alignas(32) std::array<double, kMostRanked> key;
  alignas(32) std::array<double, kMostRanked> index;
  alignas(32) std::array<std::int64_t, kMostRanked> rank;
  const __m256d never = _mm256_set1_pd(std::numeric_limits<double>::max());
  const __m128i own = _mm_set1_epi32(static_cast<int>(self));
  unsigned missing = 0;
  for (std::size_t k = 0; k < n; k += 4) {
    const __m128i id = _mm_loadu_si128(reinterpret_cast<const __m128i*>(scratch.index.data() + k));
    const __m256d square = _mm256_loadu_pd(scratch.square.data() + k);
    const __m256d is_own = _mm256_castsi256_pd(_mm256_cvtepi32_epi64(_mm_cmpeq_epi32(id, own)));
    const __m256d out_of_reach = _mm256_or_pd(is_own, _mm256_cmp_pd(square, never, _CMP_GE_OQ));
    missing +=
        static_cast<unsigned>(__builtin_popcount(static_cast<unsigned>(_mm256_movemask_pd(out_of_reach))));
    const __m256i lifted = _mm256_add_epi64(_mm256_castpd_si256(square), _mm256_set1_epi64x(kLifted));
    _mm256_store_pd(&key[k], _mm256_blendv_pd(_mm256_castsi256_pd(lifted), never, out_of_reach));
    const __m256i integer = _mm256_or_si256(_mm256_cvtepu32_epi64(id), _mm256_set1_epi64x(kIntegers));
    _mm256_store_pd(&index[k], _mm256_castsi256_pd(integer));
  }
  for (std::size_t k = 0; k < n; k += 4) {
    const __m256d mine = _mm256_load_pd(&key[k]), my_index = _mm256_load_pd(&index[k]);
    __m256i before = _mm256_setzero_si256();
    for (std::size_t j = 0; j < n; ++j) {
      const __m256i other = _mm256_castpd_si256(_mm256_broadcast_sd(&key[j]));
      const __m256d lower = _mm256_cmp_pd(_mm256_broadcast_sd(&index[j]), my_index, _CMP_LT_OQ);
      const __m256d less = _mm256_castsi256_pd(_mm256_add_epi64(other, _mm256_castpd_si256(lower)));
      before = _mm256_sub_epi64(before, _mm256_castpd_si256(_mm256_cmp_pd(less, mine, _CMP_LT_OQ)));
    }
    _mm256_store_si256(reinterpret_cast<__m256i*>(&rank[k]), before);
  }
  std::array<std::uint32_t, kMostRanked> order;
  std::array<double, kMostRanked> sorted;
  for (std::size_t k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(rank[k]);
    order[at] = scratch.index[k];
    sorted[at] = scratch.square[k];
  }
  const std::size_t reached = 4 * groups - missing;
  if (reached >= kNeighbours) {
    std::copy_n(order.begin(), kNeighbours, out.begin());
    return sorted[kNeighbours - 1];
  }
  out.fill(self);
  std::copy_n(order.begin(), reached, out.begin());
  return kNoLimit;
}

constexpr Kernels kKernels = {keep<false>, keep<true>, count_in_cubes, exclude_cube, choose_eight};

}  // namespace avx2
#endif

}  // namespace

const Kernels& portable_kernels() noexcept {
  return portable::kKernels;
}

const Kernels& kernels() noexcept {
#if defined(__x86_64__)
  if (has_avx2()) return avx2::kKernels;
#endif
  return portable::kKernels;
}

}  // namespace palpate::search
