// Which way is out, for rivals that read normals: on closed pieces as stored, on open ones the side that the
// HIP came from.
#pragma once

#include <span>

#include "toolkit/core/vec.h"
#include "toolkit/surface/planes.h"

namespace palpate::baselines {

/// +1 or -1, what the normals of open pieces are multiplied by: the side where most of them look, along the
/// axis on which they agree best, is outside; nothing else tells. For rivals that know no path. O(n).
[[nodiscard]] inline double open_sign(std::span<const surface::SurfacePoint> points) noexcept {
  Vec3 sum = Vec3::Zero();
  for (const surface::SurfacePoint& point : points)
    if (point.normal != surface::kNoNormal && !surface::is_one_sided(point.normal))
      sum += surface::decode_normal(point.normal);
  Eigen::Index axis = 0;
  sum.cwiseAbs().maxCoeff(&axis);
  return sum[axis] < 0.0 ? -1.0 : 1.0;
}

/// Belongs to one thread. Closed surfaces are touched from outside. On open pieces the stored normals agree
/// with each other but not with a side: the side is chosen where the HIP comes near and kept until it is free
/// again; pieces of one model share it.
class OutwardSide {
 public:
  void release() noexcept { open_side_ = 0.0; }
  [[nodiscard]] bool chosen() const noexcept { return open_side_ != 0.0; }
  /// Sets the side from which a HIP at `away` from the point (HIP - point) comes, unless it is set.
  void choose(surface::NormalCode code, const Vec3& away) noexcept {
    if (open_side_ != 0.0 || code == surface::kNoNormal) return;
    open_side_ = surface::decode_normal(code).dot(away) < 0.0 ? -1.0 : 1.0;
  }
  /// +1 or -1: what the stored normal is multiplied by to point out.
  [[nodiscard]] double sign(surface::NormalCode code) const noexcept {
    return surface::is_one_sided(code) || open_side_ >= 0.0 ? 1.0 : -1.0;
  }
  /// Unit, or zero where the point has no plane.
  [[nodiscard]] Vec3 normal(surface::NormalCode code) const noexcept {
    return code == surface::kNoNormal ? Vec3(Vec3::Zero()) : Vec3(sign(code) * surface::decode_normal(code));
  }

 private:
  double open_side_ = 0.0;  ///< 0: not chosen
};

}  // namespace palpate::baselines
