#include "toolkit/geometry/winding_number.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "toolkit/core/parallel.h"

namespace palpate::geometry {
namespace {

/// A part acts as a point only beyond half its width, sqrt(area).
constexpr double kSoftShare = 0.25;
/// Surface places that are sampled, and the fewest parts for a decision.
constexpr std::size_t kPlaces = 64, kMinElements = 16;
/// From a place on a closed surface the rest covers half of all directions, from an open half ball a quarter,
/// from a plane none. Above three quarters of a half a piece counts as closed.
constexpr double kEnclosingThreshold = 0.75 * 0.5;
/// Places evaluated together, to compute each part's width once.
constexpr std::size_t kTogether = 8;

/// winding_number() of each place.
template <std::size_t kCount>
std::array<double, kCount> winding_numbers(std::span<const AreaElement> parts,
                                           const std::array<Vec3, kCount>& places) noexcept {
  std::array<double, kCount> x, y, z, sum{};
  for (std::size_t k = 0; k < kCount; ++k) {
    x[k] = places[k].x();
    y[k] = places[k].y();
    z[k] = places[k].z();
  }
  for (const AreaElement& part : parts) {
    const Vec3 middle = part.middle.cast<double>(), area = part.area.cast<double>();
    const double soft = kSoftShare * area.norm();
    for (std::size_t k = 0; k < kCount; ++k) {
      const double dx = middle.x() - x[k], dy = middle.y() - y[k], dz = middle.z() - z[k];
      const double sq = ((dx * dx + dy * dy) + dz * dz) + soft;
      const double seen = ((area.x() * dx + area.y() * dy) + area.z() * dz) / (sq * std::sqrt(sq));
      sum[k] += sq > 0.0 ? seen : 0.0;
    }
  }
  for (double& share : sum) share /= 4.0 * std::numbers::pi;
  return sum;
}

}  // namespace

double winding_number(std::span<const AreaElement> parts, const Vec3& at) noexcept {
  return winding_numbers<1>(parts, {at}).front();
}

float normal_orientation(std::span<const AreaElement> parts, int threads) {
  if (parts.size() < kMinElements) return 0.0f;
  std::array<double, kPlaces> share{};
  static_assert(kPlaces % kTogether == 0);
  parallel_chunks(kPlaces, kTogether, threads, [&](std::size_t begin, std::size_t) {
    std::array<Vec3, kTogether> places;
    for (std::size_t k = 0; k < kTogether; ++k)
      places[k] = parts[parts.size() * (2 * (begin + k) + 1) / (2 * kPlaces)].middle.cast<double>();
    const std::array<double, kTogether> these = winding_numbers<kTogether>(parts, places);
    std::copy(these.begin(), these.end(), share.begin() + static_cast<std::ptrdiff_t>(begin));
  });
  // The median: where faces are close, single places see too much or too little.
  const auto middle = share.begin() + kPlaces / 2;
  std::nth_element(share.begin(), middle, share.end());
  return *middle > kEnclosingThreshold ? 1.0f : *middle < -kEnclosingThreshold ? -1.0f : 0.0f;
}

}  // namespace palpate::geometry
