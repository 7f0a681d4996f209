#include "toolkit/depth_surface/depth_contact.h"

#include <algorithm>
#include <cmath>

#include "toolkit/depth_surface/depth_fusion.h"
#include "toolkit/geometry/god_object_check.h"

namespace palpate::depth_surface {

using namespace render;

namespace {

/// A move shorter than this share of a pixel is none: 2e-3 mm at 1 m, a thousandth of a newton at 0.5 N/mm.
constexpr double kArrivedPixels = 0x1p-10;

/// The part carried along the surface shrinks to this share of the depth, so that it ends with the contact.
constexpr double kMostAlong = 0.5;

/// A surface that the camera sees holds the HIP if it is nearer than this share of what holds it, as nothing
/// that is convex could, and faces the same way within 60 degrees.
constexpr double kMuchNearer = 0.5, kSameWay = 0.5;

/// A god object moves as the HIP does, and up to twice as fast at a depth of half the surface's radius.
constexpr double kFollowedWay = 2.0;

/// The mean age of a surface between its image and the next: what moves is felt as it was so long before.
constexpr double kMeanAgePeriods = 0.5;

double pixel_mm(const DepthSheets& sheets, const Vec3& q) noexcept {
  return q.z() / sheets.fx;
}

}  // namespace

void DepthContact::release(const Vec3& hip) noexcept {
  state_ = State::kFree;
  started_ = is_finite(hip);
  last_ = hip;
  drift_ = velocity_ = pull_ = Vec3::Zero();
  sides_ = {};
  // Looks again from there, also where the surface stays the same.
  image_ = 0;
}

bool DepthContact::step(const DepthSheets& sheets, bool swapped, const Vec3& hip, double dt_s, Vec3& pull,
                        FrameStatus& status, FrameCounters& counters) noexcept {
  if (sheets.image == 0) {
    release(hip);
    return false;
  }
  if (!started_) release(hip);
  if (swapped || image_ != sheets.image) swap(sheets, status, counters);
  started_ = true;
  since_s_ += dt_s;
  drift_ = drift();
  const Vec3 h = hip - drift_;
  if (state_ == State::kFree) enter(sheets, h, counters);
  bool held = false;
  if (state_ == State::kHeld) held = hold(sheets, h, dt_s, status, counters);
  if (state_ == State::kLeaving) held = fade_out(sheets, h, dt_s);
  last_ = h;
  pull = pull_;
  return held;
}

/// The speed of what stands behind the place or there.
Vec3 DepthContact::velocity_at(const DepthSheets& sheets, const Vec3& place) const noexcept {
  const Vec3 q = sheets.to_camera(place);
  const DepthPlace at = sheets.place(q);
  const double w = at.pixel != 0 ? sheets.value(0, at.pixel) : 0.0;
  if (!(w > 0.0) || 1.0 / q.z() < w - sheets.reach(w, 1.0) - w * w * kFastestMmPerS * period_s_)
    return Vec3::Zero();
  const Vec3 velocity = sheets.camera_from_local.transpose() *
                        (q * (static_cast<double>(-sheets.rate[at.pixel]) / (q.z() * w * w)));
  const double speed = velocity.norm();
  return speed > most_mm_per_s_ ? Vec3(velocity * (most_mm_per_s_ / speed)) : velocity;
}

Vec3 DepthContact::drift() const noexcept {
  return velocity_ * (std::min(since_s_, period_s_) - kMeanAgePeriods * period_s_);
}

/// Takes a new surface at the last frame's HIP, held or overtaken by it.
void DepthContact::swap(const DepthSheets& sheets, FrameStatus& status, FrameCounters& counters) noexcept {
  const double images =
      image_ == 0 ? 0.0 : std::min(static_cast<double>(sheets.image - image_), kStalledPeriods);
  if (image_ != sheets.image) since_s_ = 0.0;  // else the rest of an image whose window was felt
  image_ = sheets.image;
  const double fastest = kFastestMmPerS * period_s_ * images;
  const Vec3 drifted = drift_;
  velocity_ = velocity_at(sheets, last_ + drifted + pull_);
  drift_ = drift();
  last_ += drifted - drift_;
  const Vec3 q = sheets.to_camera(last_);
  if (state_ != State::kFree) {
    const Vec3 before = last_ + pull_ - carried_, plane = god_ + drifted - drift_, outward = outward_;
    god_ = before;
    const bool found = descend(sheets, q, fastest, status, counters) != Descent::kNone;
    // A leaving contact is caught again by a surface over the HIP only.
    if (found && (state_ == State::kHeld || (god_ - last_).dot(outward_) > 0.0)) {
      state_ = State::kHeld;
      carry(god_ - before, 0.0, 0.0);
      return;
    }
    outward_ = outward;
    god_ = plane;
    return leave();
  }
  cross(sheets, q, 1.0, fastest);
}

/// Contact begins where q is behind a surface that the HIP was in front of, the same up to `pixels` of its
/// steepest slope and `slack` mm along the line of sight.
bool DepthContact::cross(const DepthSheets& sheets, const Vec3& q, double pixels, double slack) noexcept {
  const DepthPlace at = sheets.place(q);
  const Sides now = sides_at(sheets, q);
  for (const Side& before : sides_) {
    if (!before.front || at.pixel == 0) continue;
    const int layer =
        sheets.layer_near(at.pixel, before.w, before.w * before.w * slack + sheets.reach(before.w, pixels));
    if (layer < 0 || now[static_cast<std::size_t>(layer)].front) continue;
    state_ = State::kHeld;
    god_ = sheets.to_local(q * (1.0 / (q.z() * now[static_cast<std::size_t>(layer)].w)));
    pull_ = carried_ = Vec3::Zero();
    return true;
  }
  sides_ = now;
  return false;
}

DepthContact::Sides DepthContact::sides_at(const DepthSheets& sheets, const Vec3& q) noexcept {
  Sides sides;
  const DepthPlace at = sheets.place(q);
  if (at.pixel == 0) return sides;
  for (int layer = 0; layer < DepthSheets::kLayers; ++layer) {
    Side& side = sides[static_cast<std::size_t>(layer)];
    side.w = sheets.value(layer, at.pixel);
    if (!(side.w > 0.0)) continue;
    // Farther than a pixel's steepest slope the sign needs no spline.
    const double off = 1.0 / q.z() - side.w;
    side.front =
        std::abs(off) > sheets.reach(side.w, 1.0) ? off > 0.0 : sheets.plane(at, layer).field(q) >= 0.0;
  }
  return sides;
}

/// The free HIP's way from the last frame, pixel by pixel: contact begins where it goes behind a surface that
/// it was in front of.
void DepthContact::enter(const DepthSheets& sheets, const Vec3& hip, FrameCounters& counters) noexcept {
  const Vec3 a = sheets.to_camera(last_), b = sheets.to_camera(hip);
  const DepthPlace from = sheets.place(a), to = sheets.place(b);
  const double pixels = std::max(std::abs(to.u - from.u), std::abs(to.v - from.v));
  const int samples =
      pixels < kMaxDepthSamples ? std::max(1, static_cast<int>(std::ceil(pixels))) : kMaxDepthSamples;
  for (int k = 1; k <= samples; ++k) {
    ++counters.cells_visited;
    if (cross(sheets, a + (b - a) * (static_cast<double>(k) / samples), std::max(1.0, pixels / samples), 0.0))
      return;
  }
}

/// Moves the god object to the surface's nearest place: onto the tangent plane under it, again and again, no
/// farther than its sheet goes. `slack`: mm that the surface may have come nearer or gone.
DepthContact::Descent DepthContact::descend(const DepthSheets& sheets, const Vec3& hip, double slack,
                                            FrameStatus& status, FrameCounters& counters) noexcept {
  Vec3 god = sheets.to_camera(god_), good = god, normal = Vec3::Zero();
  DepthPlace last;
  double last_w = 1.0 / god.z();
  Vec3 step = Vec3::Zero();
  double part = 1.0, good_sq = 0.0;
  bool any = false, rim = false;
  for (int move = 0;; ++move) {
    const DepthPlace at = sheets.place(god);
    int layer = -1;
    if (at.pixel != 0) {
      const double pixels = any ? std::max({1.0, std::abs(at.u - last.u), std::abs(at.v - last.v)}) : 1.0;
      layer = sheets.layer_near(at.pixel, last_w,
                                sheets.reach(last_w, pixels) + (any ? 0.0 : last_w * last_w * slack));
    }
    if (layer < 0) {
      if (!any) return Descent::kNone;
      if (move >= kMaxDepthMoves) break;
      rim = true;
      god = 0.5 * (god + good);
      continue;
    }
    const DepthPlane plane = sheets.plane(at, layer);
    const double along = plane.normal.dot(god);
    if (!(along > 0.0)) {
      if (!any) return Descent::kNone;
      break;
    }
    const Vec3 there = god / along;
    const double there_sq = (hip - there).squaredNorm();
    if (any && !(there_sq < good_sq)) {
      // Deeper than the radius of a hollow a whole step goes too far.
      if (move >= kMaxDepthMoves) break;
      part *= 0.5;
      god = good + part * step;
      continue;
    }
    any = true;
    last = at;
    last_w = sheets.value(layer, at.pixel);
    normal = plane.normal;
    good = there;
    good_sq = there_sq;
    if (rim) break;
    ++counters.walk_steps;
    const Vec3 next = hip + normal * (plane.field(hip) / normal.squaredNorm());
    step = next - good;
    god = good + part * step;
    const double moved = part * step.norm(), pixel = pixel_mm(sheets, good);
    if (moved <= kArrivedPixels * pixel) {
      good = god;
      break;
    }
    if (move >= kMaxDepthMoves) {
      if (moved > pixel) status = FrameStatus::kBoundHit;
      break;
    }
  }
  god_ = sheets.to_local(good);
  outward_ = sheets.camera_from_local.transpose() * (-normal.normalized());
  return rim ? Descent::kAtRim : Descent::kArrived;
}

/// A held frame. The surface in the HIP's pixel bounds the hold: in front of it the HIP is free, and much
/// less deep behind it, it is held there instead. A sheet that ends where something stands before the HIP
/// holds it by its rim, as that thing would.
bool DepthContact::hold(const DepthSheets& sheets, const Vec3& hip, double dt_s, FrameStatus& status,
                        FrameCounters& counters) noexcept {
  const Vec3 q = sheets.to_camera(hip), god_before = last_ + pull_ - carried_;
  const Descent end = descend(sheets, q, 0.0, status, counters);
  if (end == Descent::kNone) {
    leave();
    return false;
  }
  carry(god_ - god_before, kFollowedWay * (hip - last_).norm(), dt_s);
  const DepthPlace at = sheets.place(q);
  const bool known = at.pixel != 0 && sheets.value(0, at.pixel) > 0.0;
  double above = 0.0;
  Vec3 facing = Vec3::Zero();
  if (known) {
    const DepthPlane plane = sheets.plane(at, 0);
    above = plane.field(q) / plane.normal.norm();
    facing = sheets.camera_from_local.transpose() * (-plane.normal.normalized());
  }
  const double away = (god_ - hip).norm();
  const bool nearer = above < 0.0 && -above < kMuchNearer * away && facing.dot(outward_) > kSameWay;
  if (end == Descent::kAtRim && above < 0.0 && away > 0.0) outward_ = (god_ - hip) / away;
  const double risen = carried_.dot(outward_), depth = (god_ - hip).dot(outward_);
  if (depth + risen > 0.0) {
    const bool seen = above > std::max(0.0, risen) + geometry::kOutsideSpacings * pixel_mm(sheets, q);
    if (seen || (end == Descent::kAtRim && !known)) {
      leave();
      return false;
    }
    if (nearer) {
      const Vec3 there = hip - above * facing;
      carry(there - god_, 0.0, 0.0);
      god_ = there;
      outward_ = facing;
    }
    const Vec3 pull = god_ - hip + carried_;
    const double deep = std::max(0.0, pull.dot(outward_));
    const Vec3 along = pull - outward_ * deep;
    const double size = along.norm(), most = std::max(kMostAlong * deep, size - most_mm_per_s_ * dt_s);
    pull_ = size > most ? Vec3(pull - along * (1.0 - most / size)) : pull;
    carried_ = pull_ - (god_ - hip);
    return true;
  }
  if (pull_.norm() > most_mm_per_s_ * dt_s + (hip - last_).norm()) {
    leave();
    return false;
  }
  if (depth > 0.0) {
    // Out of the felt surface, behind the newest: where that comes from, it is felt anew.
    carried_ = hip - god_;
    carried_mm_per_s_ = std::clamp(carried_.norm() / period_s_, carried_mm_per_s_, most_mm_per_s_);
    pull_ = Vec3::Zero();
    return false;
  }
  state_ = State::kFree;
  pull_ = Vec3::Zero();
  sides_ = sides_at(sheets, q);
  return false;
}

/// Carries what the god object moved beyond `followed` mm.
void DepthContact::carry(const Vec3& moved, double followed, double dt_s) noexcept {
  const double before = carried_.norm(), less = carried_mm_per_s_ * dt_s, size = moved.norm();
  carried_ = before > less ? Vec3(carried_ * (1.0 - less / before)) : Vec3(Vec3::Zero());
  if (!(before > less)) carried_mm_per_s_ = 0.0;
  if (!(size > followed)) return;
  carried_ -= moved * (1.0 - followed / size);
  carried_mm_per_s_ = std::min(std::max(carried_mm_per_s_, carried_.norm() / period_s_), most_mm_per_s_);
}

/// Keeps the plane that was felt last.
void DepthContact::leave() noexcept {
  if (state_ == State::kLeaving) return;
  state_ = State::kLeaving;
  const double depth = pull_.norm();
  share_ = depth > 0.0 ? 1.0 : 0.0;
  god_ = last_ + pull_;
  if (depth > 0.0) outward_ = pull_ / depth;
  carried_ = Vec3::Zero();
}

bool DepthContact::fade_out(const DepthSheets& sheets, const Vec3& hip, double dt_s) noexcept {
  share_ -= dt_s / kReleaseSeconds;
  const double depth = (god_ - hip).dot(outward_);
  if (share_ > 0.0 && depth > 0.0) {
    pull_ = outward_ * (depth * share_);
    return true;
  }
  state_ = State::kFree;
  pull_ = Vec3::Zero();
  sides_ = sides_at(sheets, sheets.to_camera(hip));
  return false;
}

}  // namespace palpate::depth_surface
