#include "toolkit/paths/visible_surface.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/paths/plane_fits.h"

namespace palpate::paths {
namespace {

// An open sheet's area vector keeps much of its area; a closed surface's vanishes.
constexpr double kOpenShare = 0.1;
// Repeated projections to the fitted plane; the remainder shrinks by a curvature each time.
constexpr int kPlacements = 4;
// A plan square holds about four points of a face-on model.
constexpr double kSidesPerSpacing = 2.0;

/// Two axes across the line of sight: the first alphabetically that are not along it.
ViewFrame view_from(const Vec3& eye) {
  ViewFrame view;
  view.towards_eye = eye;
  int along = 0;
  eye.cwiseAbs().maxCoeff(&along);
  const int first = along == 0 ? 1 : 0, second = along == 2 ? 1 : 2;
  view.across_u = (Vec3::Unit(first) - eye[first] * eye).normalized();
  view.across_v = eye.cross(view.across_u);
  if (view.across_v[second] < 0.0) view.across_v = -view.across_v;
  return view;
}

void fit_to(ViewFrame& view, const cloud::Cloud& cloud) {
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);
    const Vec3 seen(p.dot(view.across_u), p.dot(view.across_v), view.height(p));
    low = low.cwiseMin(seen);
    high = high.cwiseMax(seen);
  }
  view.low_u_mm = low.x();
  view.low_v_mm = low.y();
  view.extent_u_mm = high.x() - low.x();
  view.extent_v_mm = high.y() - low.y();
  view.thickness_mm = high.z() - low.z();
}

/// Plan squares with points: how much of the model is visible.
std::size_t squares_with_points(const cloud::Cloud& cloud, const Vec3& eye, double side_mm) {
  ViewFrame view = view_from(eye);
  fit_to(view, cloud);
  std::vector<PlanCell> cells;
  cells.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) cells.push_back(view.cell_of(cloud.local_mm(i), side_mm));
  std::sort(cells.begin(), cells.end());
  return static_cast<std::size_t>(std::unique(cells.begin(), cells.end()) - cells.begin());
}

Vec3 most_shows_from(const cloud::Cloud& cloud) {
  const Vec3 extent = cloud.box_mm().extent_mm();
  // The points spread over three box faces, a few per square.
  const double faces = extent.x() * extent.y() + extent.y() * extent.z() + extent.z() * extent.x();
  const double side_mm = kSidesPerSpacing * std::sqrt(faces / static_cast<double>(cloud.size()));
  Vec3 best = Vec3::UnitZ();
  if (!(side_mm > 0.0)) return best;
  std::size_t most = 0;
  for (const int axis : {2, 1, 0}) {  // ties: from above
    const std::size_t squares = squares_with_points(cloud, Vec3::Unit(axis), side_mm);
    if (squares <= most) continue;
    most = squares;
    best = Vec3::Unit(axis);
  }
  return best;
}

Vec3 eye_direction(const PathTarget& target, std::string_view from) {
  if (from == "auto") {
    const std::optional<Vec3> side = open_side(target);
    return side ? *side : most_shows_from(*target.cloud);
  }
  const Vec3 axis = Vec3::Unit(from.back() - 'x');
  return from.front() == '-' ? Vec3(-axis) : axis;
}

/// The points by plan cell, nearest to the eye first.
class SeenPoints final : public VisibleSurface {
 public:
  SeenPoints(const ViewFrame& view, const cloud::Cloud& cloud, FitSearch fitting)
      : VisibleSurface(view, fitting.radius_mm), cloud_(cloud), fitting_(std::move(fitting)) {
    items_.reserve(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vec3 p = cloud.local_mm(i);
      items_.push_back({cell_of(p), -view.height(p), static_cast<std::uint32_t>(i)});
    }
    std::sort(items_.begin(), items_.end());
  }

