#include "baselines/points/implicit_field.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace palpate::baselines {
namespace {

constexpr std::size_t kPointsPerChunk = 8192;

/// A weight and its slope, of q = distance / radius in [0, 1).
struct Weight {
  double value, slope;
};
Weight weight_at(ImplicitWeight kind, double q) noexcept {
  if (kind == ImplicitWeight::kWyvill) {
    const double s = q * q;
    return {1.0 + s * (-22.0 / 9.0 + s * (17.0 / 9.0 - s * (4.0 / 9.0))),
            q * (-44.0 / 9.0 + s * (68.0 / 9.0 - s * (24.0 / 9.0)))};
  }
  const double left = 1.0 - q, cubed = left * left * left;
  return {cubed * left * (4.0 * q + 1.0), -20.0 * q * cubed};
}

/// The mean distance of a point to its nearest neighbours elsewhere; 0 where it has none.
double mean_nearest(std::span<const surface::OrientedPoint> points, const search::Neighbours& around,
                    std::size_t self) {
  std::array<double, kRadiusNeighbours> least;  // ascending
  least.fill(std::numeric_limits<double>::infinity());
  for (const std::uint32_t other : around) {
    double d = (points[other].at() - points[self].at()).norm();
    if (!(d > 0.0)) continue;
    for (double& kept : least)
      if (d < kept) std::swap(d, kept);
  }
  double sum = 0.0, count = 0.0;
  for (const double d : least) {
    if (!std::isfinite(d)) continue;
    sum += d;
    count += 1.0;
  }
  return count > 0.0 ? sum / count : 0.0;
}

double farthest(std::span<const surface::OrientedPoint> points, const search::Neighbours& around,
                std::size_t self) {
  double most_sq = 0.0;
  for (const std::uint32_t other : around)
    most_sq = std::max(most_sq, (points[other].at() - points[self].at()).squaredNorm());
  return std::sqrt(most_sq);
}

}  // namespace

void ImplicitField::build(PointGrid points, std::span<const search::Neighbours> neighbours,
                          const ImplicitOptions& options, int threads) {
  points_ = std::move(points);
  options_ = options;
  const std::size_t n = points_.points.size();
  radius_.resize(n);
  std::vector<double> sum((n + kPointsPerChunk - 1) / kPointsPerChunk, 0.0), most(sum.size(), 0.0);
  parallel_chunks(n, kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      double radius = kRadiusSpacings * mean_nearest(points_.points, neighbours[i], i);
      if (options_.across)
        radius = std::max(radius, kAcrossShare * farthest(points_.points, neighbours[i], i));
      if (!(radius > 0.0)) radius = points_.cell_mm() / kActiveRadii;  // a point alone
      radius_[i] = static_cast<float>(radius);
      sum[begin / kPointsPerChunk] += radius;
      most[begin / kPointsPerChunk] = std::max(most[begin / kPointsPerChunk], radius);
    }
  });
  double total = 0.0;
  for (std::size_t chunk = 0; chunk < sum.size(); ++chunk) {
    total += sum[chunk];
    largest_ = std::max(largest_, most[chunk]);
  }
  active_ = kActiveRadii * total / static_cast<double>(n);
  reach_ = std::min(active_, largest_);
}

ImplicitValue ImplicitField::at(const Vec3& place, const OutwardSide& side) const noexcept {
  double weights = 0.0;
  Vec3 mean = Vec3::Zero(), normals = Vec3::Zero(), slope = Vec3::Zero();
  points_.within(place, reach_, [&](std::uint32_t i, double sq) {
    const double radius = static_cast<double>(radius_[i]);
    if (!(sq < radius * radius)) return;
    const surface::OrientedPoint& point = points_.points[i];
    const Vec3 d = point.at() - place;
    const double distance = std::sqrt(sq);
    const Weight w = weight_at(options_.weight, distance / radius);
    weights += w.value;
    if (options_.surface == ImplicitSurface::kMetaball) {
      if (distance > 0.0) slope += d * (w.slope / (radius * distance));
      return;
    }
    mean += w.value * d;
    normals += w.value * side.normal(point.normal);
  });
  ImplicitValue found;
  if (!(weights > 0.0)) return found;
  if (options_.surface == ImplicitSurface::kMetaball) {
    found.f = options_.level - weights;
    found.gradient = slope;
  } else {
    const Vec3 normal = normals / weights;
    const double size = normal.norm();
    if (!(size > 0.0)) return found;
    // The mean normal is not made a unit vector again in f, as in the source.
    found.f = -normal.dot(mean / weights);
    found.gradient = normal / size;
  }
  found.defined = found.gradient.squaredNorm() > 0.0;
  return found;
}

std::uint32_t ImplicitField::nearest(const Vec3& place) const noexcept {
  std::uint32_t best = kNoPlace;
  double best_sq = std::numeric_limits<double>::infinity();
  points_.within(place, active_, [&](std::uint32_t i, double sq) {
    if (sq >= best_sq) return;
    best_sq = sq;
    best = i;
  });
  return best;
}

}  // namespace palpate::baselines
