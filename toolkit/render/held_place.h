// The rule by which a held place agrees with what the surface says of the HIP itself.
#pragma once

#include <cmath>

#include "toolkit/core/vec.h"

namespace palpate::render {

struct Surroundings {
  bool known = false;
  double signed_distance = 0.0;  ///< positive outside
  Vec3 outward = Vec3::Zero();   ///< unit
};
enum class HeldPlace { kKeep, kMove, kFree };

inline HeldPlace judge_held_place(const Vec3& hip, const Vec3& held, const Vec3& held_outward,
                                  const Surroundings& at, double spacing) noexcept {
  const double far = (hip - held).norm();
  if (!at.known || !(far > 0.5 * spacing)) return HeldPlace::kKeep;
  const double cosine = at.outward.dot(held_outward);
  if (std::abs(at.signed_distance) > 0.5 * far) return HeldPlace::kKeep;
  if (at.signed_distance > 0.05 * spacing && cosine > -0.7) return HeldPlace::kFree;
  if (at.signed_distance < 0.0 && far > 1.5 * spacing && cosine > -0.5) return HeldPlace::kMove;
  return HeldPlace::kKeep;
}

}  // namespace palpate::render
