// The reconstruction methods, one function each, and make_mesh(), which runs one in this process without
// limits or cache. The usual entry is reconstruct.h.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/result.h>
#include <palpate/triangle_mesh.h>
#include "baselines/reconstruct/methods.h"
#include "toolkit/render/prepare_phases.h"

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

/// Which of `poles` poles are inside. Labels spread along links from `outside`, most confident first,
/// attenuated by each pole's own confidence; unreached poles are outside. O(links log links), deterministic.
[[nodiscard]] std::vector<bool> label_poles(std::size_t poles, std::span<const PoleLink> links,
                                            std::span<const std::uint32_t> outside);

}  // namespace palpate::baselines
