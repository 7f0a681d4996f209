// Contact with several models at once: the god object is the place outside all of them that is nearest to the
// HIP. (The thesis does not say how contacts combine, section 3.3.) Each contact gets its share of the pull
// along its own normal and responds by itself.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>

#include <palpate/renderer.h>
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/half_space_projection.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Models answered together in one frame; with more, the deepest ones (see Touches).
inline constexpr std::size_t kMaxTouched = geometry::kMaxEnumeratedHalfSpaces;
/// Rounds of planes taken at the last solution. Surfaces are curved; each round about squares the remaining
/// error.
inline constexpr int kJointIterations = 3;
/// Most planes of one touch. A corner may have many facets in one plane; the bound protects the other
/// touches' planes.
inline constexpr std::size_t kMaxPlanesPerTouch = 16;
/// Allowed violation of a plane by rounding, as a share of the coordinates.
inline constexpr double kJointSlack = 64.0 * kUnitRoundoff;

/// The touches of one frame. When they are too many it keeps the deepest, which push most; a model just
/// touched starts at zero depth. Ties keep the earlier ones. Touch: SurfaceContact contact.
template <class Touch>
class Touches {
 public:
  void clear() noexcept { size_ = 0; }
  /// The slot for the next touch.
  [[nodiscard]] Touch& next() noexcept { return touch_[size_]; }
  /// Keeps next(). False if one touch was dropped, which is then in next().
  [[nodiscard]] bool keep() noexcept {
    if (size_ < kMaxTouched) {
      ++size_;
      return true;
    }
    Touch* shallowest = touch_.data();
    for (std::size_t i = 1; i < kMaxTouched; ++i)
      if (!(depth_sq(touch_[i]) > depth_sq(*shallowest))) shallowest = &touch_[i];
    if (depth_sq(next()) > depth_sq(*shallowest)) std::swap(*shallowest, next());
    return false;
  }
  [[nodiscard]] std::span<Touch> all() noexcept { return {touch_.data(), size_}; }

 private:
  static double depth_sq(const Touch& touch) noexcept { return touch.contact.pull.squaredNorm(); }

  std::array<Touch, kMaxTouched + 1> touch_;
  std::size_t size_ = 0;
};

/// The planes of one round, world frame, with their touch. Planes beyond a touch's bound are dropped.
class JointPlanes {
 public:
  void clear() noexcept { size_ = begin_ = 0; }
  void begin(std::size_t touch) noexcept {
    touch_ = touch;
    begin_ = size_;
  }
  void add(const geometry::HalfSpace& plane) noexcept {
    if (size_ - begin_ == kMaxPlanesPerTouch || size_ == plane_.size()) return;
    owner_[size_] = touch_;
    plane_[size_++] = plane;
  }
  [[nodiscard]] std::span<const geometry::HalfSpace> planes() const noexcept {
    return {plane_.data(), size_};
  }
  [[nodiscard]] std::size_t owner(std::size_t i) const noexcept { return owner_[i]; }

 private:
  static constexpr std::size_t kMaxPlanes = kMaxTouched * kMaxPlanesPerTouch;
  static_assert(kMaxPlanes <= geometry::kHalfSpaceLimit);
  std::array<geometry::HalfSpace, kMaxPlanes> plane_;
  std::array<std::size_t, kMaxPlanes> owner_{};
  std::size_t size_ = 0, begin_ = 0;
  std::size_t touch_ = 0;
};

/// Solves for the god object that all planes hold, and returns it. Touch: SurfaceContact contact (local),
/// const ModelPose& pose(). planes_near(touch, at, planes) adds the touched surface's planes (world) near
/// `at` (world). With `skin_mm` the planes hold the centre of a sphere of that radius whose skin is the tip;
/// the god object is nearer to the HIP by that much. Allocates nothing.
template <class Touch, class PlanesNear>
Vec3 constrain_jointly(const Vec3& hip_mm, std::span<Touch> touches, PlanesNear&& planes_near,
                       double skin_mm = 0.0) noexcept {
  JointPlanes planes;
  const double slack = kJointSlack * (hip_mm.cwiseAbs().maxCoeff() + touches.front().contact.pull.norm());
  Vec3 at = hip_mm;
  geometry::NearestFeasible found;
  for (int round = 0; round < kJointIterations; ++round) {
    planes.clear();
    for (std::size_t i = 0; i < touches.size(); ++i) {
      planes.begin(i);
      planes_near(touches[i], at, planes);
    }
    found = geometry::nearest_feasible(planes.planes(), hip_mm, slack);
    at = found.point;
  }
  const Vec3 held = at;
  double share = 1.0;
  if (skin_mm > 0.0) {
    const double way = (at - hip_mm).norm();
    share = way > skin_mm ? 1.0 - skin_mm / way : 0.0;
    at = hip_mm + share * (at - hip_mm);
  }
  for (std::size_t i = 0; i < touches.size(); ++i) {
    Vec3 pull = Vec3::Zero();
    for (std::size_t k = 0; k < found.active; ++k)
      if (const std::size_t p = found.plane[k]; planes.owner(p) == i)
        pull += (share * found.push[k]) * planes.planes()[p].normal;
    SurfaceContact& contact = touches[i].contact;
    contact.hip = touches[i].pose().to_local(at - pull);
    contact.pull = touches[i].pose().direction_to_local(pull);
  }
  return held;
}

/// Sums the responses. The god object is that of the strongest touch, shifted by the sum of all shifts.
/// respond(touch): its SurfaceResponse, local. Touch as above, with std::int32_t model.
template <class Touch, class Respond>
void sum_responses(std::span<Touch> touches, Respond&& respond, Frame& frame) noexcept {
  Vec3 force = Vec3::Zero(), aside = Vec3::Zero();
  double strongest = -1.0;
  Vec3 god_object = frame.god_object_mm;
  for (Touch& touch : touches) {
    const ModelPose& pose = touch.pose();
    const SurfaceResponse answer = respond(touch);
    force += pose.direction_to_world(answer.force_n);
    const Vec3 target = touch.contact.hip + touch.contact.pull;
    aside += pose.direction_to_world(answer.god_object_mm - target);
    const double size = answer.force_n.squaredNorm();
    if (size > strongest) {
      strongest = size;
      god_object = pose.to_world(target);
      frame.model = touch.model;
    }
  }
  frame.contact = true;
  frame.god_object_mm = god_object + aside;
  frame.force_n = force;
}

}  // namespace palpate::render
