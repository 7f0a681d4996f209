// The god object's Newton step in the tangent plane, towards the level set's nearest place to the HIP.
#pragma once

#include <algorithm>
#include <cmath>

#include "toolkit/spline_sdf/spline.h"

namespace palpate::render {

/// Lower bound on the distance's curvature along the surface; below it the god object is at a saddle and
/// Newton's step is arbitrary.
inline constexpr double kMinCurvature = 0.2;

/// One Newton step to the nearest place to h on the level set through `at`. Without `exact` it uses the
/// Hessian of a plane.
struct NewtonStep {
  Vec3 along = Vec3::Zero();   ///< the tangent plane
  Vec3 normal = Vec3::Zero();  ///< unit, of growing distance
  double lift = 0.0;           ///< along the normal, back to the surface
};

[[nodiscard, gnu::always_inline]] inline NewtonStep newton_step(const Jet& jet, const Vec3& d, double longest,
                                                                bool exact = true) noexcept {
  NewtonStep s;
  const Vec3 g = jet.gradient.cast<double>();
  const double size_sq = g.squaredNorm();
  if (!(size_sq > 0.0)) return s;
  const double size = std::sqrt(size_sq), per = 1.0 / size;
  const Vec3 n = g * per;
  s.normal = n;
  const double depth = d.dot(n);
  const Vec3 t = d - n * depth;
  // Tangents (Duff et al. 2017).
  const double sign = std::copysign(1.0, n.z()), a = -1.0 / (sign + n.z()), b = n.x() * n.y() * a;
  const Vec3 e(1.0 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()),
      f(b, sign + n.y() * n.y() * a, -n.y());
  const auto second = [&](const Vec3& v) {
    const auto& h = jet.second;
    const double xx = static_cast<double>(h[0]), yy = static_cast<double>(h[1]),
                 zz = static_cast<double>(h[2]);
    const double xy = static_cast<double>(h[3]), xz = static_cast<double>(h[4]),
                 yz = static_cast<double>(h[5]);
    return Vec3(xx * v.x() + xy * v.y() + xz * v.z(), xy * v.x() + yy * v.y() + yz * v.z(),
                xz * v.x() + yz * v.y() + zz * v.z());
  };
  const Vec3 he = second(e), hf = second(f);
  const double ee = e.dot(he), ef = f.dot(he), ff = f.dot(hf);
  const double lambda = exact ? depth * per : 0.0;
  double p = 1.0 + lambda * ee, q = lambda * ef, r = 1.0 + lambda * ff;
  const double middle = 0.5 * (p + r), half = 0.5 * (p - r);
  double determinant = p * r - q * q;
  if (!(middle > kMinCurvature && determinant > kMinCurvature * middle)) {
    const double least = middle - std::sqrt(half * half + q * q);
    const double lift = std::max(kMinCurvature - least, 0.0);
    p += lift;
    r += lift;
    determinant = p * r - q * q;
  }
  const double te = t.dot(e), tf = t.dot(f);
  double x = (r * te - q * tf) / determinant, y = (p * tf - q * te) / determinant;
  const double length_sq = x * x + y * y;
  if (length_sq > longest * longest) {
    const double share = longest / std::sqrt(length_sq);
    x *= share;
    y *= share;
  }
  s.along = e * x + f * y;
  s.lift = -(static_cast<double>(jet.value) + 0.5 * (x * x * ee + 2.0 * x * y * ef + y * y * ff)) * per;
  return s;
}

}  // namespace palpate::render
