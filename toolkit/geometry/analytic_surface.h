// The contract of a surface known by formula: what generated models, path generators, the `analytic` renderer
// and the ground truth of the metrics share.
#pragma once

#include <cmath>
#include <optional>
#include <string>

#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::geometry {

/// A point on a surface and the unit normal there, pointing outward (into free space).
struct SurfacePoint {
  Vec3 point_mm = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();
};

/// What a length of a surface must be.
[[nodiscard]] inline bool is_length(double x) noexcept {
  return std::isfinite(x) && x > 0.0;
}

/// A surface with an inside, in its model frame, mm. Immutable and safe to share between threads. The
/// noexcept members allocate nothing and stop after a written number of iterations, so that a frame may call
/// them.
class AnalyticSurface {
 public:
  virtual ~AnalyticSurface() = default;

  /// The formula, for reports ("z = 10 (cos 0.04 pi x + cos 0.04 pi y)").
  [[nodiscard]] virtual std::string formula() const = 0;
  /// The box that generated points fill.
  [[nodiscard]] virtual Aabb box_mm() const = 0;
  /// The closest point of the whole surface. Ties: any of them, the same one every time.
  [[nodiscard]] virtual SurfacePoint closest(const Vec3& p_mm) const noexcept = 0;
  /// Distance to the surface, negative inside.
  [[nodiscard]] virtual double signed_distance_mm(const Vec3& p_mm) const noexcept = 0;
  /// The constrained god object: the local minimum of the distance to p reached from `from` along the
  /// surface. It does not jump to another sheet, however near. `from` is a point of the surface.
  [[nodiscard]] virtual SurfacePoint track(const SurfacePoint& from, const Vec3& p_mm) const noexcept = 0;
  /// Where the segment a -> b first goes from outside to inside, if it does.
  [[nodiscard]] virtual std::optional<SurfacePoint> first_entry(const Vec3& a_mm,
                                                                const Vec3& b_mm) const noexcept = 0;
  /// The surface point at the parameters u, v in [0, 1], which cover the generated part; path generators use
  /// it.
  [[nodiscard]] virtual SurfacePoint at(double u, double v) const noexcept = 0;
};

}  // namespace palpate::geometry
