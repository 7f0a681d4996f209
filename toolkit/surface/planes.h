// Points with their local planes: the normal of each from its neighbours, then a side that the whole surface
// agrees on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/core/vec.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/surface/normals.h"

namespace palpate::surface {

/// Sixteen bytes, so that a point and its plane come with one cache line. Relative to some local origin.
struct SurfacePoint {
  float x_mm, y_mm, z_mm;
  NormalCode normal;

  [[nodiscard]] Vec3 at() const noexcept {
    return {static_cast<double>(x_mm), static_cast<double>(y_mm), static_cast<double>(z_mm)};
  }
};

/// The points of a cloud in its order, relative to its origin, without planes yet.
[[nodiscard]] std::vector<SurfacePoint> surface_points(const cloud::Cloud& cloud);

/// Unit normals as vectors; zero where a point has none.
[[nodiscard]] std::vector<Vec3> normals_of(std::span<const SurfacePoint> points);

/// Sets every normal to that of the least-squares plane through the point and its neighbours, its sign
/// arbitrary. `neighbours` is parallel to `points` and indexes it. Parallel; the same for any number of
/// threads. O(n).
void fit_planes(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                int threads);

/// The same for one point that moved a little, its normal turned to the side it had, kept one-sided where it
/// was. Where it has no plane any more (the tip of a deep dent) the mean normal of the facets around it, and
/// where these do not surround it the normal that it had. Allocates nothing.
void refit_plane(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                 std::uint32_t place) noexcept;

struct OrientReport {
  std::size_t pieces = 0;            ///< connected by neighbour links
  std::size_t one_sided_points = 0;  ///< in pieces that enclose a volume
  std::size_t closed_pieces = 0;     ///< those pieces
  /// By point, the closed piece that it lies on, 0 for points on none; empty where there is no second one.
  LargeVector<std::uint32_t> closed_piece_of;
};

/// Turns the normals so that linked points agree, over each connected piece: links in order of confidence,
/// the most confident first (the minimum spanning tree of Hoppe et al. 1992 in five classes), each judged by
/// reflecting one normal at the link's bisector (Koenig and Gumhold 2009), which holds across edges and thin
/// rims too. A piece that encloses a volume gets its normals outward and kOneSided; on any other the side is
/// whatever the first point's is. Parallel; the same for any number of threads. O(n) in practice.
OrientReport orient_planes(std::span<SurfacePoint> points,
                           std::span<const neighbourhood::Neighbours> neighbours, int threads);

/// Of each closed piece the side on which a place (local, mm) lies: 1 outside, -1 inside. It is inside where
/// the solid angle under which it sees the piece's outer side, an area of spacing squared standing for each
/// point (Barill et al. 2018), is more than half of all around. `closed_piece_of` as in OrientReport, `sides`
/// as many as there are closed pieces. O(n), no allocation. Near a surface, within a spacing or two, the
/// answer may be either.
void find_sides(std::span<const SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                std::span<const std::uint32_t> closed_piece_of, const Vec3& local_mm,
                std::span<double> sides) noexcept;

}  // namespace palpate::surface