  [[nodiscard]] std::optional<geometry::SurfacePoint> at(double u, double v) const override {
    const Vec3 plan = view().in_plan(u, v);
    const std::optional<double> top = outermost(plan);
    if (!top) return std::nullopt;
    Vec3 p = plan + *top * view().towards_eye;
    PlaneFit fit;
    for (int i = 0; i < kPlacements; ++i) {
      fit = fit_plane(*fitting_.points, p, fitting_.radius_mm, view().towards_eye);
      const double facing = fit.normal.dot(view().towards_eye);
      if (!fit.good || facing * std::sqrt(1.0 + kSteepest * kSteepest) < 1.0) return std::nullopt;
      p += (fit.height / facing) * view().towards_eye;
    }
    return geometry::SurfacePoint{p, fit.normal};
  }

 private:
  struct Item {
    PlanCell cell;
    double depth;  ///< below the eye
    std::uint32_t index;
    auto operator<=>(const Item&) const = default;
  };

  [[nodiscard]] PlanCell cell_of(const Vec3& p) const { return view().cell_of(p, fitting_.radius_mm); }
  /// Height of a point on the outermost sheet near the line of sight: among points within a radius, the
  /// highest after lowering each by the steepest slope times its distance.
  [[nodiscard]] std::optional<double> outermost(const Vec3& plan) const {
    const PlanCell middle = cell_of(plan);
    const double radius_sq = fitting_.radius_mm * fitting_.radius_mm;
    std::optional<double> best;  // lowered
    double top = 0.0;
    for (std::int64_t row = middle.row - 1; row <= middle.row + 1; ++row)
      for (std::int64_t column = middle.column - 1; column <= middle.column + 1; ++column) {
        const PlanCell cell{row, column};
        auto it = std::lower_bound(items_.begin(), items_.end(), cell,
                                   [](const Item& item, const PlanCell& c) { return item.cell < c; });
        for (std::size_t left = kMaxFitted; it != items_.end() && it->cell == cell && left > 0;
             ++it, --left) {
          if (best && -it->depth <= *best) break;  // no deeper one is higher once lowered
          const Vec3 p = cloud_.local_mm(it->index);
          const double off_sq = (p + it->depth * view().towards_eye - plan).squaredNorm();
          if (off_sq > radius_sq) continue;
          const double sunk = -it->depth - kSteepest * std::sqrt(off_sq);
          if (best && sunk <= *best) continue;
          best = sunk;
          top = -it->depth;
        }
      }
    return best ? std::optional(top) : std::nullopt;
  }

  const cloud::Cloud& cloud_;
  FitSearch fitting_;
  std::vector<Item> items_;
};

}  // namespace

std::optional<Vec3> open_side(const PathTarget& target) {
  if (target.mesh != nullptr && !target.mesh->empty()) {
    Vec3 total = Vec3::Zero();
    double area = 0.0;
    for (const auto& t : target.mesh->triangles) {
      const Vec3& a = target.mesh->vertices_mm[t[0]];
      const Vec3 n = (target.mesh->vertices_mm[t[1]] - a).cross(target.mesh->vertices_mm[t[2]] - a);
      if (!is_finite(n)) continue;
      total += n;
      area += n.norm();
    }
    if (total.norm() > kOpenShare * area) return total.normalized();
    return std::nullopt;
  }
  if (cloud::is_single_valued(*target.cloud)) return Vec3(Vec3::UnitZ());
  return std::nullopt;
}

Result<std::unique_ptr<VisibleSurface>> make_visible_surface(const PathTarget& target,
                                                             std::string_view from) {
  const cloud::Cloud& cloud = *target.cloud;
  ViewFrame view = view_from(eye_direction(target, from));
  fit_to(view, cloud);
  if (target.mesh != nullptr && !target.mesh->empty())
    return make_visible_mesh(view, *target.mesh, cloud.origin_mm);
  if (cloud.size() < kMinInBall)
    return Error{"the cloud has too few points to lay a path over", "give at least 16", {}, 0};
  PALPATE_ASSIGN(FitSearch fitting, choose_fit_radius(cloud, cloud.box_mm()));
  return std::unique_ptr<VisibleSurface>(std::make_unique<SeenPoints>(view, cloud, std::move(fitting)));
}

}  // namespace palpate::paths
