#include "toolkit/surface/planes.h"

#include <algorithm>

#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"

namespace palpate::surface {
namespace {

constexpr std::size_t kPointsPerChunk = 8192;

/// Points lie on a line, as far as rounding can tell, when the middle eigenvalue is below this share of the
/// largest: coordinates are floats, so a true line's points stray by 2^-24 of their distance, the square of
/// it in eigenvalues; a thousand times that leaves room for the solver's own error.
constexpr double kLineShare = 1000.0 * kUnitRoundoffFloat * kUnitRoundoffFloat;

/// Squarings of the adjugate: each squares the ratio of its second eigenvalue to its first, so five leave
/// less than 1e-9 of any other direction where the two smallest eigenvalues differ by half.
constexpr int kSquarings = 5;

/// A symmetric 3 x 3 matrix.
struct Symmetric {
  double xx = 0.0, xy = 0.0, xz = 0.0, yy = 0.0, yz = 0.0, zz = 0.0;
  [[nodiscard]] double trace() const noexcept { return xx + yy + zz; }
  [[nodiscard]] Symmetric scaled(double s) const noexcept {
    return {xx * s, xy * s, xz * s, yy * s, yz * s, zz * s};
  }
  [[nodiscard]] Symmetric adjugate() const noexcept {
    return {yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy,
            xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy};
  }
  [[nodiscard]] Symmetric squared() const noexcept {
    return {xx * xx + xy * xy + xz * xz, xx * xy + xy * yy + xz * yz, xx * xz + xy * yz + xz * zz,
            xy * xy + yy * yy + yz * yz, xy * xz + yy * yz + yz * zz, xz * xz + yz * yz + zz * zz};
  }
};

/// The eigenvector of the smallest eigenvalue of a covariance; false where the points lie on a line or at one
/// place. The adjugate has the same eigenvectors and the products of the other two eigenvalues, the largest
/// for the smallest; its high powers are that eigenvector's projector. Only sums and products, so that every
/// compiler and library gives the same bits.
bool smallest_direction(const Symmetric& covariance, Vec3& direction) noexcept {
  const double size = covariance.trace();
  if (!(size > 0.0)) return false;
  Symmetric power = covariance.scaled(1.0 / size).adjugate();
  double trace = power.trace();
  // Of eigenvalues that sum to 1: about the middle one.
  if (!(trace > kLineShare)) return false;
  for (int i = 0; i < kSquarings; ++i) {
    power = power.scaled(1.0 / trace).squared();
    trace = power.trace();
  }
  // The longest column of the projector.
  if (power.xx >= power.yy && power.xx >= power.zz)
    direction = Vec3(power.xx, power.xy, power.xz);
  else if (power.yy >= power.zz)
    direction = Vec3(power.xy, power.yy, power.yz);
  else
    direction = Vec3(power.xz, power.yz, power.zz);
  direction.normalize();
  return is_finite(direction);
}

/// False where the point and its neighbours give no plane.
bool plane_normal(std::span<const SurfacePoint> points, const neighbourhood::Neighbours& around,
                  std::size_t i, Vec3& normal) noexcept {
  const double px = static_cast<double>(points[i].x_mm), py = static_cast<double>(points[i].y_mm),
               pz = static_cast<double>(points[i].z_mm);
  // Sums about the point itself, which is one of those fitted.
  double sx = 0.0, sy = 0.0, sz = 0.0, count = 1.0;
  Symmetric sum;
  for (const std::uint32_t other : around) {
    if (other == i) continue;
    const double x = static_cast<double>(points[other].x_mm) - px,
                 y = static_cast<double>(points[other].y_mm) - py,
                 z = static_cast<double>(points[other].z_mm) - pz;
    sx += x;
    sy += y;
    sz += z;
    sum.xx += x * x;
    sum.xy += x * y;
    sum.xz += x * z;
    sum.yy += y * y;
    sum.yz += y * z;
    sum.zz += z * z;
    count += 1.0;
  }
  const double share = 1.0 / count;
  const Symmetric covariance{sum.xx - sx * sx * share, sum.xy - sx * sy * share, sum.xz - sx * sz * share,
                             sum.yy - sy * sy * share, sum.yz - sy * sz * share, sum.zz - sz * sz * share};
  return smallest_direction(covariance, normal);
}

}  // namespace

void fit_planes(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                int threads) {
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Vec3 normal;
      points[i].normal = plane_normal(points, neighbours[i], i, normal) ? encode_normal(normal) : kNoNormal;
    }
  });
}

void refit_plane(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                 std::uint32_t place) noexcept {
  const NormalCode before = points[place].normal;
  Vec3 normal;
  if (!plane_normal(points, neighbours[place], place, normal)) return;  // the side it had is better than none
  const bool turned = before != kNoNormal && decode_normal(before).dot(normal) < 0.0;
  const NormalCode side = is_one_sided(before) ? kOneSided : NormalCode{0};
  points[place].normal = encode_normal(turned ? Vec3(-normal) : normal) | side;
}

}  // namespace palpate::surface
