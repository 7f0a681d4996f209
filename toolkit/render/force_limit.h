// The force limit of a frame, also where a force is too large to be squared.
#pragma once

#include <cmath>

#include "toolkit/core/vec.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

/// A force whose square overflows, held to `limit_n`: brought to a largest component of 1 first. One that has
/// overflowed itself keeps the direction of its infinite components.
[[nodiscard]] inline Vec3 huge_force_limited(const Vec3& force_n, double limit_n) noexcept {
  const double largest = force_n.cwiseAbs().maxCoeff();
  Vec3 direction = force_n / largest;
  if (std::isinf(largest))
    for (int axis = 0; axis < 3; ++axis)
      direction[axis] = std::isinf(force_n[axis]) ? std::copysign(1.0, force_n[axis]) : 0.0;
  return direction * (limit_n / direction.norm());
}

/// limited(), without a root where nothing is limited, and of any force.
[[nodiscard]] inline Vec3 held_to_limit(const Vec3& force_n, double limit_n) noexcept {
  const double square = force_n.squaredNorm();
  if (square <= limit_n * limit_n) return force_n;
  return std::isinf(square) ? huge_force_limited(force_n, limit_n) : limited(force_n, limit_n);
}

}  // namespace palpate::render
