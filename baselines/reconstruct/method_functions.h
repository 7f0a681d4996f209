// The reconstruction methods, one function each. make_mesh() runs one in this process without limits or
// cache. The usual entry is reconstruct.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include "baselines/reconstruct/reconstruct.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {

/// Lengths are in the cloud's own unit, not mm: see OwnFrame in make_mesh.cpp.
struct MethodInput {
  const cloud::Cloud& cloud;  ///< at origin zero
  const Options& options;
  int threads;
  double spacing;  ///< sqrt(occupied area per point), from 1 to 2
};

using MethodFunction = Result<geometry::TriangleMesh>(const MethodInput& input,
                                                      render::PreparePhases& phases);

MethodFunction advancing_front;  ///< vertex i is point i; repeated points remain as unused vertices
MethodFunction poisson;          ///< on a Delaunay refinement
MethodFunction poisson_octree;
MethodFunction scale_space;  ///< vertex i is point i
MethodFunction alpha_shape;  ///< vertex i is point i; repeated points remain as unused vertices
MethodFunction power_crust;
MethodFunction ball_pivoting;
MethodFunction greedy_projection;  ///< vertex i is point i
MethodFunction marching_cubes;
MethodFunction organised;        ///< vertex i is point i
MethodFunction stars_of_points;  ///< vertex i is point i; repeated points remain as unused vertices

/// Seeds CGAL's random numbers, which otherwise start from the clock.
void seed_cgal();

[[nodiscard]] geometry::TriangleMesh points_as_vertices(const cloud::Cloud& cloud);

/// The mesh of `cloud` by `method`: double, model frame, never empty, indices in range, outward if closed.
/// `options` is complete (validate() over the method's specs). Each step is a phase. The same for any number
/// of threads and in every process that makes one mesh; for a second one CGAL may break ties of regular grids
/// differently. Cannot be cancelled.
///
/// Errors: fewer than three different points, or collinear ones; a missing raster; failure of the library,
/// exceptions included; out of memory.
[[nodiscard]] Result<geometry::TriangleMesh> make_mesh(const Method& method, const cloud::Cloud& cloud,
                                                       const Options& options, int threads,
                                                       render::PreparePhases& phases);

/// Evidence between two poles, with confidence in (0, 1].
struct PoleLink {
  std::uint32_t a = 0, b = 0;
  float confidence = 0.0F;
  bool opposite =
      false;  ///< of one sample, on either side of the surface; otherwise balls that overlap deeply
};

/// Labels of the poles: true inside. Labels spread along links from `outside`, most confident first,
/// attenuated by each pole's own confidence; unreached poles are outside. O(links log links), deterministic.
[[nodiscard]] std::vector<bool> label_poles(std::size_t poles, std::span<const PoleLink> links,
                                            std::span<const std::uint32_t> outside);

// Oriented normals for Poisson, ball pivoting and PCL's methods.

/// Timed phases of making normals.
inline constexpr const char* kNeighboursPhase = "neighbours for normals";
inline constexpr const char* kNormalsPhase = "normals";
inline constexpr const char* kOrientationPhase = "orientation of normals";
[[nodiscard]] inline bool is_of_normals(const render::PreparePhase& phase) {
  return phase.name == kNeighboursPhase || phase.name == kNormalsPhase || phase.name == kOrientationPhase;
}

/// A unit vector per point, or zero if none was found; outward if the points enclose a volume. Options
/// `normals` and `normal_neighbours`; two or three phases.
[[nodiscard]] std::vector<Vec3> oriented_normals(const MethodInput& input, render::PreparePhases& phases);

/// By CGAL: principal components or (jets) a fitted quadric over k neighbours, oriented along a minimum
/// spanning tree.
[[nodiscard]] std::vector<Vec3> cgal_normals(const MethodInput& input, bool jets, unsigned k,
                                             render::PreparePhases& phases);

/// The points with a normal, each place once, relative to the cloud's origin and divided by `unit_mm`: near
/// 1, to suit the libraries' tolerances.
struct OrientedPoints {
  std::vector<Vec3> place, normal;
  std::vector<std::uint32_t> index;  ///< in the cloud
  double unit_mm = 1.0;
};
[[nodiscard]] OrientedPoints oriented_points(const MethodInput& input, double unit_mm,
                                             render::PreparePhases& phases);

// Work that a reconstruction library leaves on its triangles: one order and orientation whatever its own, and
// vertices merged that only rounding separates.

/// Rotates triangles to start at their lowest vertex, sorts them, and flips edge-connected pieces so that the
/// first triangle's second vertex is below its third. Keeps orientedness. For libraries whose result depends
/// on memory addresses. Indices must be in range. O(n) for bounded degree, at worst O(n log n); the same for
/// any `threads` (0: all).
void fix_order(geometry::TriangleMesh& mesh, int threads = 0);

struct WeldCounts {
  std::size_t vertices = 0;   ///< merged with an earlier one
  std::size_t triangles = 0;  ///< removed: collapsed, or paired back to back
};

/// Merges vertices connected by edges up to `distance` into the first. Removes collapsed triangles and pairs
/// with equal corners and opposite orientation. Keeps the order of vertices and triangles. O(n log n).
/// Deterministic.
WeldCounts weld_vertices(geometry::TriangleMesh& mesh, double distance);

}  // namespace palpate::baselines
