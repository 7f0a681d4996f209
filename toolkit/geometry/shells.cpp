// A hollow ball: two nested spheres close together.
#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/segment_box.h"

namespace palpate::geometry {
namespace {

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
    const double z = 1.0 - 2.0 * v, angle = 2.0 * std::numbers::pi * u,
                 ring = std::sqrt(std::max(0.0, 1.0 - z * z));
    return on_sheet(true, {ring * std::cos(angle), ring * std::sin(angle), z}, Vec3::UnitZ());
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

}  // namespace

std::shared_ptr<const AnalyticSurface> make_shells(double radius_mm, double gap_mm) {
  if (!is_length(radius_mm) || !is_length(gap_mm) || !(gap_mm < radius_mm)) return nullptr;
  return std::make_shared<Shells>(radius_mm, gap_mm);
}

}  // namespace palpate::geometry
