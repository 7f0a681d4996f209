#include "baselines/reference/rest.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <Eigen/Dense>

namespace palpate::baselines {
namespace {

/// Directions that differ by less are one: a thousandth of any angle that the test distinguishes.
constexpr double kSameDirection = 1e-9;

/// Least squares w = sum l_i n_i over up to three of the directions, none pulling: the residual, or infinity.
double residual(const Vec3& w, std::span<const Vec3> push) {
  Eigen::Matrix<double, 3, Eigen::Dynamic> n(3, static_cast<Eigen::Index>(push.size()));
  for (std::size_t i = 0; i < push.size(); ++i) n.col(static_cast<Eigen::Index>(i)) = push[i];
  const Eigen::VectorXd l = n.colPivHouseholderQr().solve(w);
  if ((l.array() < 0.0).any()) return HUGE_VAL;
  return (n * l - w).norm();
}

std::vector<Vec3> directions(const SurfaceMesh& mesh, std::span<const std::uint32_t> facets,
                             const Vec3& proxy, double radius, const Vec3& pull) {
  std::vector<Vec3> result;
  for (const std::uint32_t i : facets) {
    Vec3 n = mesh.normal(half_facet(i, 0));
    if (radius > 0.0)
      n = (proxy - closest_on_facet(mesh.facet(i), proxy).point).normalized();
    else if (n.dot(pull) < 0.0)
      n = -n;
    const bool known = std::any_of(result.begin(), result.end(),
                                   [&](const Vec3& m) { return (m - n).norm() < kSameDirection; });
    if (!known && n != Vec3::Zero()) result.push_back(n);
  }
  return result;
}

}  // namespace

Rest rest_of(const SurfaceMesh& mesh, const FacetTree& tree, const Vec3& proxy, double radius, double reach,
             const Vec3& hip) {
  std::vector<std::uint32_t> facets;
  tree.within(proxy, radius + reach, facets);
  const Vec3 pull = proxy - hip;
  const std::vector<Vec3> push = directions(mesh, facets, proxy, radius, pull);
  Rest rest{push.size(), 0.5 * std::numbers::pi};
  const double length = pull.norm();
  if (!(length > 0.0)) {
    rest.off_rad = 0.0;
    return rest;
  }
  // The nearest sum of pushes lies in a face of their cone, which up to three of them span.
  double least = length;
  const std::size_t n = push.size();
  for (std::size_t i = 0; i < n; ++i) {
    least = std::min(least, residual(pull, std::array{push[i]}));
    for (std::size_t j = i + 1; j < n; ++j) {
      least = std::min(least, residual(pull, std::array{push[i], push[j]}));
      for (std::size_t k = j + 1; k < n; ++k)
        least = std::min(least, residual(pull, std::array{push[i], push[j], push[k]}));
    }
  }
  rest.off_rad = std::asin(std::min(1.0, least / length));
  return rest;
}

}  // namespace palpate::baselines
