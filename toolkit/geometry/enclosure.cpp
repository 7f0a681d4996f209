#include "toolkit/geometry/enclosure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace palpate::geometry {
namespace {

/// A part is no point where it is nearer than half its width, the root of its area.
constexpr double kSoftShare = 0.25;
/// Places of the surface that are asked what they see, and parts that are enough to tell.
constexpr std::size_t kPlaces = 64, kFewestParts = 16;
/// From a place of a closed surface the rest of it takes half of all directions. An open half of a ball takes
/// half of that, a plane nothing: what takes more than three quarters is nearer to closed than to a half.
constexpr double kEnclosing = 0.75 * 0.5;

}  // namespace

double share_around(std::span<const SurfacePart> parts, const Vec3& at) noexcept {
  double sum = 0.0;
  for (const SurfacePart& part : parts) {
    const Vec3 d = part.middle.cast<double>() - at;
    const Vec3 area = part.area.cast<double>();
    const double sq = d.squaredNorm() + kSoftShare * area.norm();
    if (sq > 0.0) sum += area.dot(d) / (sq * std::sqrt(sq));
  }
  return sum / (4.0 * std::numbers::pi);
}

float outer_side(std::span<const SurfacePart> parts) noexcept {
  if (parts.size() < kFewestParts) return 0.0f;
  std::array<double, kPlaces> share{};
  for (std::size_t k = 0; k < kPlaces; ++k)
    share[k] = share_around(parts, parts[parts.size() * (2 * k + 1) / (2 * kPlaces)].middle.cast<double>());
  // The middle one: where faces are near to each other single places see too much or too little.
  const auto middle = share.begin() + kPlaces / 2;
  std::nth_element(share.begin(), middle, share.end());
  return *middle > kEnclosing ? 1.0f : *middle < -kEnclosing ? -1.0f : 0.0f;
}

}  // namespace palpate::geometry
