#include "device/interface/workspace_edge.h"

#include <algorithm>
#include <cmath>

namespace palpate::device {
namespace {

struct AtEdge {
  double share;
  double damping_n_s_per_mm;
  Vec3 velocity_mm_s;
};

/// Fades at one wall with the unit normal `outward`; `reach` is 1 at the edge.
Vec3 at_wall(const AtEdge& edge, const Vec3& outward, double reach, const Vec3& force_n) noexcept {
  const double near = smooth_step((reach - (1.0 - edge.share)) / edge.share);
  if (near <= 0.0) return force_n;
  const double push_n = std::max(0.0, force_n.dot(outward));
  const double out_mm_s = std::max(0.0, edge.velocity_mm_s.dot(outward));
  return force_n - near * (push_n + edge.damping_n_s_per_mm * out_mm_s) * outward;
}

/// Fades at an ellipsoid of half axes `half_mm`; a zero axis is ignored.
Vec3 at_mantle(const AtEdge& edge, const Vec3& scaled, const Vec3& per_half, const Vec3& force_n) noexcept {
  const Vec3 gradient = scaled.cwiseProduct(per_half);
  const double length = gradient.norm();
  if (!(length > 0.0)) return force_n;  // the exact centre
  return at_wall(edge, gradient / length, scaled.norm(), force_n);
}

}  // namespace

double smooth_step(double t) noexcept {
  const double held = std::clamp(t, 0.0, 1.0);
  return held * held * (3.0 - 2.0 * held);
}

Vec3 faded_at_edge(const DeviceLimits& limits, double share, double damping_n_s_per_mm,
                   const Vec3& position_mm, const Vec3& velocity_mm_s, const Vec3& force_n) noexcept {
  const AtEdge edge{share, damping_n_s_per_mm, velocity_mm_s};
  const Vec3 per_half = (0.5 * limits.workspace_mm.extent_mm()).cwiseInverse();
  const Vec3 scaled = (position_mm - limits.workspace_mm.centre_mm()).cwiseProduct(per_half);
  if (limits.workspace_shape == WorkspaceShape::kEllipsoid) return at_mantle(edge, scaled, per_half, force_n);
  Vec3 left_n = force_n;
  int first = 0;
  if (limits.workspace_shape == WorkspaceShape::kCylinder) {
    left_n = at_mantle(edge, Vec3{scaled.x(), scaled.y(), 0.0}, per_half, left_n);
    first = 2;
  }
  for (int axis = first; axis < 3; ++axis) {
    const Vec3 outward = std::copysign(1.0, scaled[axis]) * Vec3::Unit(axis);
    left_n = at_wall(edge, outward, std::abs(scaled[axis]), left_n);
  }
  return left_n;
}

}  // namespace palpate::device
