#include "baselines/reference/facet_tree.h"

#include <algorithm>
#include <cmath>

namespace palpate::baselines {
namespace {

constexpr std::uint32_t kLeaf = 4;  ///< facets a leaf; decides speed alone

/// A start this many rounding bounds from a facet it came off is on it: it was lifted by one.
constexpr double kTouching = 4.0;

bool meets(const geometry::Aabb& box, const Vec3& a, const Vec3& d, double slack, double end) noexcept {
  double from = 0.0, to = end;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = box.low_mm[axis] - slack - a[axis], high = box.high_mm[axis] + slack - a[axis];
    if (d[axis] == 0.0) {
      if (low > 0.0 || high < 0.0) return false;
      continue;
    }
    const double t1 = low / d[axis], t2 = high / d[axis];
    from = std::max(from, std::min(t1, t2));
    to = std::min(to, std::max(t1, t2));
  }
  return from <= to;
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
    if (except_vertex_of == kNoFacet) return false;
    for (const std::uint32_t u : mesh_->facet(except_vertex_of).vertex)
      for (const std::uint32_t v : f.vertex)
        if (u == v) return true;
    return false;
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

}  // namespace palpate::baselines
