// Visible surface of points, for paths without a formula. It is seen from one side, by planes fitted to
// surrounding points. Internal to paths.
#pragma once

#include <algorithm>
#include <cmath>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/paths.h>
#include <palpate/result.h>
#include "toolkit/search/point_search.h"

namespace palpate::paths {

/// Fewer points form no surface for a path.
inline constexpr std::size_t kMinInBall = 16;
/// Most points read by a fit, so that a clump of duplicates cannot slow a frame.
inline constexpr std::size_t kMaxFitted = 4096;
/// A plane fitted around a point.
struct PlaneFit {
  bool good = false;
  Vec3 normal = Vec3::UnitZ();
  double height = 0.0;  ///< of the plane above the point, along the normal
};

/// The plane through the points within `radius` of `p` (relative to the cloud's origin), with weights falling
/// smoothly to zero; its normal is on the side of `side`. Invalid where the points end.
[[nodiscard]] PlaneFit fit_plane(const search::PointSearch& points, const Vec3& p, double radius,
                                 const Vec3& side);

/// Fit radius, and a search with cells of that size.
struct FitSearch {
  double radius_mm = 0.0;
  std::unique_ptr<search::PointSearch> points;
};

/// A radius at which the median ball holds 16 to 64 points, as far as uneven clouds allow. O(n log n).
[[nodiscard]] Result<FitSearch> choose_fit_radius(const cloud::Cloud& cloud, const geometry::Aabb& box);

/// The outward direction of an open surface: its faces' side, or up for a height field. Nothing if closed or
/// undecidable.
[[nodiscard]] std::optional<Vec3> open_side(const PathTarget& target);

/// A steeper rise over plan distance is an edge between two surfaces: 76 degrees, as in
/// cloud::is_single_valued().
inline constexpr double kSteepest = 4.0;

/// Coordinates are clamped here: far within 64 bits, far beyond any model.
inline constexpr double kLastCell = 0x1p40;

/// A square of the plan.
struct PlanCell {
  std::int64_t row = 0, column = 0;
  auto operator<=>(const PlanCell&) const = default;
};

/// A rectangle across the line of sight around all points; (u, v) in [0, 1]. All positions are relative to
/// the cloud's origin.
struct ViewFrame {
  Vec3 towards_eye = Vec3::UnitZ();
  Vec3 across_u = Vec3::UnitX(), across_v = Vec3::UnitY();  ///< unit vectors, perpendicular
  double low_u_mm = 0.0, low_v_mm = 0.0;
  double extent_u_mm = 0.0, extent_v_mm = 0.0;
  double thickness_mm = 0.0;  ///< extent of the model along the line of sight

  /// The point on the plane through the cloud's origin.
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

/// The outermost sheet along each line of sight.
class VisibleSurface {
 public:
  explicit VisibleSurface(const ViewFrame& view, double detail_mm) : view_(view), detail_mm_(detail_mm) {}
  VisibleSurface(const VisibleSurface&) = delete;
  VisibleSurface& operator=(const VisibleSurface&) = delete;
  virtual ~VisibleSurface() = default;

  /// The surface at (u, v), normal towards the eye; nothing where no outer side is visible.
  [[nodiscard]] virtual std::optional<geometry::SurfacePoint> at(double u, double v) const = 0;
  [[nodiscard]] const ViewFrame& view() const noexcept { return view_; }
  /// Size below which the surface has no shape: a mesh edge, or the fit radius.
  [[nodiscard]] double detail_mm() const noexcept { return detail_mm_; }

 private:
  ViewFrame view_;
  double detail_mm_;
};

/// Seen from `from`: x, -x, y, -y, z or -z; auto: the open side, else the axis that shows most of the model.
/// Uses the model's faces (sides count), else fitted planes. Keeps references to the target's parts. O(faces
/// + points log points).
[[nodiscard]] Result<std::unique_ptr<VisibleSurface>> make_visible_surface(const PathTarget& target,
                                                                           std::string_view from);

/// The outermost facet along each line of sight, with exact height and a continuous normal blended from the
/// corners. Keeps a reference to the mesh. An Error if no facet shows its outer side. O(faces).
[[nodiscard]] Result<std::unique_ptr<VisibleSurface>> make_visible_mesh(const ViewFrame& view,
                                                                        const geometry::TriangleMesh& mesh,
                                                                        const Vec3& origin_mm);

}  // namespace palpate::paths
