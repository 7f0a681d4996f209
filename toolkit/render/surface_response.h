// Response of a surface: from frictionless contact to force. Texture, then friction, then deformation are
// composed at compile time (sections 3.3.2, 3.5; the order is ours, the literal forms use the thesis's).
// Shared by all point, height-field and mesh renderers but the literal ones.
//
// The contact is a pull from the HIP to the god object, of length d along the surface's normal.
//   texture      carves the surface: d becomes d - r, and the carving's slope turns the force. Together they
//                are the force of the potential k (d - r)^2 / 2, so texture creates no energy.
//   friction     Coulomb's cone (Harwin and Melder 2002) with an anchor on the surface. The god object
//                sticks without drift within static x d of the anchor, else slides at the dynamic
//                coefficient, and sticks again only well inside the cone. In slip the tangential force is
//                exactly dynamic x the normal force.
//   deformation  softens the spring: figure 46's F_D = (1 - c) F_R. Where it varies along the surface the
//                force has the potential's second part, -q^2/2 grad k: moving onto a stiffer place costs the
//                work that its spring then stores, and does not kick (section 3.3.2.3).
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <palpate/vec.h>
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

/// A sliding contact sticks again below this share of the sliding pull. The gap stops noise of depth or
/// position (a few per cent) from switching back and forth. CHAI3D uses the same share.
inline constexpr double kStickShare = 0.6;

/// A frictionless contact, in any frame of reference, mm.
struct SurfaceContact {
  Vec3 hip = Vec3::Zero();
  Vec3 pull = Vec3::Zero();  ///< to the god object, along the outward normal
  double stiffness_n_per_mm = 0.0;
  Vec3 stiffness_gradient = Vec3::Zero();  ///< along the surface, N/mm per mm; read with kVaried
  double static_friction = 0.0;            ///< read with kFriction
  double dynamic_friction = 0.0;
};

struct SurfaceResponse {
  Vec3 force_n = Vec3::Zero();
  Vec3 god_object_mm = Vec3::Zero();
};

/// The friction state kept between frames. Belongs to one thread.
class SurfaceState {
 public:
  /// The HIP is free.
  void release() noexcept { held_ = false; }

  /// Computes the response. `texture_origin` is added to a place for the texture look-up. O(1), allocates
  /// nothing.
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact, const surface::Texture& texture,
                                        const Vec3& texture_origin) noexcept {
    if constexpr (kFeatures == 0)
      return {contact.stiffness_n_per_mm * contact.pull, contact.hip + contact.pull};
    Vec3 pull = contact.pull;   // becomes the normal part
    Vec3 extra = Vec3::Zero();  // force besides the spring's, per stiffness
    const double depth = pull.norm();
    const Vec3 target = contact.hip + pull;
    const Vec3 normal = depth > 0.0 ? Vec3(pull / depth) : Vec3(Vec3::Zero());
    double reached = depth;  // depth into the carved surface
    if constexpr ((kFeatures & kTexture) != 0)
      reached = apply_texture(texture, target + texture_origin, normal, pull, extra);
    Vec3 tangential = Vec3::Zero();
    if constexpr ((kFeatures & kFriction) != 0) tangential = apply_friction(contact, target, normal, reached);
    const Vec3 spring = pull + tangential;
    Vec3 force = contact.stiffness_n_per_mm * (spring + extra);
    if constexpr ((kFeatures & kVaried) != 0)
      force -= (0.5 * spring.squaredNorm()) * contact.stiffness_gradient;
    return {force, contact.hip + spring};
  }

 private:
  /// Shortens the pull by the carving; returns the remaining depth.
  static double apply_texture(const surface::Texture& texture, const Vec3& place, const Vec3& normal,
                              Vec3& pull, Vec3& extra) noexcept {
    const double depth = pull.norm();
    const surface::Relief relief = texture.at(place, normal);
    const Vec3 slope = relief.slope - normal * normal.dot(relief.slope);
    if (texture.effect == surface::TextureEffect::kForce) {
      const Vec3 turned = normal + slope;
      const double size = turned.norm();
      extra = size > 0.0 ? Vec3(turned * (depth / size) - pull) : Vec3(Vec3::Zero());
      return depth;
    }
    const double left = depth - relief.depth_mm;
    if (!(left > 0.0)) {
      pull = Vec3::Zero();
      return 0.0;
    }
    pull = normal * left;
    extra = slope * left;
    return left;
  }

  /// The tangential part of the pull.
  Vec3 apply_friction(const SurfaceContact& contact, const Vec3& target, const Vec3& normal,
                      double depth) noexcept {
    if (!held_) {
      held_ = true;
      sliding_ = false;
      anchor_ = target;
      return Vec3::Zero();
    }
    Vec3 away = anchor_ - target;
    away -= normal * normal.dot(away);
    const double length = away.norm();
    const double slip = contact.dynamic_friction * depth;
    if (sliding_ && length < kStickShare * slip) sliding_ = false;
    const double limit = sliding_ ? slip : contact.static_friction * depth;
    if (length <= limit) return away;
    sliding_ = true;
    away *= slip / length;
    anchor_ = target + away;
    return away;
  }

  Vec3 anchor_ = Vec3::Zero();
  bool held_ = false;
  bool sliding_ = false;
};

