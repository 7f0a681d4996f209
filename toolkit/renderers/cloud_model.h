// The local model of `cloud`: everything a frame knows of one cloud, and how a contact with it is read: the
// pull to the surface, the plane there, the properties.
#pragma once

#include <cstdint>

#include "toolkit/deformation/giving_way.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/half_spaces.h"
#include "toolkit/points/crease.h"
#include "toolkit/points/point_contact.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Belongs to one thread. Not moved once its contact is attached: that points into the points.
class CloudModel {
 public:
  using Memory = WalkEnd;
  static constexpr bool kComposed = true;

  [[nodiscard]] ModelPose& pose() noexcept { return body.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body.pose; }
  [[nodiscard]] unsigned features() const noexcept { return body.surface.features; }
  [[nodiscard]] bool moves_by_itself() const noexcept { return giving.moves_by_itself(); }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return prepared_box_mm; }
  [[nodiscard]] bool touching() const noexcept { return contact.contact(); }

  void restart(const Vec3& h) noexcept {
    giving.restart();
    contact.reset(h);
    release();
  }
  void let_go(const Vec3& h) noexcept {
    contact.start_from(h);
    release();
  }
  void release() noexcept {
    state.release();
    giving.release();
  }

  template <unsigned kFeatures>
  [[nodiscard]] bool touch(const Vec3& /*goal*/, const Vec3& h, WalkEnd& end, SurfaceContact& answer,
                           FrameStatus& status, FrameCounters& counters) noexcept {
    const bool held = contact.update(h, end, counters);
    if (contact.bound_hit()) status = FrameStatus::kBoundHit;
    if (held) answer = contact_at<kFeatures>(end, h);
    return held;
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceAnswer respond(const SurfaceContact& at) noexcept {
    return state.respond<kFeatures>(at, body.surface.texture, body.pose.origin_mm);
  }
  void planes_near(const WalkEnd& end, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept {
    planes.add(plane_near(end.place, body.pose.to_local(at_world), counters));
  }
  void before_frame(FrameCounters& counters) noexcept {
    const auto told = [&](std::uint32_t place, const Vec3& from, const Vec3& to) noexcept {
      contact.point_moved(place, from, to, counters);
    };
    if (giving.take_moves(told)) points_moved(counters);
  }
  /// After a frame's force is answered: the surface gives way where it is pressed deeper than it bears. False
  /// where it left the box that it was prepared in.
  [[nodiscard]] bool after_frame(const SurfaceContact& at, double dt_s) noexcept {
    const double depth_mm = at.pull.norm();
    if (!giving.has_to(depth_mm)) return true;
    const std::uint32_t place = contact.sheet().place;
    const bool kept = giving.press(place, body.points->points[place].at(), contact.outward(), depth_mm, dt_s);
    contact.gave_way();
    return kept;
  }

  /// Between two frames: the last touch's changes, or all of them, are taken back, by change(told) of the
  /// deformer. A HIP that rests meets what moves back on to it; what friction held was a place that is gone.
  template <class Change>
  void put_back(FrameCounters& counters, Change&& change) noexcept {
    change([&](std::uint32_t place, const Vec3& from, const Vec3& to) noexcept {
      contact.point_moved(place, from, to, counters);
    });
    points_moved(counters);
    state.release();
  }

  PointBody body;
  PointContact contact;
  SurfaceState state;
  GivingWay giving;
  geometry::Aabb prepared_box_mm;  ///< local, of the prepared points with the reach of their boxes
  Shading shading = Shading::kNone;
  bool by_spacing = false;  ///< shaded only where the spacing is felt
  double felt_spacing_sq_mm2 = 0.0;

 private:
  /// The points that a deformer put somewhere else have been told to the contact: it takes the surface as it
  /// is.
  void points_moved(FrameCounters& counters) noexcept {
    contact.points_moved([&](std::uint32_t place) noexcept { return giving.deformer()->standing(place); },
                         counters);
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceContact contact_at(const WalkEnd& end, const Vec3& h) const noexcept;
  [[nodiscard]] geometry::HalfSpace plane_near(std::uint32_t start, const Vec3& at,
                                               FrameCounters& counters) const noexcept;
};

/// The frictionless contact at the walk's end, local.
template <unsigned kFeatures>
inline SurfaceContact CloudModel::contact_at(const WalkEnd& end, const Vec3& h) const noexcept {
  const PointModel& model = *body.points;
  const Vec3 g = model.points[end.place].at();
  SurfaceContact at;
  at.hip = h;
  at.pull = g - h;
  NearestTwo two{end.place, end.place};
  const bool varied = (kFeatures & kVaried) != 0 && !body.surface.of_place.empty();
  if (shading != Shading::kNone || varied) {
    two = shading == Shading::kFacet || varied ? enclosing_two(model, end, contact.outward(), h)
                                               : nearest_two(model, end);
    __builtin_prefetch(&model.neighbours[two.first]);  // where the god object most likely goes next
    const Vec3 b = model.points[two.first].at();
    if (shading != Shading::kNone && (!by_spacing || (b - g).squaredNorm() > felt_spacing_sq_mm2)) {
      const Vec3 c = model.points[two.second].at();
      if (shading == Shading::kFacet) {
        const FacetPlane plane = facet_plane(g, b, c);
        if (plane.usable) {
          const Vec3& n = plane.scaled_normal;
          at.pull = (at.pull.dot(n) / plane.area_sq) * n;
          if (at_crease(plane, contact.outward()) && beside(plane, b - g, c - g, h - g)) [[unlikely]]
            at.pull = pull_at_crease(model, end, contact.outward(), h, at.pull);
        }
      } else {
        at.pull = shaded_vector(shading, h, g, b, c);
      }
    }
  }
  if (varied) {
    const PlaceSurface& here = body.surface.of_place[end.place];
    const auto stiffness = [&](std::uint32_t place) {
      return static_cast<double>(body.surface.of_place[place].stiffness_n_per_mm);
    };
    const FacetStiffness k =
        stiffness_on_facet(g, model.points[two.first].at(), model.points[two.second].at(),
                           static_cast<double>(here.stiffness_n_per_mm), stiffness(two.first),
                           stiffness(two.second), h + at.pull);
    at.stiffness_n_per_mm = k.n_per_mm;
    at.stiffness_gradient = k.gradient;
    at.static_friction = static_cast<double>(here.static_friction);
    at.dynamic_friction = static_cast<double>(here.dynamic_friction);
  } else {
    at.stiffness_n_per_mm = body.surface.stiffness_n_per_mm;
    at.static_friction = body.surface.friction.static_coefficient;
    at.dynamic_friction = body.surface.friction.dynamic_coefficient;
  }
  return at;
}

/// The surface's plane near a place, looked up from a walk's end without moving the contact: a half space in
/// the world.
inline geometry::HalfSpace CloudModel::plane_near(std::uint32_t start, const Vec3& at,
                                                  FrameCounters& counters) const noexcept {
  const PointModel& model = *body.points;
  Sheet sheet = contact.sheet();
  sheet.place = start;
  int steps = kMaxWalkSteps;
  const WalkEnd end = follow(model, sheet, at, steps, counters);
  const Vec3 g = model.points[end.place].at();
  Vec3 normal = sheet.outward;
  if (shading != Shading::kNone) {
    const NearestTwo two = enclosing_two(model, end, sheet.outward, at);
    const FacetPlane plane = facet_plane(g, model.points[two.first].at(), model.points[two.second].at());
    if (plane.usable)
      normal = plane.scaled_normal.normalized() * (plane.scaled_normal.dot(sheet.outward) < 0.0 ? -1.0 : 1.0);
  }
  const Vec3 n = body.pose.direction_to_world(normal);
  return {n, n.dot(body.pose.to_world(g))};
}

}  // namespace palpate::render
