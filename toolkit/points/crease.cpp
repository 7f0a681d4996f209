#include "toolkit/points/crease.h"

#include <array>

#include "toolkit/surface/fan.h"

namespace palpate::render {
namespace {

using surface::Fan;

/// The vector from r to the nearest place on the fan.
Vec3 pull_to(const Fan& fan, const Vec3& r) noexcept {
  double least = r.squaredNorm();
  Vec3 best = -r;
  std::array<Vec3, neighbourhood::kNeighbours> aside;  // corner x r
  for (std::size_t i = 0; i < fan.size; ++i) {
    const Vec3& d = fan.corner[i];
    aside[i] = d.cross(r);
    const double along = d.dot(r);
    if (!(along > 0.0)) continue;
    const Vec3 to_line = (along / d.squaredNorm()) * d - r;
    const double square = to_line.squaredNorm();
    if (!(square < least)) continue;
    least = square;
    best = to_line;
  }
  for (std::size_t i = 0; i < fan.size; ++i) {
    const std::size_t j = i + 1 == fan.size ? 0 : i + 1;
    const Vec3 n = fan.corner[i].cross(fan.corner[j]);
    if (!(n.dot(aside[i]) >= 0.0 && n.dot(aside[j]) <= 0.0)) continue;  // the foot is beside the facet
    const double height = n.dot(r), area_sq = n.squaredNorm();
    if (!(height * height < least * area_sq)) continue;
    least = height * height / area_sq;
    best = (-height / area_sq) * n;
  }
  return best;
}

}  // namespace

Vec3 pull_at_crease(const PointModel& model, const WalkEnd& end, const Vec3& outward, const Vec3& h,
                    const Vec3& pull) noexcept {
  const Vec3 g = model.points[end.place].at();
  const Fan fan = surface::fan_of(
      outward, [&](std::size_t k) { return Vec3(Vec3(end.x_mm[k], end.y_mm[k], end.z_mm[k]) - g); });
  return fan.closed() ? pull_to(fan, h - g) : pull;
}

}  // namespace palpate::render
