#include "baselines/reconstruct/methods.h"

#include <fmt/format.h>

#include <algorithm>

#include "baselines/failure.h"
#include "baselines/option_specs.h"

namespace palpate::baselines {
namespace {

std::vector<OptionSpec> with_normals(std::vector<OptionSpec> own) {
  own.push_back(
      option::choice("normals", "planes",
                     "normals for methods that need them: planes of 8 neighbours, turned as cloud turns its "
                     "own; or CGAL's principal components or jets, turned along a spanning tree",
                     {"planes", "pca", "jet"}));
  own.push_back(option::integer("normal_neighbours", "18", "neighbours of a point for normals=pca and jet", 4,
                                200, {{"normals", {"pca", "jet"}}}));
  return own;
}

std::vector<Method> make_methods() {
  std::vector<Method> all;
  all.push_back(
      {"advancing-front",
       "triangles added one by one from the Delaunay triangulation",
       "Cohen-Steiner and Da 2004, CGAL",
       {option::number("front_radius_ratio", "5", "advancing front: bound on the ratio of radii", 1, 1e6),
        option::number("front_beta", "0.52", "advancing front: half angle of the candidate wedge, rad", 0.01,
                       1.57)}});
  all.push_back(
      {"poisson", "level set of a function whose gradient follows the normals",
       "Kazhdan, Bolitho and Hoppe 2006, Kazhdan and Hoppe 2013; PCL, or CGAL",
       with_normals(
           {option::choice("poisson_on", "octree",
                           "Poisson: solved on an octree (PCL), or on a Delaunay refinement and meshed by "
                           "another (CGAL)",
                           {"octree", "delaunay"}),
            option::number("poisson_cell", "1",
                           "Poisson on an octree: largest edge of its finest cells, spacings", 0.1, 1000,
                           {{"poisson_on", {"octree"}}}),
            option::number("poisson_angle", "20", "Poisson by Delaunay: smallest angle of a facet, degrees",
                           1, 30, {{"poisson_on", {"delaunay"}}}),
            option::number("poisson_radius", "3", "Poisson by Delaunay: largest radius of a facet, spacings",
                           0.1, 1000, {{"poisson_on", {"delaunay"}}}),
            option::number("poisson_distance", "0.2",
                           "Poisson by Delaunay: distance between facet and surface, spacings", 1e-3, 100,
                           {{"poisson_on", {"delaunay"}}}),
            option::number(
                "poisson_trim", "1.5",
                "Poisson: facets farther than so many spacings from every point are left out; 0: none", 0,
                1e6)})});
  all.push_back(
      {"scale-space",
       "points smoothed, connected where smooth, the triangles taken back to the points",
       "Digne et al. 2011, CGAL",
       {option::integer("scale_iterations", "4", "scale space: rounds of smoothing", 0, 100),
        option::choice("scale_smoother", "jet", "scale space: how a round smooths", {"jet", "pca"},
                       {{"scale_iterations", {"0"}, true}}),
        option::integer("scale_neighbours", "12", "scale space: neighbours of a point when smoothing", 6, 200,
                        {{"scale_iterations", {"0"}, true}}),
        option::choice("scale_mesher", "front", "scale space: what connects the smoothed points",
                       {"front", "alpha"})},
       2});
  all.push_back(
      {"alpha-shape",
       "facets of the Delaunay triangulation with an empty ball of the given radius",
       "Edelsbrunner and Mücke 1994, CGAL",
       {option::number("alpha_radius", "2.5",
                       "alpha shape: radius of the ball, spacings; 0: the smallest that leaves one solid", 0,
                       1e6)}});
  all.push_back({"power-crust",
                 "faces between the inner and outer balls of the medial axis, closed by construction",
                 "Amenta, Choi and Kolluri 2001 (the thesis's [31]), on CGAL's triangulations",
                 {},
                 2});
  all.push_back(
      {"ball-pivoting", "a ball rolled from edge to edge", "Bernardini et al. 1999, Open3D",
       with_normals(
           {option::number("ball_radius", "1.25", "ball pivoting: smallest ball, spacings", 0.1, 100),
            option::integer("ball_sizes", "3", "ball pivoting: how many balls, each twice the one before", 1,
                            6)})});
#ifndef PALPATE_WITH_OPEN3D
  all.back().not_built = "install the package libopen3d-dev and configure with -DPALPATE_WITH_OPEN3D=ON";
#endif
  all.push_back(
      {"greedy-projection", "neighbours projected on the tangent plane and connected greedily",
       "Gopi and Krishnan 2002, Marton et al. 2009, PCL",
       with_normals(
           {option::number("greedy_mu", "2.5",
                           "greedy projection: reach, in distances to the nearest neighbour", 1, 100),
            option::number("greedy_radius", "4", "greedy projection: largest edge, spacings", 0.5, 1000)})});
  all.push_back(
      {"marching-cubes", "zero set of the distance to the nearest point's tangent plane, by cubes",
       "Hoppe et al. 1992, Lorensen and Cline 1987, PCL",
       with_normals(
           {option::number("cubes_cell", "1", "marching cubes: edge of a cube, spacings", 0.05, 1000),
            option::number("cubes_reach", "3",
                           "marching cubes: no surface farther from every point, spacings", 1, 1000)})});
  all.push_back(
      {"organised",
       "neighbours in the scanner's raster connected",
       "Holz and Behnke 2012, PCL",
       {option::number("organised_longest", "0",
                       "organised: longer edges are left out, spacings; 0: all are kept", 0, 1e6)}});
  all.back().raster_only = true;
  all.back().version = 2;  // organised_longest skips edges
  all.push_back({"stars",
                 "triangles that the points agree on: the surface that cloud feels",
                 "ours, see docs/explanation/the-surface.md",
                 {}});
  all.back().version = 2;  // uses a raster if present
  return all;
}

}  // namespace

const std::vector<Method>& methods() {
  static const std::vector<Method> all = make_methods();
  return all;
}

Result<const Method*> find_method(std::string_view name) {
  std::string names;
  for (const Method& method : methods()) {
    if (method.name == name) {
      if (method.not_built.empty()) return &method;
      return failure(fmt::format("this build does not have the reconstruction '{}'", name), method.not_built);
    }
    names += (names.empty() ? "" : ", ") + method.name;
  }
  return failure(fmt::format("there is no reconstruction '{}'", name), "take one of " + names);
}

std::vector<OptionSpec> all_method_options(const std::string& method_key) {
  std::vector<OptionSpec> all;
  for (const Method& method : methods())
    for (const OptionSpec& spec : method.options) {
      auto at = std::find_if(all.begin(), all.end(), [&](const OptionSpec& s) { return s.key == spec.key; });
      if (at == all.end()) {
        at = all.insert(all.end(), spec);
        at->only_with.insert(at->only_with.begin(), {method_key});
      }
      at->only_with.front().values.push_back(method.name);
    }
  return all;
}

Options own_options(const Method& method, const Options& options) {
  Options own;
  for (const OptionSpec& spec : method.options)
    if (options.has(spec.key)) own.set(spec.key, options.text(spec.key));
  return own;
}

}  // namespace palpate::baselines
