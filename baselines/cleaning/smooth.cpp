#define CGAL_EIGEN3_ENABLED 1  // its least squares
#include <CGAL/Eigen_svd.h>
#include <CGAL/bilateral_smooth_point_set.h>
#include <CGAL/jet_smooth_point_set.h>
#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "baselines/cleaning/steps.h"
#include "baselines/reconstruct/cgal_points.h"
#include "toolkit/core/try.h"

namespace palpate::baselines {
namespace {

/// Neighbours in one place give a matrix that is not finite, on which Eigen's solution would read where
/// nothing is: such a point gets a place that is not finite, and stays.
struct GuardedSvd : CGAL::Eigen_svd {
  static FT solve(const Matrix& matrix, Vector& right) {
    if (matrix.eigen_object().allFinite() && right.eigen_object().allFinite())
      return CGAL::Eigen_svd::solve(matrix, right);
    right.eigen_object().setConstant(std::numeric_limits<double>::quiet_NaN());
    return std::numeric_limits<double>::infinity();
  }
};

/// Coefficients of a polynomial of this degree in two variables: a jet needs as many points.
unsigned coefficients(unsigned degree) {
  return (degree + 1) * (degree + 2) / 2;
}

void jets(const scene::StepInput& input, unsigned k, std::vector<CgalPoint>& points) {
  const auto degree = static_cast<unsigned>(input.options.integer("degree"));
  const auto parameters = CGAL::parameters::point_map(CgalPlaceMap())
                              .svd_traits(GuardedSvd())
                              .degree_fitting(degree)
                              .degree_monge(std::min(degree, 2u))  // what CGAL's frame of curvatures needs
                              .callback(Advance{&input.progress, "smoothing by jets"});
  CGAL::jet_smooth_point_set<CGAL::Sequential_tag>(points, k, parameters);
}

/// Moves those with a normal; the number of the others.
std::size_t bilateral(const scene::StepInput& input, unsigned k, std::vector<CgalPoint>& points) {
  const std::vector<Vec3> normals = plane_normals(input);
  std::vector<CgalPoint> with;
  for (CgalPoint& p : points) {
    const Vec3& n = normals[p.index];
    if (n == Vec3::Zero()) continue;
    p.normal = {n.x(), n.y(), n.z()};
    with.push_back(p);
  }
  if (with.size() <= k) return points.size();
  const auto parameters = CGAL::parameters::point_map(CgalPlaceMap())
                              .normal_map(CgalNormalMap())
                              .sharpness_angle(input.options.number("sharpness_deg"))
                              .callback(Advance{&input.progress, "smoothing bilaterally"});
  for (long long i = 0; i < input.options.integer("iterations") && !input.progress.cancelled(); ++i)
    CGAL::bilateral_smooth_point_set<CGAL::Sequential_tag>(with, k, parameters);
  for (const CgalPoint& p : with) points[p.index].place = p.place;
  return points.size() - with.size();
}

bool is_finite(const Vec3& p) {
  return std::isfinite(p.x()) && std::isfinite(p.y()) && std::isfinite(p.z());
}

}  // namespace

Result<scene::StepOutput> smooth(const scene::StepInput& input) {
  const auto k = static_cast<unsigned>(input.options.integer("neighbours"));
  const bool jet = input.options.text("method") == "jet";
  const auto degree = static_cast<unsigned>(input.options.integer("degree"));
  if (jet && k < coefficients(degree))
    return Error{
        fmt::format("a jet of degree {} needs {} neighbours, not {}", degree, coefficients(degree), k),
        "give it more neighbours, or a lower degree",
        {},
        0};
  PALPATE_TRY(enough_points(input, k + 1));
  std::vector<CgalPoint> points = cgal_points(input.cloud, input.spacing_mm);
  std::size_t left = 0;
  if (!jet) left = bilateral(input, k, points);
  for (long long i = 0; jet && i < input.options.integer("iterations") && !input.progress.cancelled(); ++i)
    jets(input, k, points);
  scene::StepOutput output;
  for (const CgalPoint& p : points) {
    // Where neighbours lie in one place or on one line no polynomial is determined: such a point stays.
    const Vec3 place = place_of(p.place) * input.spacing_mm;
    const bool finite = is_finite(place);
    left += finite ? 0 : 1;
    output.from.push_back(p.index);
    output.placed_mm.push_back(finite ? place : input.cloud.local_mm(p.index));
  }
  if (left > 0) output.note = fmt::format("{} of them could not be fitted and stayed", left);
  return output;
}

}  // namespace palpate::baselines
