#include "toolkit/paths/plane_fits.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "toolkit/core/percentiles.h"

namespace palpate::paths {
namespace {

// The fit radius is chosen so that the median ball holds between these numbers of points.
constexpr std::size_t kMaxInBall = 64;
constexpr int kRadiusTrials = 24;
constexpr double kRadiusFactor = 1.3;
constexpr std::size_t kSampledBalls = 129;
// With fewer points, or a centroid beyond this share of the radius (a straight border, seen from itself, has
// 0.37), the surface ends.
constexpr std::size_t kMinFitted = 6;
constexpr double kBorderOffset = 0.5;

std::size_t median_in_ball(const cloud::Cloud& cloud, const search::PointSearch& points, double radius) {
  std::vector<std::size_t> counts;
  for (std::size_t s = 0; s < kSampledBalls; ++s) {
    const Vec3 p = cloud.local_mm(s * (cloud.size() - 1) / (kSampledBalls - 1));
    std::size_t count = 0;
    points.around(p, kMaxFitted, [&](const Vec3& q) { count += (q - p).squaredNorm() < radius * radius; });
    counts.push_back(count);
  }
  return upper_median(std::move(counts));
}

}  // namespace

PlaneFit fit_plane(const search::PointSearch& points, const Vec3& p, double radius, const Vec3& side) {
  double weights = 0.0;
  std::size_t count = 0;
  Vec3 sum = Vec3::Zero();
  Mat3 products = Mat3::Zero();
  points.around(p, kMaxFitted, [&](const Vec3& q) {
    const Vec3 offset = (q - p) / radius;
    const double rest = 1.0 - offset.squaredNorm();
    if (rest <= 0.0) return;
    const double w = rest * rest;
    weights += w;
    sum += w * offset;
    products += w * offset * offset.transpose();
    ++count;
  });
  PlaneFit fit;
  if (count < kMinFitted || !(weights > 0.0)) return fit;
  const Vec3 mean = sum / weights;
  Eigen::SelfAdjointEigenSolver<Mat3> solver;
  solver.computeDirect(products / weights - mean * mean.transpose());
  fit.normal = solver.eigenvectors().col(0).normalized();
  if (!is_finite(fit.normal)) return fit;
  if (fit.normal.dot(side) < 0.0) fit.normal = -fit.normal;
  fit.height = radius * mean.dot(fit.normal);
  fit.good = (mean - mean.dot(fit.normal) * fit.normal).norm() < kBorderOffset &&
             std::abs(mean.dot(fit.normal)) < kBorderOffset;
  return fit;
}

Result<FitSearch> choose_fit_radius(const cloud::Cloud& cloud, const geometry::Aabb& box) {
  const Vec3 e = box.extent_mm();
  // First guess: the points spread over the box's faces.
  const double faces = e.x() * e.y() + e.y() * e.z() + e.z() * e.x();
  FitSearch fitting;
  fitting.radius_mm = std::sqrt(static_cast<double>(kMaxInBall) * faces /
                                (std::numbers::pi * static_cast<double>(cloud.size())));
  if (!(fitting.radius_mm > 0.0))
    return Error{
        "the points of the cloud stand in one line or place", "an exploration needs a surface", {}, 0};
  for (int trial = 0; trial < kRadiusTrials; ++trial) {
    fitting.points = std::make_unique<search::PointSearch>(cloud, fitting.radius_mm);
    const std::size_t median = median_in_ball(cloud, *fitting.points, fitting.radius_mm);
    if (median >= kMinInBall && median <= kMaxInBall) return fitting;
    fitting.radius_mm *= median < kMinInBall ? kRadiusFactor : 1.0 / kRadiusFactor;
  }
  fitting.points =
      std::make_unique<search::PointSearch>(cloud, fitting.radius_mm);  // uneven clouds: the best possible
  return fitting;
}

}  // namespace palpate::paths
