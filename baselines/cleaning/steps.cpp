// The registry's entries of all cleaning steps, and those of CGAL that drop points or add some: outliers,
// thin, upsample.
#include "baselines/cleaning/steps.h"

#include <CGAL/Random.h>
#include <CGAL/edge_aware_upsample_point_set.h>
#include <CGAL/grid_simplify_point_set.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/remove_outliers.h>
#include <CGAL/wlop_simplify_and_regularize_point_set.h>
#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <numeric>
#include <utility>

#include <palpate/baselines.h>
#include <palpate/result.h>

#include <palpate/scene.h>
#include "baselines/option_specs.h"
#include "baselines/reconstruct/cgal_points.h"
#include "toolkit/search/knn.h"
#include "toolkit/surface/oriented_points.h"

namespace palpate::baselines {
namespace {

scene::CleaningStepOutput kept(std::vector<CgalPoint>::const_iterator begin,
                               std::vector<CgalPoint>::const_iterator end) {
  scene::CleaningStepOutput output;
  for (auto p = begin; p != end; ++p) output.from.push_back(p->index);
  std::sort(output.from.begin(), output.from.end());
  return output;
}

}  // namespace

Result<scene::CleaningStepOutput> remove_outliers(const scene::CleaningStepInput& input) {
  const auto k = static_cast<unsigned>(input.options.integer("neighbours"));
  PALPATE_TRY(enough_points(input, k + 1));
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing_mm);
  const auto end = CGAL::remove_outliers<CGAL::Sequential_tag>(
      points, k,
      CGAL::parameters::point_map(CgalPlaceMap())
          .threshold_distance(input.options.number("distance"))
          .threshold_percent(input.options.number("percent"))
          .callback(Advance{&input.progress, "removing outliers"}));
  return kept(points.begin(), end);
}

namespace {

Result<scene::CleaningStepOutput> wlop(const scene::CleaningStepInput& input,
                                       std::vector<CgalPoint>& points) {
  const double percent = input.options.number("percent");
  if (static_cast<double>(points.size()) * percent < 100.0)
    return Error{"so few percent leave no point", "give thin a larger 'percent'"};
  CGAL::get_default_random() = CGAL::Random(0);  // otherwise seeded by the clock
  std::vector<CgalKernel::Point_3> places;
  CGAL::wlop_simplify_and_regularize_point_set<CGAL::Sequential_tag>(
      points, std::back_inserter(places),
      CGAL::parameters::point_map(CgalPlaceMap())
          .select_percentage(percent)
          .neighbor_radius(input.options.number("radius"))
          .number_of_iterations(static_cast<unsigned>(input.options.integer("iterations")))
          .callback(Advance{&input.progress, "thinning by WLOP"}));
  scene::CleaningStepOutput output;
  for (const CgalKernel::Point_3& p : places) output.new_points_mm.push_back(place_of(p) * input.spacing_mm);
  output.from.assign(places.size(), scene::kNearestInputPoint);
  return output;
}

}  // namespace

Result<scene::CleaningStepOutput> thin(const scene::CleaningStepInput& input) {
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing_mm);
  const std::string& method = input.options.text("method");
  const auto by_place = CGAL::parameters::point_map(CgalPlaceMap());
  if (method == "wlop") return wlop(input, points);
  if (method == "grid")
    return kept(points.begin(),
                CGAL::grid_simplify_point_set(points, input.options.number("cell"), by_place));
  return kept(points.begin(),
              CGAL::hierarchy_simplify_point_set(
                  points, by_place.size(static_cast<unsigned>(input.options.integer("cluster")))
                              .maximum_variation(input.options.number("variation"))
                              .callback(Advance{&input.progress, "thinning by clusters"})));
}

namespace {

// Neighbours from which CGAL estimates the spacing.
constexpr std::size_t kRing = 6;

}  // namespace

Result<scene::CleaningStepOutput> upsample(const scene::CleaningStepInput& input) {
  PALPATE_TRY(enough_points(input, kRing + 1));
  const std::vector<Vec3> normals = plane_normals(input);
  std::vector<CgalPoint> points = with_normals(cgal_points(input.cloud, input.spacing_mm), normals);
  if (points.size() <= kRing)
    return Error{"hardly a point lies on a surface, so nothing can be added between them",
                 "leave this step out"};
  const auto wanted =
      static_cast<std::size_t>(static_cast<double>(points.size()) * input.options.number("factor"));
  std::vector<std::pair<CgalKernel::Point_3, CgalKernel::Vector_3>> added;
  if (wanted > points.size())
    CGAL::edge_aware_upsample_point_set<CGAL::Sequential_tag>(
        points, std::back_inserter(added),
        CGAL::parameters::point_map(CgalPlaceMap())
            .normal_map(CgalNormalMap())
            .sharpness_angle(input.options.number("sharpness_deg"))
            .edge_sensitivity(input.options.number("edge_sensitivity"))
            .neighbor_radius(input.options.number("radius"))
            .number_of_output_points(wanted));
  scene::CleaningStepOutput output;
  output.from.resize(input.cloud.size());
  std::iota(output.from.begin(), output.from.end(), 0u);
  for (const auto& [place, normal] : added) {
    output.new_points_mm.push_back(place_of(place) * input.spacing_mm);
    output.from.push_back(scene::kNearestInputPoint);
  }
  if (const std::size_t left = input.cloud.size() - points.size(); left > 0)
    output.note = fmt::format("{} points without a plane were not looked at", left);
  return output;
}

namespace {

/// Turns CGAL's exceptions into Errors.
auto guarded(std::string name, StepFunction* step) {
  return [name = std::move(name),
          step](const scene::CleaningStepInput& input) -> Result<scene::CleaningStepOutput> {
    try {
      Result<scene::CleaningStepOutput> output = step(input);
      if (input.progress.cancelled()) return Error{"stopped while cleaning"};
      return output;
    } catch (const std::exception& error) {
      return Error{fmt::format("{} failed: {}", name, error.what()), "leave this step out"};
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
  return Error{fmt::format("{} points are too few: this step looks at {}", input.cloud.size(), needed),
               "leave the step out, or give it fewer neighbours"};
}

}  // namespace palpate::baselines
