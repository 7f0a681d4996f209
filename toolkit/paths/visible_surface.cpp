#include "toolkit/paths/visible_surface.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/statistics.h"

namespace palpate::paths {
namespace {

// The fit radius is chosen so that the median ball holds between these numbers of points.
constexpr std::size_t kMaxInBall = 64;
constexpr int kRadiusTrials = 24;
constexpr double kRadiusFactor = 1.3;
constexpr std::size_t kSampledBalls = 129;
// With fewer points, or a centroid beyond this share of the radius (a straight border, seen from itself, has
// 0.37), the surface ends.
constexpr std::size_t kMinFitted = 6;
constexpr double kBorderOffset = 0.5;

std::size_t median_in_ball(const cloud::Cloud& cloud, const search::PointSearch& points, double radius) {
  std::vector<std::size_t> counts;
  for (std::size_t s = 0; s < kSampledBalls; ++s) {
    const Vec3 p = cloud.local_mm(s * (cloud.size() - 1) / (kSampledBalls - 1));
    std::size_t count = 0;
    points.around(p, kMaxFitted, [&](const Vec3& q) { count += (q - p).squaredNorm() < radius * radius; });
    counts.push_back(count);
  }
  return upper_median(std::move(counts));
}

}  // namespace

PlaneFit fit_plane(const search::PointSearch& points, const Vec3& p, double radius, const Vec3& side) {
  double weights = 0.0;
  std::size_t count = 0;
  Vec3 sum = Vec3::Zero();
  Mat3 products = Mat3::Zero();
  points.around(p, kMaxFitted, [&](const Vec3& q) {
    const Vec3 offset = (q - p) / radius;
    const double rest = 1.0 - offset.squaredNorm();
    if (rest <= 0.0) return;
    const double w = rest * rest;
    weights += w;
    sum += w * offset;
    products += w * offset * offset.transpose();
    ++count;
  });
  PlaneFit fit;
  if (count < kMinFitted || !(weights > 0.0)) return fit;
  const Vec3 mean = sum / weights;
  Eigen::SelfAdjointEigenSolver<Mat3> solver;
  solver.computeDirect(products / weights - mean * mean.transpose());
  fit.normal = solver.eigenvectors().col(0).normalized();
  if (!is_finite(fit.normal)) return fit;
  if (fit.normal.dot(side) < 0.0) fit.normal = -fit.normal;
  fit.height = radius * mean.dot(fit.normal);
  fit.good = (mean - mean.dot(fit.normal) * fit.normal).norm() < kBorderOffset &&
             std::abs(mean.dot(fit.normal)) < kBorderOffset;
  return fit;
}

Result<FitSearch> choose_fit_radius(const cloud::Cloud& cloud, const geometry::Aabb& box) {
  const Vec3 e = box.extent_mm();
  // First guess: the points spread over the box's faces.
  const double faces = e.x() * e.y() + e.y() * e.z() + e.z() * e.x();
  FitSearch fitting;
  fitting.radius_mm = std::sqrt(static_cast<double>(kMaxInBall) * faces /
                                (std::numbers::pi * static_cast<double>(cloud.size())));
  if (!(fitting.radius_mm > 0.0))
    return Error{"the points of the cloud stand in one line or place", "an exploration needs a surface"};
  for (int trial = 0; trial < kRadiusTrials; ++trial) {
    fitting.points = std::make_unique<search::PointSearch>(cloud, fitting.radius_mm);
    const std::size_t median = median_in_ball(cloud, *fitting.points, fitting.radius_mm);
    if (median >= kMinInBall && median <= kMaxInBall) return fitting;
    fitting.radius_mm *= median < kMinInBall ? kRadiusFactor : 1.0 / kRadiusFactor;
  }
  fitting.points =
      std::make_unique<search::PointSearch>(cloud, fitting.radius_mm);  // uneven clouds: the best possible
  return fitting;
}

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
    return Error{"the cloud has too few points to lay a path over", "give at least 16"};
  PALPATE_ASSIGN(FitSearch fitting, choose_fit_radius(cloud, cloud.box_mm()));
  return std::unique_ptr<VisibleSurface>(std::make_unique<SeenPoints>(view, cloud, std::move(fitting)));
}

namespace {

// Tolerance beyond a facet's edge, so that rounding leaves no gap between neighbours.
constexpr double kEdgeSlack = 1e-9;
// Most cells per facet on average; beyond it the cells are enlarged.
constexpr std::size_t kMaxCellsPerFacet = 8;

using Triangle = std::array<std::uint32_t, 3>;

/// A facet's corners along the plan's axes, and their heights.
struct Corners {
  Vec3 a, b, c;
};

class SeenMesh final : public VisibleSurface {
 public:
  SeenMesh(const ViewFrame& view, double detail_mm, const geometry::TriangleMesh& mesh, const Vec3& origin_mm)
      : VisibleSurface(view, detail_mm),
        mesh_(mesh),
        origin_mm_(origin_mm),
        hand_(view.across_u.cross(view.across_v).dot(view.towards_eye) > 0.0 ? 1.0 : -1.0) {
    add_normals();
    cell_mm_ = std::max(detail_mm, std::numeric_limits<double>::min());
    while (!sort_into_cells()) cell_mm_ *= 2.0;
  }

