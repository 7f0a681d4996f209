// Internal to stars: the triangles of a block that a step goes through.
#pragma once

#include <Eigen/Geometry>  // cross products
#include <algorithm>
#include <array>
#include <cstdint>

#include "toolkit/stars/facet.h"
#include "toolkit/stars/star_tree.h"

namespace palpate::stars {

/// A step of a HIP, or of a god object.
struct Way {
  const Vec3 &from, &to;
  FloatBox box;
};

/// The first triangle that a way goes through.
struct Hit {
  std::array<std::uint32_t, 3> place{kNoPlace, kNoPlace, kNoPlace};
  double fraction = 2.0;  ///< of the way
  double side = 1.0;      ///< 1: it comes from the outer side, -1: from the inner one
};

/// d . (a x b), the same to the bit for both triangles of an edge.
inline double along_edge(const Vec3& d, const Vec3& a, const Vec3& b, std::uint32_t place_a,
                         std::uint32_t place_b) noexcept {
  return place_a < place_b ? d.dot(a.cross(b)) : -d.dot(b.cross(a));
}

/// a . (b x c), the same to the bit whichever corner of a triangle comes first.
inline double triple(std::array<std::uint32_t, 3> place, std::array<Vec3, 3> at) noexcept {
  const auto first = static_cast<std::size_t>(std::min_element(place.begin(), place.end()) - place.begin());
  return at[first].dot(at[(first + 1) % 3].cross(at[(first + 2) % 3]));
}

/// An earlier hit in a triangle, exactly: nothing slips through between two triangles of a sheet. takes(a, b,
/// c, side): whether that triangle counts.
template <class Takes>
void pierce_triangle(const StarMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c, const Way& way,
                     Hit& hit, Takes&& takes) noexcept {
  const Vec3 &from = way.from, &to = way.to;
  const Vec3 pa = mesh.at(a), pb = mesh.at(b), pc = mesh.at(c);
  const Vec3 n = (pb - pa).cross(pc - pa);
  double before = n.dot(from - pa), behind = n.dot(to - pa);
  // A way that ends on the plane has met it: begun there in the next frame, it could not tell its side.
  bool in = before >= 0.0 && behind <= 0.0 && before > behind,
       out = before <= 0.0 && behind >= 0.0 && behind > before;
  double larger = 1.0;
  if (!in && !out) {
    if (before != 0.0 || behind != 0.0) [[likely]]
      return;
    larger = kOutOfDenormals;
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
  const double u = along_edge(d, ra, rb, a, b), v = along_edge(d, rb, rc, b, c),
               w = along_edge(d, rc, ra, c, a);
  if (!((u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0))) return;
  const double side = in ? 1.0 : -1.0;
  if (takes(a, b, c, side)) hit = {{a, b, c}, fraction, side};
}

/// Looks for an earlier hit in a block.
template <class Takes>
void pierce_block(const StarMesh& mesh, const StarTree& tree, std::uint32_t block, const Way& way, Hit& hit,
                  std::uint32_t& tested, Takes&& takes) noexcept {
  if (tree.layer(block).misses(way.from, way.to)) return;
  mesh.for_triangles_of_block(block, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    ++tested;
    if (!mesh.triangle_misses(a, b, c, way.box)) pierce_triangle(mesh, a, b, c, way, hit, takes);
  });
}

/// The triangles of a block with their boxes side by side, in the order that for_triangles_of() has.
struct PackedBlock {
  /// Of a block's eight places half have sixteen triangles or fewer, and one block in a thousand more than
  /// these.
  static constexpr std::uint32_t kMost = 4 * kFanOut;
  std::uint32_t block = kNoPlace;
  std::uint32_t size = 0;  ///< more than kMost where there is no room
  std::array<BoxNode, kMost / kFanOut> box;
  std::array<std::array<std::uint32_t, 3>, kMost> corner;

  void pack(const StarMesh& mesh, std::uint32_t of) noexcept {
    block = of;
    size = 0;
    mesh.for_triangles_of_block(of, [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      const std::uint32_t at = size++;
      if (at >= kMost) return;
      corner[at] = {a, b, c};
      const auto [low, high] = mesh.triangle_box(a, b, c);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        box[at / kFanOut].low[axis][at % kFanOut] = low[axis];
        box[at / kFanOut].high[axis][at % kFanOut] = high[axis];
      }
    });
  }
};

/// As pierce_block(), where the layer is met and the block has no more than kMost.
template <class Takes>
void pierce_packed(const StarMesh& mesh, const PackedBlock& block, const Way& way, Hit& hit,
                   std::uint32_t& tested, Takes&& takes) noexcept {
  tested += block.size;
  for (std::uint32_t first = 0; first < block.size; first += kFanOut) {
    const unsigned filled = (1u << std::min(block.size - first, kFanOut)) - 1u;
    for (unsigned mask = block.box[first / kFanOut].meets(way.box) & filled; mask != 0; mask &= mask - 1) {
      const auto& [a, b, c] = block.corner[first + static_cast<std::uint32_t>(__builtin_ctz(mask))];
      pierce_triangle(mesh, a, b, c, way, hit, takes);
    }
  }
}

}  // namespace palpate::stars
