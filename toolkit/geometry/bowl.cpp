// An open part of a sphere with a rim.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
namespace {

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

std::shared_ptr<const AnalyticSurface> make_bowl(double radius_mm, double rim_deg, Felt felt) {
  if (!is_length(radius_mm) || !(rim_deg >= kMinRimDeg && rim_deg <= 180.0 - kMinRimDeg)) return nullptr;
  return std::make_shared<Bowl>(radius_mm, rim_deg, felt);
}

}  // namespace palpate::geometry
