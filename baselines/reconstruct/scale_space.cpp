// Scale space by CGAL: smoothed points are easy to connect; the triangles then use the original points.
#define CGAL_EIGEN3_ENABLED 1  // for the eigenvectors
#include "baselines/reconstruct/cgal_points.h"
#include "baselines/reconstruct/method_functions.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Scale_space_reconstruction_3/Advancing_front_mesher.h>
#include <CGAL/Scale_space_reconstruction_3/Alpha_shape_mesher.h>
#include <CGAL/Scale_space_reconstruction_3/Jet_smoother.h>
#include <CGAL/Scale_space_reconstruction_3/Weighted_PCA_smoother.h>
#include <CGAL/Scale_space_surface_reconstruction_3.h>

namespace palpate::baselines {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using ScaleSpace = CGAL::Scale_space_surface_reconstruction_3<Kernel>;
namespace steps = CGAL::Scale_space_reconstruction_3;
template <class Tag>
using PcaSmoother = steps::Weighted_PCA_smoother<Kernel, CGAL::Default_diagonalize_traits<double, 3>, Tag>;
template <class Tag>
using JetSmoother = steps::Jet_smoother<Kernel, Tag>;
/// Ball radius in spacings for the alpha shape after jets, which have none: the default of alpha-shape.
constexpr double kAlphaRadius = 2.5;

}  // namespace

Result<geometry::TriangleMesh> scale_space(const MethodInput& input, render::PreparePhases& phases) {
  std::vector<Kernel::Point_3> points;
  points.reserve(input.cloud.size());
  for (std::size_t i = 0; i < input.cloud.size(); ++i) {
    const Vec3 p = input.cloud.local_mm(i) / input.spacing;
    points.emplace_back(p.x(), p.y(), p.z());
  }
  ScaleSpace reconstruction(points.begin(), points.end());
  const auto rounds = static_cast<std::size_t>(input.options.integer("scale_iterations"));
  const auto neighbours = static_cast<unsigned>(input.options.integer("scale_neighbours"));
  double alpha = kAlphaRadius * kAlphaRadius;
  phases.begin("smoothing");
  with_cgal_threads(input.threads, [&](auto tag) {
    using Tag = decltype(tag);
    if (input.options.text("scale_smoother") == "jet") {
      reconstruction.increase_scale(rounds, JetSmoother<Tag>(neighbours));
    } else {
      PcaSmoother<Tag> smoother(neighbours);
      reconstruction.increase_scale(rounds, smoother);
      if (rounds > 0) alpha = smoother.squared_radius();
    }
  });
  phases.end();
  if (input.options.text("scale_mesher") == "front") {
    phases.begin("advancing front");
    reconstruction.reconstruct_surface(steps::Advancing_front_mesher<Kernel>());
  } else {
    phases.begin("alpha shape");
    reconstruction.reconstruct_surface(steps::Alpha_shape_mesher<Kernel>(alpha));
  }
  geometry::TriangleMesh mesh = points_as_vertices(input.cloud);
  for (auto facet = reconstruction.facets_begin(); facet != reconstruction.facets_end(); ++facet)
    mesh.triangles.push_back({static_cast<std::uint32_t>((*facet)[0]),
                              static_cast<std::uint32_t>((*facet)[1]),
                              static_cast<std::uint32_t>((*facet)[2])});
  phases.end();
  // CGAL's order and orientation depend on memory addresses, which vary with other threads.
  phases.begin("one order");
  fix_order(mesh, input.threads);
  phases.end();
  return mesh;
}

}  // namespace palpate::baselines
