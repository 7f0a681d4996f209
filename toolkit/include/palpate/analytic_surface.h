// The interface of a surface known by formula. Generated models, path generators, the `analytic` renderer and
// the ground truth of the metrics share it.
//
// First:
//   const auto model = palpate::cloud::generate({"sphere", {}});
//   const geometry::AnalyticSurface& sphere = *model->surface;
//   const geometry::SurfacePoint top = sphere.closest({0.0, 0.0, 100.0});
//   const double depth_mm = -sphere.signed_distance_mm(top.point_mm - 2.0 * top.normal);  // 2
#pragma once

#include <cmath>
#include <optional>
#include <string>

#include <palpate/geometry.h>
#include <palpate/vec.h>

namespace palpate::geometry {

/// A point on a surface and the unit normal there, pointing outward (into free space).
struct SurfacePoint {
  Vec3 point_mm = Vec3::Zero();
  Vec3 normal = Vec3::UnitZ();
};

/// True for a valid length of a surface.
[[nodiscard]] inline bool is_length(double x) noexcept {
  return std::isfinite(x) && x > 0.0;
}

/// A surface with an inside, in its model frame, mm. Immutable and safe to share between threads. The
/// noexcept members allocate nothing and have a fixed bound on iterations, so frames may call them.
class AnalyticSurface {
 public:
  virtual ~AnalyticSurface() = default;

  /// The formula, for reports ("z = 10 (cos 0.04 pi x + cos 0.04 pi y)").
  [[nodiscard]] virtual std::string formula() const = 0;
  /// The box that holds the generated points.
  [[nodiscard]] virtual Aabb box_mm() const = 0;
  /// The closest point of the whole surface. Ties are broken deterministically.
  [[nodiscard]] virtual SurfacePoint closest(const Vec3& p_mm) const noexcept = 0;
  /// Distance to the surface, negative inside.
  [[nodiscard]] virtual double signed_distance_mm(const Vec3& p_mm) const noexcept = 0;
  /// The constrained god object: the local minimum of the distance to p, reached along the surface from
  /// `from`, a point of the surface. It never jumps to another sheet.
  [[nodiscard]] virtual SurfacePoint track(const SurfacePoint& from, const Vec3& p_mm) const noexcept = 0;
  /// The first point where the segment a -> b goes from outside to inside, if any.
  [[nodiscard]] virtual std::optional<SurfacePoint> first_entry(const Vec3& a_mm,
                                                                const Vec3& b_mm) const noexcept = 0;
  /// The surface point at parameters u, v in [0, 1], which cover the generated part. For path generators.
  [[nodiscard]] virtual SurfacePoint at(double u, double v) const noexcept = 0;
};

}  // namespace palpate::geometry
