#include <fmt/format.h>

#include <exception>
#include <utility>

#include "baselines/cleaning/cleaning.h"
#include "baselines/cleaning/steps.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/surface/planes.h"

namespace palpate::baselines {
namespace {

/// CGAL throws on what it cannot do; nothing leaves a step but a Result.
auto guarded(std::string name, StepFunction* step) {
  return [name = std::move(name), step](const scene::StepInput& input) -> Result<scene::StepOutput> {
    try {
      Result<scene::StepOutput> output = step(input);
      if (input.progress.cancelled()) return Error{"stopped while cleaning", {}, {}, 0};
      return output;
    } catch (const std::exception& error) {
      return Error{fmt::format("{} failed: {}", name, error.what()), "leave this step out", {}, 0};
    }
  };
}

using Conditions = std::vector<OptionCondition>;
OptionSpec number(const char* key, const char* value, const char* help, double low, double high,
                  Conditions only_with = {}) {
  return {key, OptionKind::kNumber, value, help, {}, low, high, std::move(only_with)};
}
OptionSpec integer(const char* key, const char* value, const char* help, double low, double high,
                   Conditions only_with = {}) {
  return {key, OptionKind::kInteger, value, help, {}, low, high, std::move(only_with)};
}
/// An option of one of a step's methods.
Conditions of(const char* method) {
  return {{"method", {method}}};
}

}  // namespace

void register_cleaning(scene::Cleaning& cleaning) {
  cleaning.add({"outliers",
                "removes points that are far from their neighbours",
                "CGAL point set processing",
                {integer("neighbours", "24", "whose distances count", 2, 1000),
                 number("distance", "4",
                        "a point stays below this root mean square distance to them, spacings", 1e-6, 1e6),
                 number("percent", "100", "at most so much of the cloud is removed", 0, 100)},
                guarded("outliers", remove_outliers)});
  cleaning.add(
      {"smooth",
       "moves points onto the surface that their neighbours suggest",
       "CGAL: jets (Cazals and Pouget 2005); bilateral (Huang et al. 2013)",
       {{"method", OptionKind::kChoice, "jet", "fitted polynomials, or edges kept", {"jet", "bilateral"}},
        integer("neighbours", "24", "that are looked at", 6, 1000),
        integer("iterations", "1", "how often", 1, 100),
        integer("degree", "2", "jet: of the polynomial", 1, 4, of("jet")),
        number("sharpness_deg", "25", "bilateral: edges sharper than this are kept", 1e-3, 90,
               of("bilateral"))},
       guarded("smooth", smooth)});
  cleaning.add(
      {"thin",
       "leaves fewer points",
       "CGAL: cells of a grid; clusters (Pauly et al. 2002); WLOP (Huang et al. 2009)",
       {{"method",
         OptionKind::kChoice,
         "grid",
         "one point a cell; one a flat cluster; regular, moved points",
         {"grid", "hierarchy", "wlop"}},
        number("cell", "2", "grid: edge of a cell, spacings", 1e-6, 1e6, of("grid")),
        integer("cluster", "10", "hierarchy: at most so many points in one", 1, 1e6, of("hierarchy")),
        number("variation", "0.05", "hierarchy: at most so much of its spread across it", 0, 1.0 / 3.0,
               of("hierarchy")),
        number("percent", "25", "wlop: so many points are left", 0.01, 100, of("wlop")),
        number("radius", "4", "wlop: neighbourhood, spacings", 0.1, 1e3, of("wlop")),
        integer("iterations", "35", "wlop: how often", 1, 1000, of("wlop"))},
       guarded("thin", thin)});
  cleaning.add({"upsample",
                "adds points between the points, edges kept",
                "CGAL: edge-aware resampling (Huang et al. 2013)",
                {number("factor", "2", "points after over points before", 1.0001, 100),
                 number("sharpness_deg", "25", "what counts as an edge", 0, 90),
                 number("edge_sensitivity", "0", "0: evenly; 1: at edges", 0, 1),
                 number("radius", "4", "neighbourhood, spacings", 1, 1e3)},
                guarded("upsample", upsample)});
  cleaning.add(
      {"fill-holes",
       "closes holes with points as dense as around them",
       "CGAL: advancing front, hole filling (Liepa 2003), fairing",
       {number("width", "30", "holes wider than this, across their box, stay; spacings", 0, 1e6),
        number("edge", "3", "points farther apart than this have a hole between them, spacings", 1, 1e6),
        number("time_limit_s", "120", "the mesh that shows the holes may take so long; 0: no limit", 0, 1e9)},
       guarded("fill-holes", fill_holes)});
}

std::vector<Vec3> plane_normals(const scene::StepInput& input) {
  const cloud::Cloud& cloud = input.cloud;
  const neighbourhood::NeighbourTable neighbours = neighbourhood::exact_knn(cloud, input.threads);
  std::vector<surface::SurfacePoint> points = surface::surface_points(cloud);
  surface::fit_planes(points, neighbours.of, input.threads);
  surface::orient_planes(points, neighbours.of, input.threads);
  return surface::normals_of(points);
}

Status enough_points(const scene::StepInput& input, std::size_t needed) {
  if (input.cloud.size() >= needed) return Done{};
  return Error{fmt::format("{} points are too few: this step looks at {}", input.cloud.size(), needed),
               "leave the step out, or give it fewer neighbours",
               {},
               0};
}

}  // namespace palpate::baselines
