// Intersects a segment with the triangles of a block. Internal to local_delaunay.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <array>
#include <cstdint>

#include "toolkit/local_delaunay/block_bvh.h"
#include "toolkit/local_delaunay/facet.h"

namespace palpate::local_delaunay {

/// A step of a HIP or god object.
struct SegmentQuery {
  const Vec3 &from, &to;
  FloatBox box;
};

/// The first triangle that a segment crosses.
struct SegmentHit {
  std::array<std::uint32_t, 3> place{kNoPlace, kNoPlace, kNoPlace};
  double fraction = 2.0;  ///< along the segment
  double side = 1.0;      ///< 1: from the outer side, -1: from the inner one
};

/// d . (a x b), bit-identical for both triangles of an edge.
inline double edge_side_product(const Vec3& d, const Vec3& a, const Vec3& b, std::uint32_t place_a,
                                std::uint32_t place_b) noexcept {
  return place_a < place_b ? d.dot(a.cross(b)) : -d.dot(b.cross(a));
}

/// a . (b x c), bit-identical for any first corner of a triangle.
inline double triple_product(std::array<std::uint32_t, 3> place, std::array<Vec3, 3> at) noexcept {
  const auto first = static_cast<std::size_t>(std::min_element(place.begin(), place.end()) - place.begin());
  return at[first].dot(at[(first + 1) % 3].cross(at[(first + 2) % 3]));
}

/// Tests a triangle for an earlier hit. Exact: nothing slips between two triangles of a sheet. takes(a, b, c,
/// side): whether the triangle counts.
template <class Takes>
void intersect_triangle(const LocalDelaunayMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                        const SegmentQuery& way, SegmentHit& hit, Takes&& takes) noexcept {
  const Vec3 &from = way.from, &to = way.to;
  const Vec3 pa = mesh.at(a), pb = mesh.at(b), pc = mesh.at(c);
  const Vec3 n = (pb - pa).cross(pc - pa);
  double before = n.dot(from - pa), behind = n.dot(to - pa);
  // A segment that ends on the plane hits it: the next one would start there without a side.
  bool in = before >= 0.0 && behind <= 0.0 && before > behind,
       out = before <= 0.0 && behind >= 0.0 && behind > before;
  double larger = 1.0;
  if (!in && !out) {
    if (before != 0.0 || behind != 0.0) [[likely]]
      return;
    larger = kDenormalScale;
    before = n.dot(larger * (from - pa));
    behind = n.dot(larger * (to - pa));
    in = before >= 0.0 && behind <= 0.0 && before > behind;
    out = before <= 0.0 && behind >= 0.0 && behind > before;
    if (!in && !out) return;
  }
  const double fraction = before / (before - behind);
  if (!(fraction < hit.fraction)) return;
  const Vec3 d = larger * (to - from);
  const Vec3 ra = pa - from, rb = pb - from, rc = pc - from;
  const double u = edge_side_product(d, ra, rb, a, b), v = edge_side_product(d, rb, rc, b, c),
               w = edge_side_product(d, rc, ra, c, a);
  if (!((u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0))) return;
  const double side = in ? 1.0 : -1.0;
  if (takes(a, b, c, side)) hit = {{a, b, c}, fraction, side};
}

/// Searches a block for an earlier hit.
template <class Takes>
void intersect_block(const LocalDelaunayMesh& mesh, const BlockBvh& tree, std::uint32_t block,
                     const SegmentQuery& way, SegmentHit& hit, std::uint32_t& tested,
                     Takes&& takes) noexcept {
  if (tree.layer(block).misses(way.from, way.to)) return;
  mesh.for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    ++tested;
    if (!mesh.triangle_misses(a, b, c, way.box)) intersect_triangle(mesh, a, b, c, way, hit, takes);
  });
}

/// A block's triangles with their boxes in lanes, in the order of for_triangles_of().
struct PackedBlock {
  /// Half of the blocks have at most sixteen triangles, and one in a thousand more than this.
  static constexpr std::uint32_t kMost = 4 * kBvhWidth;
  std::uint32_t block = kNoPlace;
  std::uint32_t size = 0;  ///< over kMost if they do not fit
  std::array<BvhNode, kMost / kBvhWidth> box;
  std::array<std::array<std::uint32_t, 3>, kMost> corner;

  void pack(const LocalDelaunayMesh& mesh, std::uint32_t of) noexcept {
    block = of;
    size = 0;
    mesh.for_triangles_of_block(of, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const std::uint32_t at = size++;
      if (at >= kMost) return;
      corner[at] = {a, b, c};
      const auto [low, high] = mesh.triangle_box(a, b, c);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box[at / kBvhWidth].low[axis][at % kBvhWidth] = low[axis];
        box[at / kBvhWidth].high[axis][at % kBvhWidth] = high[axis];
      }
    });
  }
};

/// As intersect_block(), given that the layer is met and the block has at most kMost.
template <class Takes>
void intersect_packed(const LocalDelaunayMesh& mesh, const PackedBlock& block, const SegmentQuery& way,
                      SegmentHit& hit, std::uint32_t& tested, Takes&& takes) noexcept {
  tested += block.size;
  for (std::uint32_t first = 0; first < block.size; first += kBvhWidth) {
    const unsigned filled = (1u << std::min(block.size - first, kBvhWidth)) - 1u;
    for (unsigned mask = block.box[first / kBvhWidth].meets(way.box) & filled; mask != 0; mask &= mask - 1) {
      const auto& [a, b, c] = block.corner[first + static_cast<std::uint32_t>(__builtin_ctz(mask))];
      intersect_triangle(mesh, a, b, c, way, hit, takes);
    }
  }
}

}  // namespace palpate::local_delaunay
