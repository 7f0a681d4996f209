// What shows of a model from one side: the surface that paths follow where there is no formula. Internal to
// trace.
#pragma once

#include <algorithm>
#include <cmath>
#include <compare>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include "toolkit/core/result.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/trace/paths.h"

namespace palpate::trace {

/// The direction out of an open surface: the side its faces look to, or up for a height field. Nothing where
/// the model is closed, or its points do not say.
[[nodiscard]] std::optional<Vec3> open_side(const PathTarget& target);

/// A rise steeper than this many times the way in the plan is an edge between two surfaces: 76 degrees, as in
/// cloud::is_single_valued().
inline constexpr double kSteepest = 4.0;

/// Cell coordinates beyond this are one: far fewer than a 64-bit number holds, far more than a model has.
inline constexpr double kLastCell = 0x1p40;

/// A square of the plan.
struct PlanCell {
  std::int64_t row = 0, column = 0;
  auto operator<=>(const PlanCell&) const = default;
};

/// A rectangle across the line of sight, around all points; (u, v) in [0, 1] are places on it. Everything
/// here is relative to the cloud's origin.
struct View {
  Vec3 towards_eye = Vec3::UnitZ();
  Vec3 across_u = Vec3::UnitX(), across_v = Vec3::UnitY();  ///< unit vectors, perpendicular
  double low_u_mm = 0.0, low_v_mm = 0.0;
  double extent_u_mm = 0.0, extent_v_mm = 0.0;
  double thickness_mm = 0.0;  ///< of the model along the line of sight

  /// The point of the plane through the cloud's origin.
  [[nodiscard]] Vec3 in_plan(double u, double v) const noexcept {
    return (low_u_mm + u * extent_u_mm) * across_u + (low_v_mm + v * extent_v_mm) * across_v;
  }
  [[nodiscard]] double height(const Vec3& p) const noexcept { return p.dot(towards_eye); }
  [[nodiscard]] PlanCell cell_of(const Vec3& p, double side_mm) const noexcept {
    const auto cell = [&](double mm) {
      return static_cast<std::int64_t>(std::clamp(std::floor(mm / side_mm), -kLastCell, kLastCell));
    };
    return {cell(p.dot(across_v) - low_v_mm), cell(p.dot(across_u) - low_u_mm)};
  }
  [[nodiscard]] double diagonal_mm() const noexcept {
    return std::sqrt(extent_u_mm * extent_u_mm + extent_v_mm * extent_v_mm + thickness_mm * thickness_mm);
  }
};

/// The outermost sheet along every line of sight.
class SeenSurface {
 public:
  explicit SeenSurface(const View& view, double detail_mm) : view_(view), detail_mm_(detail_mm) {}
  SeenSurface(const SeenSurface&) = delete;
  SeenSurface& operator=(const SeenSurface&) = delete;
  virtual ~SeenSurface() = default;

  /// The surface at (u, v), the normal towards the eye; nothing where no surface shows its outer side.
  [[nodiscard]] virtual std::optional<geometry::SurfacePoint> at(double u, double v) const = 0;
  [[nodiscard]] const View& view() const noexcept { return view_; }
  /// Smaller than this the surface has no shape: an edge of the mesh, or the radius that planes are fitted
  /// in.
  [[nodiscard]] double detail_mm() const noexcept { return detail_mm_; }

 private:
  View view_;
  double detail_mm_;
};

/// Seen from `from`: x, -x, y, -y, z or -z; or auto: from the open side where there is one, else from the
/// axis along which most of the model shows. The model's own faces where it has any (their sides count), else
/// planes fitted to its points. Keeps references to the target's parts. O(faces + points log points).
[[nodiscard]] Result<std::unique_ptr<SeenSurface>> look_at(const PathTarget& target, std::string_view from);

}  // namespace palpate::trace
