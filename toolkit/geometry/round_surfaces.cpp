// Sphere, torus, ellipsoid, hollow ball (two nested spheres close together) and bowl (an open part of a
// sphere with a rim).
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/segment_box.h"

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
    const Vec3 n = unit_sphere_at(u, v);
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
    return seen_at(unit_sphere_at(u, v).cwiseProduct(axes_));
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

class Shells final : public AnalyticSurface {
 public:
  Shells(double radius_mm, double gap_mm) : outer_(radius_mm), inner_(radius_mm - gap_mm) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("{} <= |p| <= {}", inner_, outer_);
  }
  [[nodiscard]] Aabb box_mm() const override { return {Vec3::Constant(-outer_), Vec3::Constant(outer_)}; }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    return on_sheet(p.norm() > middle(), p, Vec3::UnitZ());
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const double size = p.norm();
    return size > middle() ? size - outer_ : inner_ - size;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override {
    return on_sheet(from.point_mm.norm() > middle(), p, from.point_mm);
  }
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    return on_sheet(true, unit_sphere_at(u, v), Vec3::UnitZ());
  }

 private:
  [[nodiscard]] double middle() const noexcept { return 0.5 * (outer_ + inner_); }
  /// The inner sphere's normal points into the hollow. `at_centre`: the direction to take at the centre.
  [[nodiscard]] SurfacePoint on_sheet(bool outer, const Vec3& p, const Vec3& at_centre) const noexcept {
    const double size = p.norm();
    const Vec3 n = size > 0.0 ? Vec3(p / size) : at_centre.normalized();
    return outer ? SurfacePoint{outer_ * n, n} : SurfacePoint{inner_ * n, -n};
  }

  double outer_, inner_;
};

std::optional<SurfacePoint> Shells::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  const double size = a.norm(), rounding = gamma(8) * (size + outer_), way = a.dot(d);
  // On either sphere, and going in.
  if (std::abs(size - outer_) <= rounding && way < 0.0) return on_sheet(true, a, a);
  if (std::abs(size - inner_) <= rounding && way > 0.0) return on_sheet(false, a, a);
  const auto ball = segment_sphere_interval(a, d, outer_);
  if (!ball) return std::nullopt;
  if (size > outer_ + rounding && ball->first >= 0.0) return on_sheet(true, a + ball->first * d, a);
  // Enters the wall again only from the hollow.
  const auto hollow = segment_sphere_interval(a, d, inner_);
  if (!hollow || !(hollow->second >= 0.0 && hollow->second <= 1.0)) return std::nullopt;
  return on_sheet(false, a + hollow->second * d, a);
}

/// A bowl smaller than this, or closer than this to a whole sphere, is refused.
constexpr double kMinRimDeg = 1.0;

class Bowl final : public AnalyticSurface {
 public:
  Bowl(double radius_mm, double rim_deg, Felt felt)
      : radius_(radius_mm),
        rim_deg_(rim_deg),
        rim_(rim_deg * std::numbers::pi / 180.0),
        cos_rim_(std::cos(rim_)),
        ring_(radius_mm * std::sin(rim_)),
        height_(-radius_mm * cos_rim_),
        out_(felt == Felt::kOutside ? 1.0 : -1.0) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("x^2 + y^2 + z^2 = {}^2 within {} degrees of -z, felt from {}", radius_, rim_deg_,
                       out_ > 0.0 ? "outside" : "inside");
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double widest = rim_deg_ > 90.0 ? radius_ : ring_;
    return {{-widest, -widest, -radius_}, {widest, widest, height_}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    if (faces(p)) return radial(p);
    const SurfacePoint rim = on_rim(p);
    return {rim.point_mm, out_ / radius_ * rim.point_mm};
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    return (closest(p).point_mm - p).norm();
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override {
    if (!(p.squaredNorm() > 0.0)) return from;
    return faces(p) ? radial(p) : on_rim(p);
  }
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    // Maps the square to a disc (border to rim) and the disc to the sphere, the angle from the lowest point
    // in proportion.
    const double x = 2.0 * u - 1.0, y = 2.0 * v - 1.0;
    const double across = x * std::sqrt(std::max(0.0, 1.0 - 0.5 * y * y)),
                 along = y * std::sqrt(std::max(0.0, 1.0 - 0.5 * x * x));
    const double r = std::hypot(across, along), angle = std::min(r * rim_, std::numbers::pi);
    const double side = r > 0.0 ? std::sin(angle) / r : rim_;
    return radial({side * across, side * along, -std::cos(angle)});
  }

