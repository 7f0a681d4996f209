#include "toolkit/paths/visible_surface.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "toolkit/core/percentiles.h"

namespace palpate::paths {
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
                 "look from another side: from=x, -x, y, -y, z or -z; or turn the faces over",
                 {},
                 0};
  return std::unique_ptr<VisibleSurface>(std::move(seen));
}

}  // namespace palpate::paths
