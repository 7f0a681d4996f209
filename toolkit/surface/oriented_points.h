// Points with local planes: normals from neighbours, packed into 32 bits, then a consistent orientation over
// the surface.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/vec.h>
#include "toolkit/core/hardware.h"
#include "toolkit/search/neighbour_table.h"

namespace palpate::surface {

/// 31 bits of direction by the octahedral map (Meyer et al. 2010; 16 and 15 bits a coordinate, error at most
/// 1e-4 rad) and one bit for "closed surface, outward normal".
using NormalCode = std::uint32_t;
/// The code for "no plane": fewer than two neighbours, or all on a line.
inline constexpr NormalCode kNoNormal = 0xFFFFFFFFu;
/// Set if the surface encloses a volume and the normal points outward: it is touched from one side.
inline constexpr NormalCode kOneSided = 0x80000000u;

/// Steps over [-1, 1]: even, so that 0 is exact. x has one step less than its bits allow, so kNoNormal cannot
/// occur.
inline constexpr double kNormalStepsX = 65534.0, kNormalStepsY = 32766.0;

[[nodiscard]] NormalCode encode_normal(const Vec3& unit) noexcept;

[[nodiscard]] inline bool is_one_sided(NormalCode code) noexcept {
  return (code & kOneSided) != 0 && code != kNoNormal;
}

/// The unit vector of a code other than kNoNormal. Allocates nothing.
[[nodiscard]] inline Vec3 decode_normal(NormalCode code) noexcept {
  double x = static_cast<double>(code & 0xFFFFu) * (2.0 / kNormalStepsX) - 1.0;
  double y = static_cast<double>((code >> 16) & 0x7FFFu) * (2.0 / kNormalStepsY) - 1.0;
  const double z = 1.0 - std::abs(x) - std::abs(y);
  if (z < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const double scale = 1.0 / std::sqrt(x * x + y * y + z * z);
  return {x * scale, y * scale, z * scale};
}

/// The code of the opposite direction; keeps the side bit.
[[nodiscard]] NormalCode opposite(NormalCode code) noexcept;

/// Sixteen bytes, so point and plane share a cache line. Relative to a local origin.
struct OrientedPoint {
  float x_mm, y_mm, z_mm;
  NormalCode normal;

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
};

/// A cloud's points in order, relative to its origin, without planes.
[[nodiscard]] std::vector<OrientedPoint> surface_points(const cloud::Cloud& cloud);

/// Unit normals; zero for points without one.
[[nodiscard]] std::vector<Vec3> normals_of(std::span<const OrientedPoint> points);

/// Sets each normal to that of the least-squares plane through the point and its neighbours, with arbitrary
/// sign. `neighbours` is parallel to `points` and indexes it. Parallel; independent of the number of threads.
/// O(n).
void fit_planes(std::span<OrientedPoint> points, std::span<const search::Neighbours> neighbours, int threads);

struct OrientReport {
  std::size_t pieces = 0;             ///< connected components of the neighbour links
  std::size_t one_sided_points = 0;   ///< in pieces that enclose a volume
  std::size_t closed_components = 0;  ///< number of these pieces
  /// Per point: its closed piece, 0 for none; empty with fewer than two closed pieces.
  LargePageVector<std::uint32_t> closed_component_of;
};

/// Turns the normals so that linked points agree within each connected piece. Takes links by confidence (the
/// minimum spanning tree of Hoppe et al. 1992, in five classes) and reflects one normal at the link's
/// bisector (Koenig and Gumhold 2009), which also works across edges and thin rims. Pieces that enclose a
/// volume get outward normals and kOneSided; other pieces take the first point's side. Parallel; independent
/// of the number of threads. O(n) in practice.
OrientReport orient_planes(std::span<OrientedPoint> points, std::span<const search::Neighbours> neighbours,
                           int threads);

/// Computes for each closed piece the side of a place (local, mm): 1 outside, -1 inside. Inside means that
/// the solid angle of the piece's outer side, with area spacing^2 per point (Barill et al. 2018), exceeds
/// half the sphere. `closed_component_of` as in OrientReport; `sides` has one entry per closed piece.
/// Unreliable within one or two spacings of the surface. O(n), no allocation.
void point_sides(std::span<const OrientedPoint> points, std::span<const search::Neighbours> neighbours,
                 std::span<const std::uint32_t> closed_component_of, const Vec3& local_mm,
                 std::span<double> sides) noexcept;

}  // namespace palpate::surface
