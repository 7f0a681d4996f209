// The smooth surface as frames read it: bricks of 4 x 4 x 4 cells, each with the 7 x 7 x 7 coefficients of
// its own uniform cubic B-spline of distance. A brick belongs to one sheet: two sheets that pass through one
// cube have two bricks there, and never one number in common.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toolkit/core/large_pages.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/enclosure.h"
#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

inline constexpr int kBrickCells = 4;
inline constexpr int kBrickNodes = kBrickCells + 3;
inline constexpr int kBrickCoefficients = kBrickNodes * kBrickNodes * kBrickNodes;
/// Largest distance that a coefficient holds, in voxels: a brick's nodes are at most 5.2 from its middle.
inline constexpr double kBrickReach = 8.0;
inline constexpr float kBrickUnit = static_cast<float>(kBrickReach / 32767.0);

/// Coefficient (x, y, z) at (x * 7 + y) * 7 + z; node 0 is one voxel before the brick's corner. The mask has
/// a bit for each cell, (x * 4 + y) * 4 + z, through which the surface goes and points are near.
struct Brick {
  std::array<std::int16_t, kBrickCoefficients> distance;
  std::uint16_t piece = 0;  ///< of BrickGrid::closed_pieces, from 1; 0: an open sheet, felt from both sides
  std::uint64_t mask = 0;
};

/// What a spline tells at a place, in voxels.
struct Jet {
  float value = 0.0f;
  Eigen::Vector3f gradient = Eigen::Vector3f::Zero();
  /// xx, yy, zz, xy, xz, yz
  std::array<float, 6> second{};
};

/// Four floats at a time, elementwise; every target rounds them alike.
using Lanes = float __attribute__((vector_size(16)));
using ShortLanes = std::int16_t __attribute__((vector_size(16)));
using IntLanes = std::int32_t __attribute__((vector_size(16)));

/// The four weights of a cubic B-spline at t in [0, 1], and those of its derivatives.
struct SplineWeights {
  Lanes value, first, second;
  explicit SplineWeights(float t) noexcept {
    const float s = 1.0f - t;
    constexpr float kSixth = 1.0f / 6.0f, kTwoThirds = 2.0f / 3.0f;
    value = Lanes{s * s * s * kSixth, kTwoThirds - t * t * (1.0f - 0.5f * t),
                  kTwoThirds - s * s * (1.0f - 0.5f * s), t * t * t * kSixth};
    first = Lanes{-0.5f * s * s, t * (1.5f * t - 2.0f), s * (2.0f - 1.5f * s), 0.5f * t * t};
    second = Lanes{s, 3.0f * t - 2.0f, 1.0f - 3.0f * t, t};
  }
};

/// Four coefficients as floats. Each is put twice into one integer, and the lower copy shifted out: a
/// conversion of four shorts is taken apart by the compiler.
[[nodiscard]] inline Lanes brick_row(const Brick& brick, int at) noexcept {
  ShortLanes raw{};
  __builtin_memcpy(&raw, &brick.distance[static_cast<std::size_t>(at)], 4 * sizeof(std::int16_t));
  const ShortLanes twice = __builtin_shufflevector(raw, raw, 0, 0, 1, 1, 2, 2, 3, 3);
  IntLanes wide;
  __builtin_memcpy(&wide, &twice, sizeof wide);
  return __builtin_convertvector(wide >> 16, Lanes);
}
[[nodiscard]] inline float sum_of(Lanes a) noexcept {
  return (a[0] + a[2]) + (a[1] + a[3]);
}

/// Each lane over four.
[[nodiscard]] inline std::array<Lanes, 4> spread(const Lanes& a) noexcept {
  return {Lanes{a[0], a[0], a[0], a[0]}, Lanes{a[1], a[1], a[1], a[1]}, Lanes{a[2], a[2], a[2], a[2]},
          Lanes{a[3], a[3], a[3], a[3]}};
}
/// From a row to the one a node on along x.
inline constexpr int kRowStep = kBrickNodes * kBrickNodes;

/// A place in a brick: cell and share of it.
struct BrickPlace {
  std::array<int, 3> cell{};
  std::array<float, 3> t{};
};

