#include <fmt/format.h>

#include <exception>
#include <utility>

#include <palpate/baselines.h>
#include <palpate/cleaning.h>
#include "baselines/cleaning/steps.h"
#include "baselines/failure.h"
#include "baselines/option_specs.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::baselines {
namespace {

/// Turns CGAL's exceptions into Errors.
auto guarded(std::string name, StepFunction* step) {
  return [name = std::move(name),
          step](const scene::CleaningStepInput& input) -> Result<scene::CleaningStepOutput> {
    try {
      Result<scene::CleaningStepOutput> output = step(input);
      if (input.progress.cancelled()) return failure("stopped while cleaning");
      return output;
    } catch (const std::exception& error) {
      return failure(fmt::format("{} failed: {}", name, error.what()), "leave this step out");
    }
  };
}

/// A condition: the option belongs to one of a step's methods.
option::Conditions of(const char* method) {
  return {{"method", {method}}};
}

}  // namespace

void register_cleaning(scene::Cleaning& cleaning) {
  cleaning.add(
      {"outliers",
       "removes points that are far from their neighbours",
       "CGAL point set processing",
       {option::integer("neighbours", "24", "whose distances count", 2, 1000),
        option::number("distance", "4",
                       "a point stays below this root mean square distance to them, spacings", 1e-6, 1e6),
        option::number("percent", "100", "at most so much of the cloud is removed", 0, 100)},
       guarded("outliers", remove_outliers)});
  cleaning.add({"smooth",
                "moves points onto the surface that their neighbours suggest",
                "CGAL: jets (Cazals and Pouget 2005); bilateral (Huang et al. 2013)",
                {option::choice("method", "jet", "fitted polynomials, or edges kept", {"jet", "bilateral"}),
                 option::integer("neighbours", "24", "that are looked at", 6, 1000),
                 option::integer("iterations", "1", "how often", 1, 100),
                 option::integer("degree", "2", "jet: of the polynomial", 1, 4, of("jet")),
                 option::number("sharpness_deg", "25", "bilateral: edges sharper than this are kept", 1e-3,
                                90, of("bilateral"))},
                guarded("smooth", smooth)});
  cleaning.add(
      {"thin",
       "leaves fewer points",
       "CGAL: cells of a grid; clusters (Pauly et al. 2002); WLOP (Huang et al. 2009)",
       {option::choice("method", "grid", "one point a cell; one a flat cluster; regular, moved points",
                       {"grid", "hierarchy", "wlop"}),
        option::number("cell", "2", "grid: edge of a cell, spacings", 1e-6, 1e6, of("grid")),
        option::integer("cluster", "10", "hierarchy: at most so many points in one", 1, 1e6, of("hierarchy")),
        option::number("variation", "0.05", "hierarchy: at most so much of its spread across it", 0,
                       1.0 / 3.0, of("hierarchy")),
        option::number("percent", "25", "wlop: so many points are left", 0.01, 100, of("wlop")),
        option::number("radius", "4", "wlop: neighbourhood, spacings", 0.1, 1e3, of("wlop")),
        option::integer("iterations", "35", "wlop: how often", 1, 1000, of("wlop"))},
       guarded("thin", thin)});
  cleaning.add({"upsample",
                "adds points between the points, edges kept",
                "CGAL: edge-aware resampling (Huang et al. 2013)",
                {option::number("factor", "2", "points after over points before", 1.0001, 100),
                 option::number("sharpness_deg", "25", "what counts as an edge", 0, 90),
                 option::number("edge_sensitivity", "0", "0: evenly; 1: at edges", 0, 1),
                 option::number("radius", "4", "neighbourhood, spacings", 1, 1e3)},
                guarded("upsample", upsample)});
  cleaning.add(
      {"fill-holes",
       "closes holes with points as dense as around them",
       "CGAL: advancing front, hole filling (Liepa 2003), fairing",
       {option::number("width", "30", "holes wider than this, across their box, stay; spacings", 0, 1e6),
        option::number("edge", "3", "points farther apart than this have a hole between them, spacings", 1,
                       1e6),
        option::number("time_limit_s", "120", "the mesh that shows the holes may take so long; 0: no limit",
                       0, 1e9)},
       guarded("fill-holes", fill_holes)});
}

std::vector<Vec3> plane_normals(const scene::CleaningStepInput& input) {
  const cloud::Cloud& cloud = input.cloud;
  const search::NeighbourTable neighbours = search::exact_knn(cloud, input.threads);
  std::vector<surface::OrientedPoint> points = surface::surface_points(cloud);
  surface::fit_planes(points, neighbours.of, input.threads);
  surface::orient_planes(points, neighbours.of, input.threads);
  return surface::normals_of(points);
}

Status enough_points(const scene::CleaningStepInput& input, std::size_t needed) {
  if (input.cloud.size() >= needed) return Done{};
  return failure(fmt::format("{} points are too few: this step looks at {}", input.cloud.size(), needed),
                 "leave the step out, or give it fewer neighbours");
}

}  // namespace palpate::baselines
