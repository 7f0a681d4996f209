// Cleaning steps of CGAL that drop points or add some: outliers, thin, upsample.

#include <CGAL/Random.h>
#include <CGAL/edge_aware_upsample_point_set.h>
#include <CGAL/grid_simplify_point_set.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/remove_outliers.h>
#include <CGAL/wlop_simplify_and_regularize_point_set.h>
#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include <palpate/result.h>
#include "baselines/cleaning/steps.h"
#include "baselines/failure.h"
#include "baselines/reconstruct/cgal_points.h"

namespace palpate::baselines {

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
  scene::CleaningStepOutput output;
  for (auto p = points.begin(); p != end; ++p) output.from.push_back(p->index);
  std::sort(output.from.begin(), output.from.end());
  return output;
}

namespace {

scene::CleaningStepOutput kept(std::vector<CgalPoint>::const_iterator begin,
                               std::vector<CgalPoint>::const_iterator end) {
  scene::CleaningStepOutput output;
  for (auto p = begin; p != end; ++p) output.from.push_back(p->index);
  std::sort(output.from.begin(), output.from.end());
  return output;
}

Result<scene::CleaningStepOutput> wlop(const scene::CleaningStepInput& input,
                                       std::vector<CgalPoint>& points) {
  const double percent = input.options.number("percent");
  if (static_cast<double>(points.size()) * percent < 100.0)
    return failure("so few percent leave no point", "give thin a larger 'percent'");
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
  std::vector<CgalPoint> points;
  for (CgalPoint& p : cgal_points(input.cloud, input.spacing_mm)) {
    const Vec3& n = normals[p.index];
    if (n == Vec3::Zero()) continue;
    p.normal = {n.x(), n.y(), n.z()};
    points.push_back(p);
  }
  if (points.size() <= kRing)
    return failure("hardly a point lies on a surface, so nothing can be added between them",
                   "leave this step out");
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

}  // namespace palpate::baselines
