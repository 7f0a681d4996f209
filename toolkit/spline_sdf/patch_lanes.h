// Quadric patches evaluated at eight places at a time. Elementwise single precision: every target rounds
// alike.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/simd.h"
#include "toolkit/spline_sdf/brick_grid.h"
#include "toolkit/spline_sdf/fit_patches.h"

namespace palpate::spline_sdf {

inline constexpr std::size_t kNodesAtOnce = 8;
using NodeLanes = Float8;
using NodeBits = Int32x8;
static_assert(sizeof(NodeLanes) == kNodesAtOnce * sizeof(float));

/// Alignment of what holds lanes: without AVX a compiler aligns them to less than AVX code reads.
inline constexpr std::size_t kLanesAlignment = sizeof(NodeLanes);

/// Eight places. Passed by reference: the calling convention of wide vectors differs between targets.
struct alignas(kLanesAlignment) NodePlaces {
  NodeLanes x{}, y{}, z{};
};

/// A quadric relative to `middle`, in units of `unit_mm`.
struct QuadricLanes {
  QuadricLanes() = default;
  QuadricLanes(const Quadric& q, const Vec3& middle, double unit_mm) {
    const Vec3 at = (q.at - middle) / unit_mm;
    const auto f = [](double x) { return static_cast<float>(x); };
    ax = f(at.x()), ay = f(at.y()), az = f(at.z());
    ux = f(q.u.x()), uy = f(q.u.y()), uz = f(q.u.z());
    vx = f(q.v.x()), vy = f(q.v.y()), vz = f(q.v.z());
    nx = f(q.n.x()), ny = f(q.n.y()), nz = f(q.n.z());
    uu = f(q.uu * unit_mm), uv = f(q.uv * unit_mm), vv = f(q.vv * unit_mm);
  }
  float ax, ay, az, ux, uy, uz, vx, vy, vz, nx, ny, nz, uu, uv, vv;
};

/// The nearest places on a quadric: tangential coordinates (a, b) and height h of the places, (u, v) of their
/// closest points, the height's gradient there, 1 / sqrt(1 + its square), and the signed distance.
struct alignas(kLanesAlignment) QuadricClosest {
  NodeLanes a, b, h, u, v, gu, gv, per_slope, distance;
};

/// Replaces x by 1 / sqrt(x).
[[gnu::always_inline]] inline void one_over_root(NodeLanes& x) noexcept {
  // First guess from the exponent bits (4 %); Newton steps square its error.
  const auto bits = reinterpret_cast<NodeBits>(x);
  auto y = reinterpret_cast<NodeLanes>(0x5f3759df - (bits >> 1));
  for (int step = 0; step < 3; ++step) y *= 1.5f - 0.5f * x * y * y;
  x = y;
}

/// True if any lane is set.
[[gnu::always_inline]] inline bool any_lane(const NodeBits& lanes) noexcept {
  const auto words = reinterpret_cast<Int64x4>(lanes);
  return (words[0] | words[1] | words[2] | words[3]) != 0;
}

/// Newton's method from the tangential coordinates, `steps` times. Beyond the centre of curvature, where the
/// determinant falls below `least`, the closest point is arbitrary and the distance may be NaN.
[[gnu::always_inline]] inline void find_closest(const QuadricLanes& q, const NodePlaces& at, int steps,
                                                float least, QuadricClosest& out) noexcept {
  const NodeLanes x = at.x - q.ax, y = at.y - q.ay, z = at.z - q.az;
  const NodeLanes a = x * q.ux + y * q.uy + z * q.uz, b = x * q.vx + y * q.vy + z * q.vz,
                  h = x * q.nx + y * q.ny + z * q.nz;
  NodeLanes u = a, v = b;
  for (int step = 0; step < steps; ++step) {
    const NodeLanes off = h - (q.uu * u * u + q.uv * u * v + q.vv * v * v);
    const NodeLanes gu = 2.0f * q.uu * u + q.uv * v, gv = 2.0f * q.vv * v + q.uv * u;
    const NodeLanes ru = a - u + off * gu, rv = b - v + off * gv;
    const NodeLanes uu = 1.0f + gu * gu - 2.0f * off * q.uu, uv = gu * gv - off * q.uv,
                    vv = 1.0f + gv * gv - 2.0f * off * q.vv;
    const NodeLanes determinant = uu * vv - uv * uv, floor = determinant - determinant + least;
    const NodeLanes per = 1.0f / (determinant > floor ? determinant : floor);
    u += (vv * ru - uv * rv) * per;
    v += (uu * rv - uv * ru) * per;
  }
  const NodeLanes off = h - (q.uu * u * u + q.uv * u * v + q.vv * v * v);
  const NodeLanes gu = 2.0f * q.uu * u + q.uv * v, gv = 2.0f * q.vv * v + q.uv * u;
  NodeLanes per_slope = 1.0f + gu * gu + gv * gv;
  one_over_root(per_slope);
  out.a = a, out.b = b, out.h = h, out.u = u, out.v = v, out.gu = gu, out.gv = gv;
  out.per_slope = per_slope;
  out.distance = (off - gu * (a - u) - gv * (b - v)) * per_slope;
}

/// A tile holds a brick lattice's nodes from 4 (x, y, z) - 1 on: (x, y, z) at (x * 4 + y) * 4 + z.
inline constexpr int kTileNodes = kBrickCells;
inline constexpr std::size_t kTileCount = 64;
/// From a tile's middle to its outermost nodes, voxels.
inline constexpr double kTileReach = 1.5 * 1.7320509;
using Tile = std::array<float, kTileCount>;
/// Nodes 8 i to 8 i + 7 of a tile, from its middle, voxels.
[[gnu::always_inline]] inline NodePlaces tile_places(std::size_t i) noexcept {
  constexpr NodeLanes kY{-1.5f, -1.5f, -1.5f, -1.5f, -0.5f, -0.5f, -0.5f, -0.5f};
  constexpr NodeLanes kZ{-1.5f, -0.5f, 0.5f, 1.5f, -1.5f, -0.5f, 0.5f, 1.5f};
  return {NodeLanes{} + (static_cast<float>(i / 2) - 1.5f), kY + static_cast<float>(2 * (i % 2)), kZ};
}

// Distances at a tile's nodes where patches agree: their mean, weighted by the distance of the node's closest
// point from each centre. At edges and between sheets PatchDistanceField decides.

/// The patches that may reach each tile; `codes`: of the tiles, in order. Immutable. O(patches x tiles near).
class TilePatches {
 public:
  TilePatches() = default;
  TilePatches(std::span<const QuadricPatch> patches, const BrickGrid& grid,
              const search::MortonCellTable& tiles, std::span<const std::uint64_t> codes, double voxel_mm,
              int threads);
  [[nodiscard]] std::span<const std::uint32_t> of(std::size_t tile) const noexcept {
    return {patch_.data() + begin_[tile], begin_[tile + 1] - begin_[tile]};
  }

 private:
  std::vector<std::uint32_t> begin_, patch_;
};

/// Distances in voxels at the nodes of the tile about `middle`, mm. False without patches, or if their
/// standard deviation at a node exceeds the tolerance. O(patches).
[[nodiscard]] bool blend_tile(std::span<const QuadricPatch> patches, std::span<const std::uint32_t> here,
                              const Vec3& middle, double voxel_mm, double tolerance_mm, Tile& out);

}  // namespace palpate::spline_sdf