 private:
  /// True if p is in the bowl's cone. The centre is: all of the bowl is equally near.
  [[nodiscard]] bool faces(const Vec3& p) const noexcept { return -p.z() >= p.norm() * cos_rim_; }
  [[nodiscard]] SurfacePoint radial(const Vec3& p) const noexcept {
    const double size = p.norm();
    const Vec3 n = size > 0.0 ? Vec3(p / size) : Vec3(-Vec3::UnitZ());
    return {radius_ * n, out_ * n};
  }
  /// The nearest place of the rim; its normal points to p, which is beyond.
  [[nodiscard]] SurfacePoint on_rim(const Vec3& p) const noexcept {
    const double rho = std::hypot(p.x(), p.y());
    const Vec3 out = rho > 0.0 ? Vec3(p.x() / rho, p.y() / rho, 0.0) : Vec3::UnitX();
    const Vec3 rim = ring_ * out + height_ * Vec3::UnitZ();
    const double off = (p - rim).norm();
    return {rim, off > 0.0 ? Vec3((p - rim) / off) : Vec3(out_ / radius_ * rim)};
  }

  double radius_, rim_deg_, rim_, cos_rim_;
  double ring_, height_;  ///< of the rim
  double out_;            ///< sign of the normal along the direction from the centre
};

std::optional<SurfacePoint> Bowl::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  const double rounding = gamma(8) * (a.norm() + radius_), above = out_ * (a.norm() - radius_);
  if (std::abs(above) <= rounding && out_ * a.dot(d) < 0.0)
    return faces(a) ? std::optional(radial(a)) : std::nullopt;
  const auto inside = segment_sphere_interval(a, d, radius_);
  if (!inside) return std::nullopt;
  // Felt from outside, the sphere is entered at the segment's first crossing by a HIP that starts outside;
  // felt from inside, at the last crossing. The other crossing comes from behind.
  if (out_ > 0.0 && above <= rounding) return std::nullopt;
  const double t = out_ > 0.0 ? inside->first : inside->second;
  if (!(t >= 0.0 && t <= 1.0)) return std::nullopt;
  const Vec3 p = a + t * d;
  return faces(p) ? std::optional(radial(p)) : std::nullopt;
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

std::shared_ptr<const AnalyticSurface> make_ellipsoid(const Vec3& semi_axes_mm) {
  for (int i = 0; i < 3; ++i)
    if (!is_length(semi_axes_mm[i])) return nullptr;
  return std::make_shared<Ellipsoid>(semi_axes_mm);
}

std::shared_ptr<const AnalyticSurface> make_shells(double radius_mm, double gap_mm) {
  if (!is_length(radius_mm) || !is_length(gap_mm) || !(gap_mm < radius_mm)) return nullptr;
  return std::make_shared<Shells>(radius_mm, gap_mm);
}

std::shared_ptr<const AnalyticSurface> make_bowl(double radius_mm, double rim_deg, Felt felt) {
  if (!is_length(radius_mm) || !(rim_deg >= kMinRimDeg && rim_deg <= 180.0 - kMinRimDeg)) return nullptr;
  return std::make_shared<Bowl>(radius_mm, rim_deg, felt);
}

}  // namespace palpate::geometry
