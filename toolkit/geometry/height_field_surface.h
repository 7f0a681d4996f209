// The common part of smooth height fields z = f(x, y): tracking by a trust-region Newton method, entry by
// safe steps.
#pragma once

#include <palpate/analytic_surface.h>

namespace palpate::geometry {

/// A height and its derivatives.
struct Jet {
  double f = 0.0, fx = 0.0, fy = 0.0, fxx = 0.0, fxy = 0.0, fyy = 0.0;
};

class HeightFieldSurface : public AnalyticSurface {
 public:
  explicit HeightFieldSurface(double extent_mm) : extent_mm_(extent_mm) {}

  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const noexcept override;
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p_mm) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a_mm,
                                                        const Vec3& b_mm) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override;

 protected:
  [[nodiscard]] virtual Jet jet(double x, double y) const noexcept = 0;
  /// Bounds over the surface on the second derivative of f along (dx, dy): upper, and negated lower.
  [[nodiscard]] virtual double rise_bound(double dx, double dy) const noexcept = 0;
  [[nodiscard]] virtual double fall_bound(double dx, double dy) const noexcept = 0;
  /// Bound on the rounding error of z - f(x, y).
  [[nodiscard]] virtual double rounding_mm(const Vec3& p_mm) const noexcept = 0;
  /// Longest Newton step in plan view, a fraction of the shape's shortest length, so that no step leaves its
  /// valley of the distance. Infinite for a plane.
  [[nodiscard]] virtual double trust_mm() const noexcept = 0;

  [[nodiscard]] SurfacePoint on_surface(double x, double y) const noexcept;
  /// The local minimum of the distance to p, reached from (x, y).
  [[nodiscard]] SurfacePoint descend(double x, double y, const Vec3& p_mm) const noexcept;
  [[nodiscard]] double extent_mm() const noexcept { return extent_mm_; }

 private:
  double extent_mm_;
};

}  // namespace palpate::geometry
