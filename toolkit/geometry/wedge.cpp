// Two half-planes along the y axis, ridge or valley.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

// Least angle of material or free space; sharper wedges are needles.
constexpr double kSharpestDeg = 10.0;

class Wedge final : public AnalyticSurface {
 public:
  Wedge(double angle_deg, double extent_mm) : angle_deg_(angle_deg), extent_(extent_mm) {
    const double half_angle = 0.5 * angle_deg * std::numbers::pi / 180.0;
    sin_ = std::sin(half_angle);
    cos_ = angle_deg == 180.0 ? 0.0 : std::cos(half_angle);
    slope_ = cos_ / sin_;
  }

  [[nodiscard]] std::string formula() const override {
    return fmt::format("z = -|x| / tan({} deg / 2)", angle_deg_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double h = 0.5 * extent_, z = -slope_ * h;
    return {{-h, -h, std::min(z, 0.0)}, {h, h, std::max(z, 0.0)}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    const SurfacePoint left = on_side(-1.0, p), right = on_side(1.0, p);
    return (left.point_mm - p).squaredNorm() < (right.point_mm - p).squaredNorm() ? left : right;
  }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const double distance = (closest(p).point_mm - p).norm();
    return height_over(p) < 0.0 ? -distance : distance;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a, const Vec3& b) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    const double x = (u - 0.5) * extent_;
    return {{x, (v - 0.5) * extent_, -slope_ * std::abs(x)}, normal_of(x < 0.0 ? -1.0 : 1.0)};
  }

 private:
  [[nodiscard]] double height_over(const Vec3& p) const noexcept { return p.z() + slope_ * std::abs(p.x()); }
  /// `side` is -1 for the half-plane of x <= 0, 1 for the other.
  [[nodiscard]] Vec3 normal_of(double side) const noexcept { return {side * cos_, 0.0, sin_}; }
  /// Distance of p's foot on the side's plane from the edge; negative beyond it.
  [[nodiscard]] double along_side(double side, const Vec3& p) const noexcept {
    return side * p.x() * sin_ - p.z() * cos_;
  }
  [[nodiscard]] SurfacePoint on_side(double side, const Vec3& p) const noexcept {
    const double s = std::max(0.0, along_side(side, p));
    return {{side * s * sin_, p.y(), -s * cos_}, normal_of(side)};
  }

  double angle_deg_, extent_, sin_ = 0.0, cos_ = 0.0, slope_ = 0.0;
};

SurfacePoint Wedge::track(const SurfacePoint& from, const Vec3& p) const noexcept {
  double side = from.point_mm.x() < 0.0 ? -1.0 : 1.0;
  if (from.point_mm.x() == 0.0 && from.normal.x() * cos_ < 0.0) side = -1.0;
  if (along_side(side, p) >= 0.0) return on_side(side, p);
  if (along_side(-side, p) > 0.0) return on_side(-side, p);
  // The edge is closest. p is outside a ridge if outside either half-plane, and outside a valley if outside
  // both; the normal chosen tells.
  SurfacePoint one = on_side(side, p), other = on_side(-side, p);
  const double depth_one = (one.point_mm - p).dot(one.normal),
               depth_other = (other.point_mm - p).dot(other.normal);
  const bool ridge = cos_ > 0.0;
  return (ridge ? depth_other < depth_one : depth_other > depth_one) ? other : one;
}

std::optional<SurfacePoint> Wedge::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  const Vec3 largest = a.cwiseAbs().cwiseMax(b.cwiseAbs());
  const double rounding = gamma(8) * (largest.z() + std::abs(slope_) * largest.x());
  // The height over the wedge is linear on each side of x = 0.
  const bool crosses = (a.x() < 0.0) != (b.x() < 0.0) && d.x() != 0.0;
  const double middle = crosses ? std::clamp(-a.x() / d.x(), 0.0, 1.0) : 1.0;
  const double ends[3] = {0.0, middle, 1.0};
  for (int i = 0; i < (crosses ? 2 : 1); ++i) {
    const Vec3 p0 = a + ends[i] * d, p1 = a + ends[i + 1] * d;
    // Exactly on the edge, despite the parameter's rounding.
    const double g0 = i == 1 ? p0.z() : height_over(p0);
    const double g1 = crosses && i == 0 ? p1.z() : height_over(p1);
    if (!(g0 >= -rounding && g1 < 0.0 && g1 < g0)) continue;
    const Vec3 entry = p0 + std::clamp(g0 / (g0 - g1), 0.0, 1.0) * (p1 - p0);
    const double side = crosses ? ((i == 0) == (a.x() < 0.0) ? -1.0 : 1.0) : (entry.x() < 0.0 ? -1.0 : 1.0);
    const double x = side < 0.0 ? std::min(entry.x(), 0.0) : std::max(entry.x(), 0.0);
    return SurfacePoint{{x, entry.y(), -slope_ * std::abs(x)}, normal_of(side)};
  }
  return std::nullopt;
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_wedge(double angle_deg, double extent_mm) {
  if (!(angle_deg >= kSharpestDeg && angle_deg <= 360.0 - kSharpestDeg)) return nullptr;
  if (!std::isfinite(extent_mm) || !(extent_mm > 0.0)) return nullptr;
  return std::make_shared<Wedge>(angle_deg, extent_mm);
}

}  // namespace palpate::geometry