  [[nodiscard]] std::optional<geometry::SurfacePoint> at(double u, double v) const override {
    const Vec3 plan = view().in_plan(u, v);
    const PlanCell cell = view().cell_of(plan, cell_mm_);
    const double x = plan.dot(view().across_u), y = plan.dot(view().across_v);
    double best = -std::numeric_limits<double>::infinity();
    Vec3 share = Vec3::Zero();
    std::uint32_t facet = 0;
    auto it = std::lower_bound(items_.begin(), items_.end(), Item{cell, 0});
    for (; it != items_.end() && it->cell == cell; ++it) {
      const Corners k = corners(mesh_.triangles[it->facet]);
      const double area = cross(k.b - k.a, k.c - k.a);
      if (area == 0.0) continue;  // seen edge on
      const Vec3 p(x, y, 0.0);
      const double at_b = cross(p - k.a, k.c - k.a) / area, at_c = cross(k.b - k.a, p - k.a) / area;
      const double at_a = 1.0 - at_b - at_c;
      if (std::min({at_a, at_b, at_c}) < -kEdgeSlack) continue;
      const double height = at_a * k.a.z() + at_b * k.b.z() + at_c * k.c.z();
      if (height <= best) continue;
      best = height;
      facet = it->facet;
      share = hand_ * area > 0.0 ? Vec3(at_a, at_b, at_c) : Vec3(Vec3::Zero());  // zero: its back
    }
    if (share.isZero()) return std::nullopt;
    const Triangle& t = mesh_.triangles[facet];
    const Vec3 normal = share[0] * normals_[t[0]] + share[1] * normals_[t[1]] + share[2] * normals_[t[2]];
    if (!(normal.dot(view().towards_eye) > 0.0)) return std::nullopt;
    return geometry::SurfacePoint{plan + best * view().towards_eye, normal.normalized()};
  }

  [[nodiscard]] bool shows_anything() const {
    return std::any_of(mesh_.triangles.begin(), mesh_.triangles.end(), [&](const Triangle& t) {
      const Corners k = corners(t);
      return hand_ * cross(k.b - k.a, k.c - k.a) > 0.0;
    });
  }

 private:
  struct Item {
    PlanCell cell;
    std::uint32_t facet;
    auto operator<=>(const Item&) const = default;
  };

  static double cross(const Vec3& a, const Vec3& b) noexcept { return a.x() * b.y() - a.y() * b.x(); }
  [[nodiscard]] Vec3 local(std::uint32_t vertex) const { return mesh_.vertices_mm[vertex] - origin_mm_; }
  [[nodiscard]] Corners corners(const Triangle& t) const {
    const auto seen = [&](std::uint32_t vertex) {
      const Vec3 p = local(vertex);
      return Vec3(p.dot(view().across_u), p.dot(view().across_v), view().height(p));
    };
    return {seen(t[0]), seen(t[1]), seen(t[2])};
  }

  void add_normals() {
    normals_.assign(mesh_.vertices_mm.size(), Vec3::Zero());
    for (const Triangle& t : mesh_.triangles)
      for (int corner = 0; corner < 3; ++corner) {
        const Vec3 p = local(t[static_cast<std::size_t>(corner)]);
        const Vec3 a = local(t[static_cast<std::size_t>((corner + 1) % 3)]) - p,
                   b = local(t[static_cast<std::size_t>((corner + 2) % 3)]) - p;
        const Vec3 n = a.cross(b);
        const double size = n.norm();
        if (!(size > 0.0) || !std::isfinite(size)) continue;
        normals_[t[static_cast<std::size_t>(corner)]] += (std::atan2(size, a.dot(b)) / size) * n;
      }
    for (Vec3& n : normals_)
      if (n.norm() > 0.0) n.normalize();
  }

  /// False if the cells are too small for the largest facets.
  [[nodiscard]] bool sort_into_cells() {
    items_.clear();
    const std::size_t most = kMaxCellsPerFacet * mesh_.triangles.size() + 1;
    for (std::uint32_t i = 0; i < mesh_.triangles.size(); ++i) {
      const Triangle& t = mesh_.triangles[i];
      PlanCell low = view().cell_of(local(t[0]), cell_mm_), high = low;
      for (const std::uint32_t vertex : {t[1], t[2]}) {
        const PlanCell cell = view().cell_of(local(vertex), cell_mm_);
        low = {std::min(low.row, cell.row), std::min(low.column, cell.column)};
        high = {std::max(high.row, cell.row), std::max(high.column, cell.column)};
      }
      const double cells =
          static_cast<double>(high.row - low.row + 1) * static_cast<double>(high.column - low.column + 1);
      if (static_cast<double>(items_.size()) + cells > static_cast<double>(most)) return false;
      for (std::int64_t row = low.row; row <= high.row; ++row)
        for (std::int64_t column = low.column; column <= high.column; ++column)
          items_.push_back({{row, column}, i});
    }
    std::sort(items_.begin(), items_.end());
    return true;
  }

  const geometry::TriangleMesh& mesh_;
  Vec3 origin_mm_;
  double hand_;  ///< of the plan's axes: facets with this sign of area show their outer side
  double cell_mm_ = 0.0;
  std::vector<Vec3> normals_;  ///< at corners, weighted by angle
  std::vector<Item> items_;
};

/// The median of the facets' longest edges.
double median_edge(const geometry::TriangleMesh& mesh) {
  std::vector<double> edges;
  edges.reserve(mesh.triangles.size());
  for (const Triangle& t : mesh.triangles) {
    const Vec3 &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]], &c = mesh.vertices_mm[t[2]];
    edges.push_back(std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()}));
  }
  return upper_median(std::move(edges));
}

}  // namespace

Result<std::unique_ptr<VisibleSurface>> make_visible_mesh(const ViewFrame& view,
                                                          const geometry::TriangleMesh& mesh,
                                                          const Vec3& origin_mm) {
  auto seen = std::make_unique<SeenMesh>(view, median_edge(mesh), mesh, origin_mm);
  if (!seen->shows_anything())
    return Error{"no face of the model shows its outer side from there",
                 "look from another side: from=x, -x, y, -y, z or -z; or turn the faces over"};
  return std::unique_ptr<VisibleSurface>(std::move(seen));
}

}  // namespace palpate::paths
