#include <CGAL/remove_outliers.h>

#include <algorithm>

#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"
#include "toolkit/core/try.h"

namespace palpate::baselines {

Result<scene::StepOutput> remove_outliers(const scene::StepInput& input) {
  const auto k = static_cast<unsigned>(input.options.integer("neighbours"));
  PALPATE_TRY(enough_points(input, k + 1));
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing_mm);
  const auto end = CGAL::remove_outliers<CGAL::Sequential_tag>(
      points, k,
      CGAL::parameters::point_map(CgalPlaceMap())
          .threshold_distance(input.options.number("distance"))
          .threshold_percent(input.options.number("percent"))
          .callback(Advance{&input.progress, "removing outliers"}));
  scene::StepOutput output;
  for (auto p = points.begin(); p != end; ++p) output.from.push_back(p->index);
  std::sort(output.from.begin(), output.from.end());
  return output;
}

}  // namespace palpate::baselines
