#include "baselines/reference/box_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace palpate::baselines {
namespace {

constexpr std::uint32_t kLeaf = 4;  ///< facets a leaf; decides speed alone

double distance_sq(const geometry::Aabb& box, const Vec3& p) noexcept {
  const Vec3 d = (box.low_mm - p).cwiseMax(p - box.high_mm).cwiseMax(0.0);
  return d.squaredNorm();
}

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

}  // namespace

BoxTree::BoxTree(const SurfaceMesh& mesh) : mesh_(&mesh), order_(mesh.facets().size()) {
  std::iota(order_.begin(), order_.end(), 0u);
  std::vector<Vec3> centres;
  centres.reserve(order_.size());
  for (const Facet& f : mesh.facets()) centres.push_back((f.corner[0] + f.corner[1] + f.corner[2]) / 3.0);
  nodes_.reserve(order_.size());
  build(0, static_cast<std::uint32_t>(order_.size()), centres);
}

/// Halves the count at every level: depth at most log2(facets) + 1.
std::uint32_t BoxTree::build(std::uint32_t begin, std::uint32_t end, const std::vector<Vec3>& centres) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  geometry::Aabb box, spread;
  for (std::uint32_t i = begin; i < end; ++i) {
    for (const Vec3& corner : mesh_->facet(order_[i]).corner) box.add(corner);
    spread.add(centres[order_[i]]);
  }
  nodes_[index].box = box;
  nodes_[index].begin = begin;
  nodes_[index].end = end;
  if (end - begin <= kLeaf) return index;
  Eigen::Index axis = 0;
  spread.extent_mm().maxCoeff(&axis);
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](std::uint32_t a, std::uint32_t b) {
                     return centres[a][axis] != centres[b][axis] ? centres[a][axis] < centres[b][axis]
                                                                 : a < b;
                   });
  build(begin, middle, centres);
  const std::uint32_t right = build(middle, end, centres);
  nodes_[index].right = right;
  return index;
}

BoxTree::Nearest BoxTree::closest(const Vec3& p) const {
  Nearest best;
  best.point.distance_sq = HUGE_VAL;
  std::array<std::uint32_t, 64> stack;  // one entry a level, and there are at most 30 levels
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const std::uint32_t at = stack[--depth];
    const Node& node = nodes_[at];
    if (distance_sq(node.box, p) > best.point.distance_sq) continue;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const FacetPoint q = closest_on_facet(mesh_->facet(order_[i]), p);
        if (q.distance_sq < best.point.distance_sq ||
            (q.distance_sq == best.point.distance_sq && order_[i] < best.facet))
          best = {order_[i], q};
      }
      continue;
    }
    const bool left_first = distance_sq(nodes_[at + 1].box, p) <= distance_sq(nodes_[node.right].box, p);
    stack[depth++] = left_first ? node.right : at + 1;
    stack[depth++] = left_first ? at + 1 : node.right;
  }
  return best;
}

BoxTree::Crossing BoxTree::first_crossing(const Vec3& a, const Vec3& b,
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
  std::array<std::uint32_t, 64> stack;
  std::size_t depth = 0;
  stack[depth++] = 0;
  while (depth > 0) {
    const std::uint32_t at = stack[--depth];
    const Node& node = nodes_[at];
    if (!meets(node.box, a, d, slack, best.fraction)) continue;
    if (node.right != 0) {
      stack[depth++] = node.right;
      stack[depth++] = at + 1;
      continue;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      const Facet& f = mesh_->facet(order_[i]);
      const Vec3 n = mesh_->normal(half_facet(order_[i], 0));
      const double from = n.dot(a - f.corner[0]), to = n.dot(b - f.corner[0]);
      if (from == to || (from > 0.0) == (to > 0.0)) continue;
      if (std::abs(from) <= kTouching * slack && excepted(f)) continue;
      const double t = from / (from - to);
      if (t > best.fraction || (t == best.fraction && order_[i] > best.facet)) continue;
      if (closest_on_facet(f, a + d * t).distance_sq <= slack * slack) best = {order_[i], t};
    }
  }
  return best;
}

}  // namespace palpate::baselines
