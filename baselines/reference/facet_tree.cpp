// The queries on a FacetTree: closest places and crossings, the distance between a mesh and its points,
// rests.

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include <palpate/result.h>
#include "baselines/reference/facet_tree.h"
#include "toolkit/core/parallel.h"
#include "toolkit/search/point_search.h"

namespace palpate::baselines {
namespace {

constexpr std::uint32_t kLeaf = 4;  ///< facets a leaf; affects speed only

/// A start within this many rounding bounds of the facet it left is on it.
constexpr double kTouching = 4.0;

bool meets(const geometry::Aabb& box, const Vec3& a, const Vec3& d, double slack, double end) noexcept {
  double from = 0.0;
  return clip_to_box(box, a, d, slack, from, end);
}

geometry::Aabb box_of(const Facet& facet) noexcept {
  geometry::Aabb box;
  for (const Vec3& corner : facet.corner) box.add(corner);
  return box;
}

}  // namespace

FacetTree::FacetTree(const SurfaceMesh& mesh)
    : mesh_(&mesh),
      tree_(
          static_cast<std::uint32_t>(mesh.facets().size()),
          [&mesh](std::uint32_t i) { return box_of(mesh.facet(i)); }, kLeaf) {}

FacetTree::Nearest FacetTree::closest(const Vec3& p) const {
  Nearest best;
  best.point.distance_sq = HUGE_VAL;
  tree_.visit_nearest([&](const geometry::Aabb& box) { return box.distance_sq_mm2(p); }, HUGE_VAL,
                      [&](std::uint32_t i) {
                        const FacetPoint q = closest_on_facet(mesh_->facet(i), p);
                        if (q.distance_sq < best.point.distance_sq ||
                            (q.distance_sq == best.point.distance_sq && i < best.facet))
                          best = {i, q};
                        return best.point.distance_sq;
                      });
  return best;
}

void FacetTree::within(const Vec3& p, double radius, std::vector<std::uint32_t>& facets) const {
  const std::size_t before = facets.size();
  const double radius_sq = radius * radius;
  tree_.visit([&](const geometry::Aabb& box) { return box.distance_sq_mm2(p) <= radius_sq; },
              [&](std::uint32_t i) {
                if (closest_on_facet(mesh_->facet(i), p).distance_sq <= radius_sq) facets.push_back(i);
              });
  std::sort(facets.begin() + static_cast<std::ptrdiff_t>(before), facets.end());
}

FacetTree::Crossing FacetTree::first_crossing(const Vec3& a, const Vec3& b,
                                              std::uint32_t except_vertex_of) const {
  const double slack = mesh_->rounding_mm();
  const Vec3 d = b - a;
  const auto excepted = [&](const Facet& f) {
    return except_vertex_of != kNoFacet && share_vertex(mesh_->facet(except_vertex_of), f);
  };
  Crossing best{kNoFacet, 1.0};
  tree_.visit([&](const geometry::Aabb& box) { return meets(box, a, d, slack, best.fraction); },
              [&](std::uint32_t i) {
                const Facet& f = mesh_->facet(i);
                const Vec3 n = mesh_->normal(half_facet(i, 0));
                const double from = n.dot(a - f.corner[0]), to = n.dot(b - f.corner[0]);
                if (from == to || (from > 0.0) == (to > 0.0)) return;
                if (std::abs(from) <= kTouching * slack && excepted(f)) return;
                const double t = from / (from - to);
                if (t > best.fraction || (t == best.fraction && i > best.facet)) return;
                if (closest_on_facet(f, a + d * t).distance_sq <= slack * slack) best = {i, t};
              });
  return best;
}

namespace {

/// Directions closer than this are equal: a thousandth of any angle that the test distinguishes.
constexpr double kSameDirection = 1e-9;

/// Residual of least squares w = sum l_i n_i, l_i >= 0, over up to three directions; infinite if a weight is
/// negative.
double residual(const Vec3& w, std::span<const Vec3> push) {
  Eigen::Matrix<double, 3, Eigen::Dynamic> n(3, static_cast<Eigen::Index>(push.size()));
  for (std::size_t i = 0; i < push.size(); ++i) n.col(static_cast<Eigen::Index>(i)) = push[i];
  const Eigen::VectorXd l = n.colPivHouseholderQr().solve(w);
  if ((l.array() < 0.0).any()) return HUGE_VAL;
  return (n * l - w).norm();
}

std::vector<Vec3> directions(const SurfaceMesh& mesh, std::span<const std::uint32_t> facets,
                             const Vec3& proxy, double radius, const Vec3& pull) {
  std::vector<Vec3> result;
  for (const std::uint32_t i : facets) {
    Vec3 n = mesh.normal(half_facet(i, 0));
    if (radius > 0.0)
      n = (proxy - closest_on_facet(mesh.facet(i), proxy).point).normalized();
    else if (n.dot(pull) < 0.0)
      n = -n;
    const bool known = std::any_of(result.begin(), result.end(),
                                   [&](const Vec3& m) { return (m - n).norm() < kSameDirection; });
    if (!known && n != Vec3::Zero()) result.push_back(n);
  }
  return result;
}

}  // namespace

Rest rest_of(const SurfaceMesh& mesh, const FacetTree& tree, const Vec3& proxy, double radius, double reach,
             const Vec3& hip) {
  std::vector<std::uint32_t> facets;
  tree.within(proxy, radius + reach, facets);
  const Vec3 pull = proxy - hip;
  const std::vector<Vec3> push = directions(mesh, facets, proxy, radius, pull);
  Rest rest{push.size(), 0.5 * std::numbers::pi};
  const double length = pull.norm();
  if (!(length > 0.0)) {
    rest.off_rad = 0.0;
    return rest;
  }
  // The nearest sum of pushes lies in a face of their cone, spanned by at most three.
  double least = length;
  const std::size_t n = push.size();
  for (std::size_t i = 0; i < n; ++i) {
    least = std::min(least, residual(pull, std::array{push[i]}));
    for (std::size_t j = i + 1; j < n; ++j) {
      least = std::min(least, residual(pull, std::array{push[i], push[j]}));
      for (std::size_t k = j + 1; k < n; ++k)
        least = std::min(least, residual(pull, std::array{push[i], push[j], push[k]}));
    }
  }
  rest.off_rad = std::asin(std::min(1.0, least / length));
  return rest;
}

namespace {

/// Root mean square and maximum of distance(i), 0 <= i < count.
std::pair<double, double> summary(std::size_t count, int threads,
                                  const std::function<double(std::size_t)>& distance) {
  constexpr std::size_t kGrain = 256;
  std::vector<double> all(count);
  parallel_each(count, kGrain, threads, [&](std::size_t i) { all[i] = distance(i); });
  double squares = 0.0, most = 0.0;
  for (const double d : all) {
    squares += d * d;
    most = std::max(most, d);
  }
  return {std::sqrt(squares / static_cast<double>(count)), most};
}

}  // namespace

Result<MeshDistance> mesh_distance(const geometry::TriangleMesh& mesh, const cloud::Cloud& cloud,
                                   std::size_t samples, int threads) {
  if (mesh.empty() || cloud.empty()) return Error{"a distance needs triangles and points"};
  PALPATE_ASSIGN(const SurfaceMesh surface, SurfaceMesh::build(mesh, threads));
  const FacetTree tree(surface);
  MeshDistance d;
  d.samples = std::max<std::size_t>(1, std::min(samples, cloud.size()));
  std::tie(d.points_rms_mm, d.points_max_mm) = summary(d.samples, threads, [&](std::size_t i) {
    const Vec3 p = cloud.point_mm(i * cloud.size() / d.samples) - surface.origin_mm();
    return (tree.closest(p).point.point - p).norm();
  });
  const std::vector<Vec3> places = places_on(mesh, d.samples);
  const search::PointSearch points(cloud);
  std::tie(d.mesh_rms_mm, d.mesh_max_mm) = summary(d.samples, threads, [&](std::size_t i) {
    return (cloud.point_mm(points.nearest(places[i])) - places[i]).norm();
  });
  return d;
}

}  // namespace palpate::baselines
