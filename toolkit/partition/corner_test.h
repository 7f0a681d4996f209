// The eight-point test of section 3.1.2.1 and the four-point test of section 3.1.2.2, as printed: neighbours
// of a point are looked for in the leaves that hold the corners of a cube (a square) centred at it, whose
// half diagonal is the cut-off distance. What lies in a leaf between the corners, or beyond a face of the
// cube but within the distance, is missed; the exact way is visit_ranges with the distance as reach.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "toolkit/partition/space_tree.h"

namespace palpate::partition {

/// Calls visit(range) for the distinct leaves that hold a corner of the box [low, high]; corners outside the
/// tree hold none. In the order of the corners. visit returns false to stop; false when stopped.
/// 2^kAxes descents.
template <int kAxes, class Visit>
bool visit_corner_leaves(const SpaceTree<kAxes>& tree, const Vec3& low_mm, const Vec3& high_mm,
                         Visit&& visit) {
  std::array<std::uint32_t, SpaceTree<kAxes>::kChildren> seen{};
  std::size_t count = 0;
  for (std::uint32_t corner = 0; corner < seen.size(); ++corner) {
    Vec3 at = low_mm;
    for (int axis = 0; axis < kAxes; ++axis)
      if ((corner >> axis & 1u) != 0) at[axis] = high_mm[axis];
    if (!tree.frame().template holds<kAxes>(at)) continue;
    const std::uint32_t node = leaf_at<kAxes>(tree.nodes(), tree.frame(), at).node;
    const auto end = seen.begin() + static_cast<std::ptrdiff_t>(count);
    if (std::find(seen.begin(), end, node) != end) continue;
    seen[count++] = node;
    const TreeNode& leaf = tree.nodes()[node];
    if (!visit(PlaceRange{leaf.begin, leaf.end})) return false;
  }
  return true;
}

/// The printed test around one point: a cube, or a square, of half diagonal `cutoff_mm`.
template <int kAxes, class Visit>
bool visit_corner_test(const SpaceTree<kAxes>& tree, const Vec3& point_mm, double cutoff_mm, Visit&& visit) {
  const Vec3 half = Vec3::Constant(cutoff_mm / std::sqrt(static_cast<double>(kAxes)));
  return visit_corner_leaves(tree, point_mm - half, point_mm + half, visit);
}

/// The printed test as a broad phase: the leaves at the corners of the box around a segment, widened by
/// `reach_mm`. For what section 3.1.3 asks of the grid, all crossed cells, it is right only while the box
/// spans no more than two leaves along an axis.
template <int kAxes, class Visit>
bool visit_ranges_by_corners(const SpaceTree<kAxes>& tree, const Vec3& a_mm, const Vec3& b_mm,
                             const Vec3& reach_mm, Visit&& visit) {
  if (!is_finite(a_mm) || !is_finite(b_mm)) return true;
  return visit_corner_leaves(tree, a_mm.cwiseMin(b_mm) - reach_mm, a_mm.cwiseMax(b_mm) + reach_mm, visit);
}

/// What the printed test finds of the points within a distance.
struct CornerTestCount {
  std::uint64_t within = 0;  ///< pairs of a query and a point within the distance, the query itself apart
  std::uint64_t missed = 0;  ///< of these, in no leaf that the printed test looks into
  std::uint64_t looked_at_exact = 0;    ///< points in the leaves that the exact way looks into
  std::uint64_t looked_at_corners = 0;  ///< and the printed test
};

/// Asks for the neighbours within `cutoff_mm` of every `stride`-th place. `cloud` is the one the tree was
/// built from, order() must still be there. O(queries x points in the leaves around).
template <int kAxes>
[[nodiscard]] CornerTestCount count_corner_test(const SpaceTree<kAxes>& tree, const cloud::Cloud& cloud,
                                                double cutoff_mm, std::size_t stride);

extern template CornerTestCount count_corner_test<2>(const SpaceTree<2>&, const cloud::Cloud&, double,
                                                     std::size_t);
extern template CornerTestCount count_corner_test<3>(const SpaceTree<3>&, const cloud::Cloud&, double,
                                                     std::size_t);

}  // namespace palpate::partition
