// One function a method; make_mesh() is the border that catches what the libraries throw. Each gets points
// that span at least a plane and may return a mesh without triangles, which make_mesh() turns into an Error.
#pragma once

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/prepare_phases.h"

namespace palpate::baselines {

/// Lengths are in a unit of the cloud's own, not mm: see OwnFrame in make_mesh.cpp.
struct MethodInput {
  const cloud::Cloud& cloud;  ///< its origin is zero
  const Options& options;
  int threads;
  double spacing;  ///< root of the occupied area per point, from 1 to 2
};

using MethodFunction = Result<geometry::TriangleMesh>(const MethodInput& input,
                                                      render::PreparePhases& phases);

MethodFunction advancing_front;  ///< vertex i is point i; repeated points stay as unused vertices
MethodFunction poisson;
MethodFunction scale_space;  ///< vertex i is point i
MethodFunction alpha_shape;  ///< vertex i is point i; repeated points stay as unused vertices
MethodFunction power_crust;
MethodFunction ball_pivoting;
MethodFunction greedy_projection;  ///< vertex i is point i
MethodFunction marching_cubes;
MethodFunction organised;        ///< vertex i is point i
MethodFunction stars_of_points;  ///< vertex i is point i; doubled points stay as unused vertices

/// CGAL's own random numbers start from the clock; with this they are the same on every run.
void seed_cgal();

/// Every point of the cloud as a vertex.
[[nodiscard]] geometry::TriangleMesh points_as_vertices(const cloud::Cloud& cloud);

}  // namespace palpate::baselines
