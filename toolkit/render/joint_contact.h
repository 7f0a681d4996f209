// Several models touched at once: the god object is the place nearest to the HIP that is outside of all of
// them (the thesis does not say how contacts combine, section 3.3). Each contact becomes its share of the way
// there, along its own surface's normal, and answers for itself.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <utility>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/half_spaces.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/renderer.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Models that are answered together in one frame; of more the deepest, see Touches.
inline constexpr std::size_t kMaxTouched = geometry::kMaxHalfSpaces;
/// Times the planes of models touched together are looked up where the last solution lies: surfaces are not
/// planes, and each time the error that is left is about squared.
inline constexpr int kJointRounds = 3;
/// Planes of one touch, at most: of a corner's facets many may lie in one plane, and none of them may take
/// the place of another touch's.
inline constexpr std::size_t kMaxPlanesATouch = 16;
/// Violation of a plane that rounding may leave, as a share of the coordinates.
inline constexpr double kJointSlack = 64.0 * kUnitRoundoff;

/// The touches of one frame. Where more models are touched than are answered together, the deepest are: they
/// push most, and on the way in a model begins with nothing. Of equally deep ones the first stay. Touch:
/// SurfaceContact contact.
template <class Touch>
class Touches {
 public:
  void clear() noexcept { size_ = 0; }
  /// What the next touch is read into.
  [[nodiscard]] Touch& next() noexcept { return touch_[size_]; }
  /// Takes next() up. False where one had to be left out: that one is next() then.
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

/// The planes of one round, world frame, each with the touch it belongs to. Of too many of one touch the
/// first stay.
class JointPlanes {
 public:
  void clear() noexcept { size_ = begin_ = 0; }
  void begin(std::size_t touch) noexcept {
    touch_ = touch;
    begin_ = size_;
  }
  void add(const geometry::HalfSpace& plane) noexcept {
    if (size_ - begin_ == kMaxPlanesATouch || size_ == plane_.size()) return;
    owner_[size_] = touch_;
    plane_[size_++] = plane;
  }
  [[nodiscard]] std::span<const geometry::HalfSpace> planes() const noexcept {
    return {plane_.data(), size_};
  }
  [[nodiscard]] std::size_t owner(std::size_t i) const noexcept { return owner_[i]; }

 private:
  static constexpr std::size_t kMost = kMaxTouched * kMaxPlanesATouch;
  static_assert(kMost <= geometry::kMostHalfSpaces);
  std::array<geometry::HalfSpace, kMost> plane_;
  std::array<std::size_t, kMost> owner_{};
  std::size_t size_ = 0, begin_ = 0;
  std::size_t touch_ = 0;
};

/// Touch: SurfaceContact contact (local), const ModelPose& pose(). planes_near(touch, at, planes): adds the
/// planes (world) of the touched surface near `at` (world). `skin_mm`: the planes hold the centre of a sphere
/// of that radius, whose skin is the tip; the god object is then so much nearer to the HIP. Returns the place
/// that the planes hold. Allocates nothing.
template <class Touch, class PlanesNear>
Vec3 constrain_jointly(const Vec3& hip_mm, std::span<Touch> touches, PlanesNear&& planes_near,
                       double skin_mm = 0.0) noexcept {
  JointPlanes planes;
  const double slack = kJointSlack * (hip_mm.cwiseAbs().maxCoeff() + touches.front().contact.pull.norm());
  Vec3 at = hip_mm;
  geometry::NearestAllowed found;
  for (int round = 0; round < kJointRounds; ++round) {
    planes.clear();
    for (std::size_t i = 0; i < touches.size(); ++i) {
      planes.begin(i);
      planes_near(touches[i], at, planes);
    }
    found = geometry::nearest_allowed(planes.planes(), hip_mm, slack);
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

/// The sum of what the touches answer; the god object that of the strongest, moved by what all of them move
/// it aside. respond(touch): its SurfaceAnswer, local. Touch as above, with std::int32_t model.
template <class Touch, class Respond>
void add_up(std::span<Touch> touches, Respond&& respond, Frame& frame) noexcept {
  Vec3 force = Vec3::Zero(), aside = Vec3::Zero();
  double strongest = -1.0;
  Vec3 god_object = frame.god_object_mm;
  for (Touch& touch : touches) {
    const ModelPose& pose = touch.pose();
    const SurfaceAnswer answer = respond(touch);
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