/// Value, gradient and second derivatives at a place. 16 rows of four.
[[nodiscard]] inline Jet spline_jet(const Brick& brick, const BrickPlace& at) noexcept {
  const SplineWeights x(at.t[0]), y(at.t[1]), z(at.t[2]);
  const int base = (at.cell[0] * kBrickNodes + at.cell[1]) * kBrickNodes + at.cell[2];
  const std::array<Lanes, 4> wx = spread(x.value), dx = spread(x.first), ddx = spread(x.second);
  Lanes f{}, fx{}, fy{}, fxx{}, fyy{}, fxy{};
#pragma GCC unroll 4
  for (std::size_t j = 0; j < 4; ++j) {
    const int at_j = base + static_cast<int>(j) * kBrickNodes;
    const Lanes r0 = brick_row(brick, at_j), r1 = brick_row(brick, at_j + kRowStep),
                r2 = brick_row(brick, at_j + 2 * kRowStep), r3 = brick_row(brick, at_j + 3 * kRowStep);
    const Lanes a = (wx[0] * r0 + wx[1] * r1) + (wx[2] * r2 + wx[3] * r3);
    const Lanes ax = (dx[0] * r0 + dx[1] * r1) + (dx[2] * r2 + dx[3] * r3);
    const Lanes axx = (ddx[0] * r0 + ddx[1] * r1) + (ddx[2] * r2 + ddx[3] * r3);
    f += y.value[j] * a;
    fx += y.value[j] * ax;
    fxx += y.value[j] * axx;
    fy += y.first[j] * a;
    fxy += y.first[j] * ax;
    fyy += y.second[j] * a;
  }
  Jet jet;
  jet.value = kBrickUnit * sum_of(f * z.value);
  jet.gradient =
      kBrickUnit * Eigen::Vector3f(sum_of(fx * z.value), sum_of(fy * z.value), sum_of(f * z.first));
  jet.second = {kBrickUnit * sum_of(fxx * z.value), kBrickUnit * sum_of(fyy * z.value),
                kBrickUnit * sum_of(f * z.second),  kBrickUnit * sum_of(fxy * z.value),
                kBrickUnit * sum_of(fx * z.first),  kBrickUnit * sum_of(fy * z.first)};
  return jet;
}

/// The value alone.
[[nodiscard]] inline float spline_value(const Brick& brick, const BrickPlace& at) noexcept {
  const SplineWeights x(at.t[0]), y(at.t[1]), z(at.t[2]);
  const int base = (at.cell[0] * kBrickNodes + at.cell[1]) * kBrickNodes + at.cell[2];
  Lanes f{};
  for (int i = 0; i < 4; ++i) {
    Lanes a{};
    for (int j = 0; j < 4; ++j)
      a += y.value[j] * brick_row(brick, base + (i * kBrickNodes + j) * kBrickNodes);
    f += x.value[i] * a;
  }
  return kBrickUnit * sum_of(f * z.value);
}

/// Places of a closed piece that decide, by majority, which of its sides is free.
inline constexpr std::size_t kPieceSamples = 5;

/// A piece that is felt from one side: which, is found out where a replay begins.
struct ClosedPiece {
  ClosedPiece() { samples.fill(Eigen::Vector3f::Zero()); }
  /// Of one without holes places on it, in voxels: towards them it is seen which side of it is free.
  std::array<Eigen::Vector3f, kPieceSamples> samples;
  /// Of one with holes the sign of the distance outside, and its surface brick by brick; else 0 and none.
  float outer_side = 0.0f;
  std::vector<geometry::SurfacePart> parts;
};

/// All bricks of a model. Immutable and shared; local mm.
struct BrickGrid {
  Vec3 low_mm = Vec3::Zero();  ///< corner of brick (0, 0, 0)
  double voxel_mm = 1.0;
  double per_voxel = 1.0;            ///< 1 / voxel_mm
  std::int64_t last_brick = 0;       ///< largest brick coordinate of any axis
  CellTable table;                   ///< from a brick coordinate's Morton code to its cell
  std::vector<std::uint32_t> first;  ///< brick of each cell, and one more
  LargeVector<Brick> bricks;
  geometry::Aabb box_mm;  ///< of the points
  std::vector<ClosedPiece> closed_pieces;
  double least_enclosed = 1.0;  ///< 1 less the widest geometry::mouth_share() of those with holes

  using Coordinate = std::array<std::int32_t, 3>;
  [[nodiscard]] std::size_t bytes() const noexcept {
    std::size_t parts = 0;
    for (const ClosedPiece& piece : closed_pieces) parts += piece.parts.capacity();
    return table.bytes() + first.capacity() * sizeof(std::uint32_t) + bricks.capacity() * sizeof(Brick) +
           closed_pieces.capacity() * sizeof(ClosedPiece) + parts * sizeof(geometry::SurfacePart);
  }
  /// Of every brick. O(bricks).
  [[nodiscard]] std::vector<Coordinate> cubes_of_bricks() const;
  /// In voxels from low_mm.
  [[nodiscard]] Vec3 in_voxels(const Vec3& local_mm) const noexcept {
    return (local_mm - low_mm) * per_voxel;
  }
  /// The cell of a brick coordinate, or kNone.
  [[nodiscard]] std::uint32_t cell_at(const Coordinate& c) const noexcept {
    for (const std::int32_t a : c)
      if (a < 0 || a > last_brick) return CellTable::kNone;
    return table.find(partition::morton_code(static_cast<std::uint32_t>(c[0]),
                                             static_cast<std::uint32_t>(c[1]),
                                             static_cast<std::uint32_t>(c[2])));
  }
};

}  // namespace palpate::render
