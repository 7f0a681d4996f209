// The ellipsoid.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
namespace {

/// Steps of the god object to the nearest place; each leaves at most curvature x distance of the error.
constexpr int kEllipsoidSteps = 60;
/// Newton's method on 1/s^2 multiplies s by at least 1.5 a step: 128 steps span over 22 orders of magnitude,
/// more than a double resolves.
constexpr int kEllipsoidRootSteps = 128;
/// A step shortened below this share ends the search: its gain is rounding.
constexpr double kEllipsoidShortest = 0.01;

class Ellipsoid final : public AnalyticSurface {
 public:
  explicit Ellipsoid(const Vec3& axes_mm) : axes_(axes_mm) { axes_.minCoeff(&least_); }

  [[nodiscard]] std::string formula() const override {
    return fmt::format("(x / {})^2 + (y / {})^2 + (z / {})^2 = 1", axes_.x(), axes_.y(), axes_.z());
  }
  [[nodiscard]] Aabb box_mm() const override { return {-axes_, axes_}; }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override;
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const double distance = (closest(p).point_mm - p).norm();
    return p.cwiseQuotient(axes_).squaredNorm() < 1.0 ? -distance : distance;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a,
                                                        const Vec3& b) const noexcept override {
    // In units of the axes the surface is the unit sphere.
    const Vec3 from = a.cwiseQuotient(axes_), d = (b - a).cwiseQuotient(axes_);
    const double rounding = gamma(8) * (from.norm() + 1.0), height = from.norm() - 1.0;
    if (height < -rounding) return std::nullopt;  // inside; a convex body is left only once
    if (height <= rounding) return from.dot(d) < 0.0 ? std::optional(seen_at(a)) : std::nullopt;
    const auto inside = segment_sphere_interval(from, d, 1.0);
    if (!inside || inside->first < 0.0) return std::nullopt;
    return seen_at(a + inside->first * (b - a));
  }
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    const double z = 1.0 - 2.0 * v, angle = 2.0 * std::numbers::pi * u,
                 ring = std::sqrt(std::max(0.0, 1.0 - z * z));
    return seen_at(Vec3(ring * std::cos(angle), ring * std::sin(angle), z).cwiseProduct(axes_));
  }

 private:
  /// The surface point in the direction of p from the centre.
  [[nodiscard]] SurfacePoint seen_at(const Vec3& p) const noexcept {
    const Vec3 unit = p.cwiseQuotient(axes_);
    const double size = unit.norm();
    const Vec3 on = size > 0.0 ? Vec3(unit / size) : Vec3::Unit(least_);
    return {on.cwiseProduct(axes_), on.cwiseQuotient(axes_).normalized()};
  }

  Vec3 axes_;
  int least_ = 0;  ///< index of the shortest axis
};

// The closest point x has p - x = t grad: x_i = a_i^2 p_i / (t + a_i^2), where t is the largest root of sum
// (a_i p_i / (t + a_i^2))^2 = 1. The sum falls and is convex right of its pole at minus the least a_i^2, so
// Newton's method from the left never overshoots (Eberly 2013). Units of the least axis; s = t + 1.
SurfacePoint Ellipsoid::closest(const Vec3& p) const noexcept {
  const double unit = axes_[least_];
  const Vec3 e = axes_ / unit, q = p.cwiseAbs() / unit;
  const Vec3 beyond = e.cwiseProduct(e) - Vec3::Ones();
  const auto share = [&](int i, double s) { return q[i] == 0.0 ? 0.0 : e[i] * q[i] / (s + beyond[i]); };
  // One term alone is 1 there, so the root is not to the left.
  double s = std::max(0.0, (e.cwiseProduct(q) - beyond).maxCoeff());
  Vec3 x;
  double sum = 0.0;
  for (int step = 0; step < kEllipsoidRootSteps; ++step) {
    sum = 0.0;
    double slope = 0.0;
    for (int i = 0; i < 3; ++i) {
      x[i] = share(i, s);
      sum += x[i] * x[i];
      if (x[i] != 0.0) slope -= 2.0 * x[i] * x[i] / (s + beyond[i]);
    }
    const double next = slope < 0.0 ? s - (sum - 1.0) / slope : s;
    if (!(next > s)) break;
    s = next;
  }
  // Near the centre in the plane across the shortest axis there is no such root: both ends of that axis are
  // equally near, and the upper one is taken.
  if (q[least_] == 0.0 && s == 0.0 && sum < 1.0) x[least_] = std::sqrt(1.0 - sum);
  for (int i = 0; i < 3; ++i)
    if (p[i] < 0.0) x[i] = -x[i];
  return seen_at(x.cwiseProduct(axes_));
}

SurfacePoint Ellipsoid::track(const SurfacePoint& from, const Vec3& p) const noexcept {
  SurfacePoint at = from;
  const auto aside = [&](const SurfacePoint& s) -> Vec3 {
    const Vec3 r = p - s.point_mm;
    return r - s.normal * s.normal.dot(r);
  };
  double left = (p - at.point_mm).squaredNorm();
  for (int step = 0; step < kEllipsoidSteps; ++step) {
    const Vec3 way = aside(at);
    bool nearer = false;
    for (double share = 1.0; share > kEllipsoidShortest && !nearer; share *= 0.5) {
      const SurfacePoint next = seen_at(at.point_mm + share * way);
      const double d = (p - next.point_mm).squaredNorm();
      nearer = d < left;
      if (!nearer) continue;
      at = next;
      left = d;
    }
    if (!nearer) break;
  }
  // Distances resolve places only to the square root of rounding; the remaining tangential part resolves
  // more.
  for (int step = 0; step < kEllipsoidSteps; ++step) {
    const Vec3 way = aside(at);
    const SurfacePoint next = seen_at(at.point_mm + way);
    if (!(aside(next).squaredNorm() < way.squaredNorm())) break;
    at = next;
  }
  return at;
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_ellipsoid(const Vec3& semi_axes_mm) {
  for (int i = 0; i < 3; ++i)
    if (!is_length(semi_axes_mm[i])) return nullptr;
  return std::make_shared<Ellipsoid>(semi_axes_mm);
}

}  // namespace palpate::geometry