/// Dispatches on `surface`'s features at run time, for renderers that are not templates over them. O(1),
/// allocates nothing.
[[nodiscard]] inline SurfaceResponse respond_for_features(SurfaceState& state, const SurfaceField& surface,
                                                          const SurfaceContact& contact,
                                                          const Vec3& texture_origin) noexcept {
  static_assert(kSurfaceFeatures == 8);
  const surface::Texture& texture = surface.texture;
  switch (surface.features) {
    case 0:
      return state.respond<0>(contact, texture, texture_origin);
    case 1:
      return state.respond<1>(contact, texture, texture_origin);
    case 2:
      return state.respond<2>(contact, texture, texture_origin);
    case 3:
      return state.respond<3>(contact, texture, texture_origin);
    case 4:
      return state.respond<4>(contact, texture, texture_origin);
    case 5:
      return state.respond<5>(contact, texture, texture_origin);
    case 6:
      return state.respond<6>(contact, texture, texture_origin);
    default:
      return state.respond<7>(contact, texture, texture_origin);
  }
}

/// A contact with uniform properties.
[[nodiscard]] inline SurfaceContact uniform_contact(const SurfaceField& surface, const Vec3& hip,
                                                    const Vec3& pull) noexcept {
  SurfaceContact contact;
  contact.hip = hip;
  contact.pull = pull;
  contact.stiffness_n_per_mm = surface.stiffness_n_per_mm;
  contact.static_friction = surface.friction.static_coefficient;
  contact.dynamic_friction = surface.friction.dynamic_coefficient;
  return contact;
}

/// The stiffness at a place of a facet and its gradient along it, linear between the corners.
struct FacetStiffness {
  double n_per_mm = 0.0;
  Vec3 gradient = Vec3::Zero();
};
[[nodiscard]] inline FacetStiffness stiffness_on_facet(const Vec3& a, const Vec3& b, const Vec3& c, double ka,
                                                       double kb, double kc, const Vec3& at) noexcept {
  if (kb == ka && kc == ka) return {ka, Vec3::Zero()};
  const FacetPlane plane = facet_plane(a, b, c);
  if (!plane.usable) return {ka, Vec3::Zero()};
  const Vec3& n = plane.scaled_normal;
  const Vec3 gradient = ((kb - ka) * (c - a).cross(n) + (kc - ka) * n.cross(b - a)) / plane.area_sq;
  const double value = ka + gradient.dot(at - a);
  // Clamps to the corners' range beyond the facet.
  const double low = std::min({ka, kb, kc}), high = std::max({ka, kb, kc});
  if (value < low) return {low, Vec3::Zero()};
  if (value > high) return {high, Vec3::Zero()};
  return {value, gradient};
}

// Spreads jumps of the god object over several frames, so that a hand feels no step: corrections of the held
// place, also those that release or catch the HIP, slips over edges, a coarser surface that takes over.

