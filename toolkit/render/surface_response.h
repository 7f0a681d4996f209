// Response of a surface: from frictionless contact to force. Texture, then friction, then deformation are
// composed at compile time (sections 3.3.2, 3.5; the order is ours, the literal forms use the thesis's).
// Shared by all point, height-field and mesh renderers but the literal ones.
//
// The contact is a pull from the HIP to the god object, of length d along the surface's normal.
//   texture      carves the surface: d becomes d - r, and the carving's slope turns the force. Together they
//                are the force of the potential k (d - r)^2 / 2, so texture creates no energy.
//   friction     Coulomb's.
//   deformation  softens the spring: figure 46's F_D = (1 - c) F_R. Where it varies along the surface the
//                force has the potential's second part, -q^2/2 grad k: moving onto a stiffer place costs the
//                work that its spring then stores, and does not kick (section 3.3.2.3).
#pragma once

#include <algorithm>

#include <palpate/vec.h>
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

// Coulomb friction: the cone of Harwin and Melder (2002) with an anchor on the surface.
//
// The god object sticks without drift within static x depth of the anchor, else slides at the dynamic
// coefficient, and sticks again only well inside the cone. In slip the tangential force is exactly dynamic x
// the normal force.

/// The anchor kept between frames. Belongs to one contact and thread.
class CoulombFriction {
 public:
  /// A sliding contact sticks again below this share of the sliding pull. The gap stops noise of depth or
  /// position (a few per cent) from switching back and forth. CHAI3D uses the same share.
  static constexpr double kStickShare = 0.6;

  /// The HIP is free.
  void release() noexcept { held_ = false; }

  /// The tangential part of the pull, mm, of a HIP `depth` below the frictionless god object `target`.
  /// Coefficients of static and dynamic friction. O(1), allocates nothing.
  Vec3 apply(double static_coefficient, double dynamic_coefficient, const Vec3& target, const Vec3& normal,
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
    const double slip = dynamic_coefficient * depth;
    if (sliding_ && length < kStickShare * slip) sliding_ = false;
    const double limit = sliding_ ? slip : static_coefficient * depth;
    if (length <= limit) return away;
    sliding_ = true;
    away *= slip / length;
    anchor_ = target + away;
    return away;
  }

 private:
  Vec3 anchor_ = Vec3::Zero();
  bool held_ = false;
  bool sliding_ = false;
};

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
  void release() noexcept { friction_.release(); }

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
    if constexpr ((kFeatures & kFriction) != 0)
      tangential =
          friction_.apply(contact.static_friction, contact.dynamic_friction, target, normal, reached);
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

  CoulombFriction friction_;
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

}  // namespace palpate::render
