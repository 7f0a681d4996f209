// The local model of `cloud`: everything a frame knows of one cloud, and how a contact with it is read: the
// pull to the surface, the plane there, the properties.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <span>

#include "toolkit/deformation/deformer.h"
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
  [[nodiscard]] bool moves_by_itself() const noexcept { return moves != nullptr; }
  [[nodiscard]] const geometry::Aabb& box_mm() const noexcept { return prepared_box_mm; }
  [[nodiscard]] bool touching() const noexcept { return contact.contact(); }

  void restart(const Vec3& h) noexcept {
    if (deformer != nullptr) deformer->reset();
    contact.reset(h);
    release();
  }
  void let_go(const Vec3& h) noexcept {
    contact.start_from(h);
    release();
  }
  void release() noexcept {
    state.release();
    pressed = false;
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
  void before_frame(FrameCounters& counters) noexcept { take_moves(counters); }
  [[nodiscard]] bool after_frame(const SurfaceContact& at, double dt_s) noexcept {
    return give_way(at, dt_s);
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
  std::unique_ptr<Deformer> deformer;  ///< null: the geometry stays
  surface::Dent dent;
  std::shared_ptr<MoveReader> moves;  ///< or null
  bool pressed = false;               ///< in contact in the last frame: the stroke goes on
  geometry::Aabb prepared_box_mm;     ///< local, of the prepared points with the reach of their boxes
  Shading shading = Shading::kNone;
  bool by_spacing = false;  ///< shaded only where the spacing is felt
  double felt_spacing_sq_mm2 = 0.0;

 private:
  /// The points that a deformer put somewhere else have been told to the contact: it takes the surface as it
  /// is.
  void points_moved(FrameCounters& counters) noexcept {
    contact.points_moved([&](std::uint32_t place) noexcept { return deformer->standing(place); }, counters);
  }
  void take_moves(FrameCounters& counters) noexcept;
  bool give_way(const SurfaceContact& at, double dt_s) noexcept;
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceContact contact_at(const WalkEnd& end, const Vec3& h) const noexcept;
  [[nodiscard]] geometry::HalfSpace plane_near(std::uint32_t start, const Vec3& at,
                                               FrameCounters& counters) const noexcept;
};

/// Before a frame collides: what a slower deformer has computed is applied, and a resting HIP meets what
/// moved on to it.
inline void CloudModel::take_moves(FrameCounters& counters) noexcept {
  if (moves == nullptr) return;
  const MoveBatch* batch = moves->take();
  if (batch == nullptr) return;
  deformer->apply(*batch);
  for (const Deformer::Moved& moved : deformer->last_moved())
    contact.point_moved(moved.place, moved.from_mm, moved.to_mm, counters);
  points_moved(counters);
}

/// After a frame's force is answered: the surface gives way where it is pressed deeper than it bears. False
/// where it left the box that it was prepared in.
inline bool CloudModel::give_way(const SurfaceContact& at, double dt_s) noexcept {
  if (deformer == nullptr || !dent.any()) return true;
  if (!pressed) deformer->begin_stroke();
  pressed = true;
  const double over = at.pull.norm() - dent.yield_mm;
  if (!(over > 0.0)) return true;
  const std::uint32_t place = contact.sheet().place;
  const double radius_mm =
      std::max(dent.radius_mm, kNarrowestResolutions * deformer->first_resolution_mm(place));
  deformer->press(place, contact.outward(), std::min(over, dent.rate_mm_s * dt_s), radius_mm,
                  kDeepestPerRadius);
  contact.gave_way();
  const std::span<const Deformer::Moved> moved = deformer->last_moved();
  return std::all_of(moved.begin(), moved.end(),
                     [&](const Deformer::Moved& m) { return prepared_box_mm.contains(m.to_mm); });
}

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
