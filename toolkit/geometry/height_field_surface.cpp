#include "toolkit/geometry/height_field_surface.h"

#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/segment_root_search.h"

namespace palpate::geometry {
namespace {

// Newton steps of one track(). With a trust radius of a twenty-fifth of the wavelength they span over ten
// waves.
constexpr int kTrackSteps = 300;
// An eigenvalue below this share of the larger one is noise, and the Hessian is shifted up to it. The square
// root of the unit roundoff balances a step's error against a missed negative curvature.
const double kMinCurvature = std::sqrt(kUnitRoundoff);

/// Half the squared distance from (x, y, f) to p, with gradient and Hessian in (x, y).
struct Local {
  double half_sq = 0.0, gx = 0.0, gy = 0.0, a = 0.0, b = 0.0, c = 0.0;
  [[nodiscard]] double gradient_sq() const noexcept { return gx * gx + gy * gy; }
};

Local local(const Jet& j, double x, double y, const Vec3& p) noexcept {
  const double dx = x - p.x(), dy = y - p.y(), r = j.f - p.z();
  return {0.5 * (dx * dx + dy * dy + r * r), dx + r * j.fx,           dy + r * j.fy,
          1.0 + j.fx * j.fx + r * j.fxx,     j.fx * j.fy + r * j.fxy, 1.0 + j.fy * j.fy + r * j.fyy};
}

struct Step {
  double x = 0.0, y = 0.0;
  bool convex = false;  ///< plain Newton step of a convex neighbourhood
  [[nodiscard]] double length() const noexcept { return std::hypot(x, y); }
};

/// Newton step with the Hessian shifted until positive; along the most negative curvature where the gradient
/// vanishes (a crest exactly above p).
Step newton_step(const Local& at, double reach, double gradient_rounding) noexcept {
  const double mean = 0.5 * (at.a + at.c), half_gap = std::hypot(0.5 * (at.a - at.c), at.b);
  const double least = mean - half_gap, most = std::max(std::abs(mean + half_gap), std::abs(least));
  const bool convex = least > kMinCurvature * most;
  if (!convex && least < 0.0 && at.gradient_sq() <= gradient_rounding * gradient_rounding &&
      std::isfinite(reach)) {
    // Eigenvector of `least`: the longer row of (H - least I) gives it. Its sign is fixed.
    double ex = at.b, ey = least - at.a;
    if (std::abs(at.a - least) < std::abs(at.c - least)) ex = least - at.c, ey = at.b;
    const double size = std::hypot(ex, ey);
    return size > 0.0 ? Step{reach * ex / size, reach * ey / size, false} : Step{reach, 0.0, false};
  }
  const double shift = convex ? 0.0 : kMinCurvature * most - least;
  const double a = at.a + shift, c = at.c + shift;
  const double det = a * c - at.b * at.b;
  return {-(c * at.gx - at.b * at.gy) / det, -(a * at.gy - at.b * at.gx) / det, convex};
}

}  // namespace

SurfacePoint HeightFieldSurface::on_surface(double x, double y) const noexcept {
  const Jet j = jet(x, y);
  return {{x, y, j.f}, Vec3(-j.fx, -j.fy, 1.0).normalized()};
}

SurfacePoint HeightFieldSurface::descend(double x, double y, const Vec3& p) const noexcept {
  double reach = trust_mm();
  Local here = local(jet(x, y), x, y, p);
  for (int i = 0; i < kTrackSteps; ++i) {
    const double position_rounding =
        kUnitRoundoff * (std::abs(x) + std::abs(y) + std::abs(p.x()) + std::abs(p.y()));
    const double gradient_rounding = gamma(8) * (std::abs(x) + std::abs(y) + std::sqrt(here.half_sq));
    Step step = newton_step(here, reach, gradient_rounding);
    double length = step.length();
    if (!(length > position_rounding)) break;
    if (length > reach) {
      step.x *= reach / length;
      step.y *= reach / length;
      length = reach;
    }
    const double next_x = x + step.x, next_y = y + step.y;
    const Local there = local(jet(next_x, next_y), next_x, next_y, p);
    // Near the minimum the gradient still resolves a step where the distance does not.
    const bool better = there.half_sq < here.half_sq ||
                        (step.convex && there.gradient_sq() < here.gradient_sq() && length < reach);
    if (better) {
      x = next_x;
      y = next_y;
      here = there;
      reach = std::min(trust_mm(), 2.0 * reach);
    } else {
      reach = 0.5 * length;
      if (!(reach > position_rounding)) break;
    }
  }
  return on_surface(x, y);
}

SurfacePoint HeightFieldSurface::track(const SurfacePoint& from, const Vec3& p_mm) const noexcept {
  return descend(from.point_mm.x(), from.point_mm.y(), p_mm);
}

double HeightFieldSurface::signed_distance_mm(const Vec3& p_mm) const noexcept {
  const double distance = (closest(p_mm).point_mm - p_mm).norm();
  return p_mm.z() < jet(p_mm.x(), p_mm.y()).f ? -distance : distance;
}

std::optional<SurfacePoint> HeightFieldSurface::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  // The point at parameter t carries the rounding of a + t d and of the height.
  const double rounding = rounding_mm(a.cwiseAbs().cwiseMax(b.cwiseAbs()));
  const auto along = [&](double t) noexcept {
    const Vec3 p = a + t * d;
    const Jet j = jet(p.x(), p.y());
    return SegmentSample{p.z() - j.f, d.z() - j.fx * d.x() - j.fy * d.y(), rounding};
  };
  const std::optional<double> t =
      first_entry_along(along, rise_bound(d.x(), d.y()), fall_bound(d.x(), d.y()), 0.0, 1.0);
  if (!t) return std::nullopt;
  const Vec3 p = a + *t * d;
  return on_surface(p.x(), p.y());
}

SurfacePoint HeightFieldSurface::at(double u, double v) const noexcept {
  return on_surface((u - 0.5) * extent_mm_, (v - 0.5) * extent_mm_);
}

}  // namespace palpate::geometry
