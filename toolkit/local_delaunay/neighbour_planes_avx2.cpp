#include "toolkit/local_delaunay/avx2_kernels.h"

#include "toolkit/core/simd.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace palpate::local_delaunay {

#if defined(__x86_64__)
namespace {

struct Four3 {
  Double4 x, y, z;
};
/// As surface::SymmetricMatrix3.
struct FourSymmetric {
  Double4 xx, xy, xz, yy, yz, zz;
};

PALPATE_AVX2 inline Double4 all(double x) noexcept {
  return Double4{x, x, x, x};
}
/// Omits the weight, which another thread may be writing.
PALPATE_AVX2 inline __m128 coordinates(const SortedPoint& p) noexcept {
  const __m128 xy = _mm_loadl_pi(_mm_setzero_ps(), reinterpret_cast<const __m64*>(&p.x_mm));  // NOLINT: two
  return _mm_movelh_ps(xy, _mm_load_ss(&p.z_mm));
}
PALPATE_AVX2 inline void read(const SortedPoint* point, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                              std::uint32_t d, Four3& out) noexcept {
  __m128 x = coordinates(point[a]), y = coordinates(point[b]), z = coordinates(point[c]),
         w = coordinates(point[d]);
  _MM_TRANSPOSE4_PS(x, y, z, w);
  out = {_mm256_cvtps_pd(x), _mm256_cvtps_pd(y), _mm256_cvtps_pd(z)};
}
PALPATE_AVX2 inline void scale(FourSymmetric& c, Double4 s) noexcept {
  c = {c.xx * s, c.xy * s, c.xz * s, c.yy * s, c.yz * s, c.zz * s};
}
PALPATE_AVX2 inline void take_adjugate(FourSymmetric& c) noexcept {
  c = {c.yy * c.zz - c.yz * c.yz, c.xz * c.yz - c.xy * c.zz, c.xy * c.yz - c.xz * c.yy,
       c.xx * c.zz - c.xz * c.xz, c.xy * c.xz - c.xx * c.yz, c.xx * c.yy - c.xy * c.xy};
}
PALPATE_AVX2 inline void square(FourSymmetric& c) noexcept {
  c = {c.xx * c.xx + c.xy * c.xy + c.xz * c.xz, c.xx * c.xy + c.xy * c.yy + c.xz * c.yz,
       c.xx * c.xz + c.xy * c.yz + c.xz * c.zz, c.xy * c.xy + c.yy * c.yy + c.yz * c.yz,
       c.xy * c.xz + c.yy * c.yz + c.yz * c.zz, c.xz * c.xz + c.yz * c.yz + c.zz * c.zz};
}

PALPATE_AVX2 unsigned between_wide(const SortedPoint* point, const std::uint32_t* near, const Vec3& p,
                                   double beyond_sq, double within_sq) noexcept {
  const Double4 px = all(p.x()), py = all(p.y()), pz = all(p.z());
  const __m256d beyond = all(beyond_sq), within = all(within_sq);
  unsigned mask = 0;
  for (unsigned k = 0; k < kNearAtOnce; k += 4) {
    Four3 d;
    read(point, near[k], near[k + 1], near[k + 2], near[k + 3], d);
    d = {d.x - px, d.y - py, d.z - pz};
    const __m256d square = (d.x * d.x + d.y * d.y) + d.z * d.z;  // in the order of Eigen's sums of three
    const __m256d is_between =
        _mm256_and_pd(_mm256_cmp_pd(square, beyond, _CMP_GT_OQ), _mm256_cmp_pd(square, within, _CMP_LE_OQ));
    mask |= static_cast<unsigned>(_mm256_movemask_pd(is_between)) << k;
  }
  return mask;
}

PALPATE_AVX2 void covariances(const SortedPoint* point, const std::array<std::uint32_t, 4>& place,
                              const std::array<const std::uint32_t*, 4>& near, FourSymmetric& out) noexcept {
  Four3 own, first = {all(0.0), all(0.0), all(0.0)};
  read(point, place[0], place[1], place[2], place[3], own);
  FourSymmetric second = {all(0.0), all(0.0), all(0.0), all(0.0), all(0.0), all(0.0)};
  for (std::size_t k = 0; k < kPlaneNear; ++k) {
    Four3 d;
    read(point, near[0][k], near[1][k], near[2][k], near[3][k], d);
    d = {d.x - own.x, d.y - own.y, d.z - own.z};
    first = {first.x + d.x, first.y + d.y, first.z + d.z};
    second = {second.xx + d.x * d.x, second.xy + d.x * d.y, second.xz + d.x * d.z,
              second.yy + d.y * d.y, second.yz + d.y * d.z, second.zz + d.z * d.z};
  }
  const Double4 share = all(1.0 / static_cast<double>(kPlaneNear + 1));
  out = {second.xx - share * first.x * first.x, second.xy - share * first.x * first.y,
         second.xz - share * first.x * first.z, second.yy - share * first.y * first.y,
         second.yz - share * first.y * first.z, second.zz - share * first.z * first.z};
}

PALPATE_AVX2 void write(const FourSymmetric& c, std::array<surface::SymmetricMatrix3, 4>& out) noexcept {
  for (std::size_t k = 0; k < 4; ++k) out[k] = {c.xx[k], c.xy[k], c.xz[k], c.yy[k], c.yz[k], c.zz[k]};
}

PALPATE_AVX2 void planes(const SortedPoint* point, const std::array<std::uint32_t, 4>& place,
                         const std::array<const std::uint32_t*, 4>& near, PlaneBatch& out) noexcept {
  FourSymmetric power;
  covariances(point, place, near, power);
  write(power, out.covariance);
  const Double4 size = power.xx + power.yy + power.zz;
  scale(power, all(1.0) / size);
  take_adjugate(power);
  Double4 trace = power.xx + power.yy + power.zz;
  for (std::size_t k = 0; k < 4; ++k)
    out.has_normal[k] = size[k] > 0.0 && trace[k] > surface::kCollinearRatio;
  for (int i = 0; i < surface::kSquarings; ++i) {
    scale(power, all(1.0) / trace);
    square(power);
    trace = power.xx + power.yy + power.zz;
  }
  std::array<surface::SymmetricMatrix3, 4> projector;
  write(power, projector);
  for (std::size_t k = 0; k < 4; ++k)
    out.has_normal[k] = out.has_normal[k] && surface::longest_column(projector[k], out.normal[k]);
}

}  // namespace
#endif

void fit_four_planes(const SortedPoint* point, const std::array<std::uint32_t, 4>& place,
                     const std::array<const std::uint32_t*, 4>& near, PlaneBatch& out) noexcept {
#if defined(__x86_64__)
  planes(point, place, near, out);
#else
  (void)point;
  (void)place;
  (void)near;
  (void)out;
#endif
}

unsigned points_between(const SortedPoint* point, const std::uint32_t* near, const Vec3& p, double beyond_sq,
                        double within_sq) noexcept {
#if defined(__x86_64__)
  if (has_avx2()) return between_wide(point, near, p, beyond_sq, within_sq);
#endif
  unsigned mask = 0;
  for (unsigned k = 0; k < kNearAtOnce; ++k) {
    const double square = (point[near[k]].at() - p).squaredNorm();
    mask |= static_cast<unsigned>(square > beyond_sq && square <= within_sq) << k;
  }
  return mask;
}

}  // namespace palpate::local_delaunay
