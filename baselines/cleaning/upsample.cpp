#include <CGAL/edge_aware_upsample_point_set.h>
#include <fmt/format.h>

#include <numeric>

#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"
#include "toolkit/core/try.h"

namespace palpate::baselines {
namespace {

// CGAL estimates the spacing from this many neighbours.
constexpr std::size_t kRing = 6;

}  // namespace

Result<scene::StepOutput> upsample(const scene::StepInput& input) {
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
    return Error{"hardly a point lies on a surface, so nothing can be added between them",
                 "leave this step out",
                 {},
                 0};
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
  scene::StepOutput output;
  output.from.resize(input.cloud.size());
  std::iota(output.from.begin(), output.from.end(), 0u);
  for (const auto& [place, normal] : added) {
    output.placed_mm.push_back(place_of(place) * input.spacing_mm);
    output.from.push_back(scene::kFromNearest);
  }
  if (const std::size_t left = input.cloud.size() - points.size(); left > 0)
    output.note = fmt::format("{} points without a plane were not looked at", left);
  return output;
}

}  // namespace palpate::baselines
