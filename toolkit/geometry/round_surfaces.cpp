// Sphere and torus.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/segment_box.h"
#include "toolkit/geometry/segment_root_search.h"

namespace palpate::geometry {
namespace {

class Sphere final : public AnalyticSurface {
 public:
  explicit Sphere(double radius_mm) : radius_(radius_mm) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("x^2 + y^2 + z^2 = {}^2", radius_);
  }
  [[nodiscard]] Aabb box_mm() const override { return {Vec3::Constant(-radius_), Vec3::Constant(radius_)}; }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    return towards(p, Vec3::UnitZ());
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    return p.norm() - radius_;
  }
  // The far point maximises the distance, so the closest point is the only local minimum.
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override {
    return towards(p, from.normal);
  }
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a,
                                                        const Vec3& b) const noexcept override {
    const Vec3 d = b - a;
    const double rounding = gamma(8) * (a.norm() + radius_);
    if (a.norm() - radius_ < -rounding) return std::nullopt;  // inside; a sphere is left only once
    if (std::abs(a.norm() - radius_) <= rounding)
      return a.dot(d) < 0.0 ? std::optional(closest(a)) : std::nullopt;
    const auto inside = segment_sphere_interval(a, d, radius_);
    if (!inside || inside->first < 0.0) return std::nullopt;
    return closest(a + inside->first * d);
  }
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    // Equal areas: z is linear in v.
    const double z = 1.0 - 2.0 * v, angle = 2.0 * std::numbers::pi * u,
                 ring = std::sqrt(std::max(0.0, 1.0 - z * z));
    const Vec3 n(ring * std::cos(angle), ring * std::sin(angle), z);
    return {radius_ * n, n};
  }

 private:
  [[nodiscard]] SurfacePoint towards(const Vec3& p, const Vec3& at_centre) const noexcept {
    const double size = p.norm();
    const Vec3 n = size > 0.0 ? Vec3(p / size) : at_centre;
    return {radius_ * n, n};
  }
  double radius_;
};

class Torus final : public AnalyticSurface {
 public:
  Torus(double major_mm, double minor_mm) : major_(major_mm), minor_(minor_mm) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("(sqrt(x^2 + y^2) - {})^2 + z^2 = {}^2", major_, minor_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double r = major_ + minor_;
    return {{-r, -r, -minor_}, {r, r, minor_}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    return towards(p, Vec3::UnitX(), Vec3::UnitZ());
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    return std::hypot(std::hypot(p.x(), p.y()) - major_, p.z()) - minor_;
  }
  // The distance has one minimum around the axis and one around the tube: the closest point. On the axis and
  // on the tube's centre circle, where it is constant, the god object stays.
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override {
    const Vec3 ring(from.point_mm.x(), from.point_mm.y(), 0.0);
    return towards(p, ring.normalized(), from.normal);
  }
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    const double around = 2.0 * std::numbers::pi * u, tube = 2.0 * std::numbers::pi * v;
    const Vec3 out(std::cos(around), std::sin(around), 0.0);
    const Vec3 n = std::cos(tube) * out + std::sin(tube) * Vec3::UnitZ();
    return {major_ * out + minor_ * n, n};
  }

 private:
  [[nodiscard]] SurfacePoint towards(const Vec3& p, const Vec3& on_axis,
                                     const Vec3& on_circle) const noexcept {
    const double rho = std::hypot(p.x(), p.y());
    const Vec3 out = rho > 0.0 ? Vec3(p.x() / rho, p.y() / rho, 0.0) : on_axis;
    const Vec3 centre = major_ * out;
    const Vec3 spoke = p - centre;
    const double size = spoke.norm();
    const Vec3 n = size > 0.0 ? Vec3(spoke / size) : on_circle;
    return {centre + minor_ * n, n};
  }
  double major_, minor_;
};

// In units of the major radius, F(p) = (|p|^2 + 1 - m^2)^2 - 4 (x^2 + y^2) is positive outside. Along the
// segment it is a quartic with bounded second derivative in the torus's bounding sphere.
std::optional<SurfacePoint> Torus::first_entry(const Vec3& a_mm, const Vec3& b_mm) const noexcept {
  const Vec3 a = a_mm / major_, d = (b_mm - a_mm) / major_;
  const double m = minor_ / major_, c = 1.0 - m * m, reach = 1.0 + m;
  const auto near = segment_sphere_interval(a, d, reach * (1.0 + gamma(8)));
  if (!near) return std::nullopt;
  // Near the surface |p| <= 2, so both terms are at most 5^2; some 16 operations.
  const double rounding = gamma(16) * (5.0 * 5.0 + 2.0 * a.norm() * a.norm());
  const auto along = [&](double t) noexcept {
    const Vec3 p = a + t * d;
    const double s = p.squaredNorm() + c, flat = p.x() * p.x() + p.y() * p.y();
    const double pd = p.dot(d), flat_d = p.x() * d.x() + p.y() * d.y();
    return SegmentSample{s * s - 4.0 * flat, 4.0 * s * pd - 8.0 * flat_d, rounding};
  };
  const double dd = d.squaredNorm(), flat_dd = d.x() * d.x() + d.y() * d.y();
  const double drop = 8.0 * flat_dd - 4.0 * c * dd;
  const double rise = 8.0 * reach * reach * dd + 4.0 * (reach * reach + c) * dd;
  const auto t =
      first_entry_along(along, drop, rise, std::max(0.0, near->first), std::min(1.0, near->second));
  if (!t) return std::nullopt;
  return closest(a_mm + *t * (b_mm - a_mm));
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_sphere(double radius_mm) {
  if (!is_length(radius_mm)) return nullptr;
  return std::make_shared<Sphere>(radius_mm);
}

std::shared_ptr<const AnalyticSurface> make_torus(double major_mm, double minor_mm) {
  if (!is_length(major_mm) || !is_length(minor_mm) || !(minor_mm < major_mm)) return nullptr;
  return std::make_shared<Torus>(major_mm, minor_mm);
}

}  // namespace palpate::geometry
