#include "toolkit/geometry/enclosure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "toolkit/core/parallel.h"

namespace palpate::geometry {
namespace {

/// A part is no point where it is nearer than half its width, the root of its area.
constexpr double kSoftShare = 0.25;
/// Places of the surface that are asked what they see, and parts that are enough to tell.
constexpr std::size_t kPlaces = 64, kFewestParts = 16;
/// From a place of a closed surface the rest of it takes half of all directions. An open half of a ball takes
/// half of that, a plane nothing: what takes more than three quarters is nearer to closed than to a half.
constexpr double kEnclosing = 0.75 * 0.5;
/// Places that look at a part together: its width is asked once for all of them.
constexpr std::size_t kTogether = 8;

/// share_around() of each place.
template <std::size_t kCount>
std::array<double, kCount> shares_around(std::span<const SurfacePart> parts,
                                         const std::array<Vec3, kCount>& places) noexcept {
  std::array<double, kCount> x, y, z, sum{};
  for (std::size_t k = 0; k < kCount; ++k) {
    x[k] = places[k].x();
    y[k] = places[k].y();
    z[k] = places[k].z();
  }
  for (const SurfacePart& part : parts) {
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

double share_around(std::span<const SurfacePart> parts, const Vec3& at) noexcept {
  return shares_around<1>(parts, {at}).front();
}

float outer_side(std::span<const SurfacePart> parts, int threads) {
  if (parts.size() < kFewestParts) return 0.0f;
  std::array<double, kPlaces> share{};
  static_assert(kPlaces % kTogether == 0);
  parallel_chunks(kPlaces, kTogether, threads, [&](std::size_t begin, std::size_t) {
    std::array<Vec3, kTogether> places;
    for (std::size_t k = 0; k < kTogether; ++k)
      places[k] = parts[parts.size() * (2 * (begin + k) + 1) / (2 * kPlaces)].middle.cast<double>();
    const std::array<double, kTogether> these = shares_around<kTogether>(parts, places);
    std::copy(these.begin(), these.end(), share.begin() + static_cast<std::ptrdiff_t>(begin));
  });
  // The middle one: where faces are near to each other single places see too much or too little.
  const auto middle = share.begin() + kPlaces / 2;
  std::nth_element(share.begin(), middle, share.end());
  return *middle > kEnclosing ? 1.0f : *middle < -kEnclosing ? -1.0f : 0.0f;
}

}  // namespace palpate::geometry
