#include <CGAL/Random.h>
#include <CGAL/grid_simplify_point_set.h>
#include <CGAL/hierarchy_simplify_point_set.h>
#include <CGAL/wlop_simplify_and_regularize_point_set.h>

#include <algorithm>

#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"

namespace palpate::baselines {
namespace {

scene::StepOutput kept(std::vector<CgalPoint>::const_iterator begin,
                       std::vector<CgalPoint>::const_iterator end) {
  scene::StepOutput output;
  for (auto p = begin; p != end; ++p) output.from.push_back(p->index);
  std::sort(output.from.begin(), output.from.end());
  return output;
}

Result<scene::StepOutput> wlop(const scene::StepInput& input, std::vector<CgalPoint>& points) {
  const double percent = input.options.number("percent");
  if (static_cast<double>(points.size()) * percent < 100.0)
    return Error{"so few percent leave no point", "give thin a larger 'percent'", {}, 0};
  CGAL::get_default_random() = CGAL::Random(0);  // else it starts from the clock
  std::vector<CgalKernel::Point_3> places;
  CGAL::wlop_simplify_and_regularize_point_set<CGAL::Sequential_tag>(
      points, std::back_inserter(places),
      CGAL::parameters::point_map(CgalPlaceMap())
          .select_percentage(percent)
          .neighbor_radius(input.options.number("radius"))
          .number_of_iterations(static_cast<unsigned>(input.options.integer("iterations")))
          .callback(Advance{&input.progress, "thinning by WLOP"}));
  scene::StepOutput output;
  for (const CgalKernel::Point_3& p : places) output.placed_mm.push_back(place_of(p) * input.spacing_mm);
  output.from.assign(places.size(), scene::kFromNearest);
  return output;
}

}  // namespace

Result<scene::StepOutput> thin(const scene::StepInput& input) {
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

}  // namespace palpate::baselines