/// Belongs to one contact. A pull that changes in a frame by a kFrames-th of itself and by kFaster times the
/// HIP's motion jumps; one of a free HIP is zero. It then changes by at most that share and the HIP's motion
/// a frame: of 1 mm at 0.5 N/mm by 0.025 N, a twentieth of a noticeable kick, and is there within a hand's
/// reaction time. Beside a rounded edge of radius r a pull changes kFaster times as fast as a HIP 2/3 r deep;
/// it jumps at r.
class CorrectionRamp {
 public:
  static constexpr int kFrames = 20;
  static constexpr double kFaster = 2.0;

  /// Forgets the contact.
  void end() noexcept {
    last_h_ = Vec3::Constant(kNowhere);
    active_ = false;
  }
  [[nodiscard]] bool active() const noexcept { return active_; }
  /// The surface came or went: what that changes is no jump, and may lengthen the pull.
  void surface_moved() noexcept {
    if (active_)
      grows_ = true;
    else
      last_h_ = Vec3::Constant(kNowhere);
  }
  /// Changes `contact`'s pull at h, which `read()` fills when nothing but the ramp holds the HIP. False if
  /// nothing is felt. Call it in every frame.
  template <class Read>
  [[nodiscard, gnu::always_inline]] bool answer(const Vec3& h, bool held, SurfaceContact& contact,
                                                Read&& read) noexcept {
    const Vec3 pull = held ? contact.pull : Vec3(Vec3::Zero()), motion = h - last_h_, change = pull - pull_;
    const double faster_sq = kFaster * kFaster * motion.squaredNorm();
    const Vec3 last = pull_;
    pull_ = pull;
    last_h_ = h;
    if (!(change.squaredNorm() > faster_sq) && !active_) [[likely]] {
      held_ = held;
      return held;
    }
    spread(motion, last, held);
    if (!active_) return held;
    if (!held) read();
    contact.pull = shown_;
    return true;
  }

 private:
  /// Makes `shown_` the pull to be felt while active. `last`: the contact's own pull of the last frame.
  [[gnu::noinline]] void spread(const Vec3& motion, const Vec3& last, bool held) noexcept {
    const Vec3 change = pull_ - last;
    const double wanted = pull_.norm();
    const bool was_held = std::exchange(held_, held);
    const bool jumped =
        change.norm() > kFaster * motion.norm() && change.norm() * kFrames > std::max(wanted, last.norm());
    if (!active_ && !jumped) return;
    Vec3 moved = motion;
    if (jumped && !active_) {
      shown_ = last - motion;
      rate_ = 0.0;
      moved = Vec3::Zero();
      grows_ = !was_held;
      active_ = true;
    }
    const double length = shown_.norm();
    if (jumped) rate_ = std::max(rate_, (grows_ ? wanted : length) / kFrames);
    // The ramp never moves the god object farther from the HIP, so it creates no energy, and a jumping HIP
    // drags no spring along. A farther target waits for the hand to go there. A HIP found behind a surface is
    // held with a growing pull.
    const double before_now = std::min((shown_ - moved).norm(), std::max(length, wanted));
    const double most = grows_ ? std::max(before_now, wanted) : before_now;
    const Vec3 way = pull_ - shown_;
    const double left = way.norm(), step = rate_ + moved.norm();
    shown_ = left > step ? Vec3(shown_ + way * (step / left)) : pull_;
    const double size = shown_.norm();
    if (size > most) shown_ *= most / size;
    active_ = left > step || wanted > most;
  }

  /// A place so far from any HIP that the first frame's motion allows every pull.
  static constexpr double kNowhere = std::numeric_limits<double>::max();

  bool held_ = false, active_ = false;
  bool grows_ = false;                                            ///< the hold is growing
  Vec3 pull_ = Vec3::Zero(), last_h_ = Vec3::Constant(kNowhere);  ///< the contact's own, of the last frame
  Vec3 shown_ = Vec3::Zero();                                     ///< the last pull felt
  double rate_ = 0.0;                                             ///< of the jump, mm a frame
};

}  // namespace palpate::render
