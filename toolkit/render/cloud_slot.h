// One model of `cloud`, with everything a frame knows of it, and how a contact with it is read: the pull to
// the surface, the plane there, the properties.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>

#include "toolkit/geometry/half_spaces.h"
#include "toolkit/render/crease.h"
#include "toolkit/render/deformer.h"
#include "toolkit/render/point_contact.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Belongs to one thread. The contact points into the model: neither is moved.
struct CloudSlot {
  PointModel model;
  PointContact contact;
  SurfaceState state;
  std::unique_ptr<Deformer> deformer;  ///< null: the geometry stays
  surface::Dent dent;
  std::shared_ptr<MoveQueue> moves;  ///< or null
  bool pressed = false;              ///< in contact in the last frame: the stroke goes on
  Shading shading = Shading::kNone;
  bool by_spacing = false;  ///< shaded only where the spacing is felt
  double felt_spacing_sq_mm2 = 0.0;
};

/// Before a frame collides: what a slower deformer has computed is applied, and a resting HIP meets what
/// moved on to it.
inline void take_moves(CloudSlot& slot, FrameCounters& counters) noexcept {
  if (slot.moves == nullptr) return;
  const MoveBatch* batch = slot.moves->take();
  if (batch == nullptr) return;
  slot.deformer->apply(*batch);
  slot.contact.geometry_changed();
  for (const Deformer::Moved& moved : slot.deformer->last_moved())
    slot.contact.point_moved(moved.place, moved.from_mm, moved.to_mm, counters);
}

/// After a frame's force is answered: the surface gives way where it is pressed deeper than it bears.
inline void give_way(CloudSlot& slot, const SurfaceContact& contact, double dt_s) noexcept {
  if (slot.deformer == nullptr || !slot.dent.any()) return;
  if (!slot.pressed) slot.deformer->begin_stroke();
  slot.pressed = true;
  const double over = contact.pull.norm() - slot.dent.yield_mm;
  if (!(over > 0.0)) return;
  slot.deformer->press(slot.contact.sheet().place, slot.contact.outward(),
                       std::min(over, slot.dent.rate_mm_s * dt_s), slot.dent.radius_mm);
  slot.contact.geometry_changed();
}

/// A model in contact, before it is known what the others do.
struct CloudTouch {
  CloudSlot* slot = nullptr;
  std::int32_t model = -1;
  WalkEnd end;
  SurfaceContact contact;  ///< local
  [[nodiscard]] const ModelPose& pose() const noexcept { return slot->model.pose; }
};

/// The frictionless contact at the walk's end, local.
template <unsigned kFeatures>
[[nodiscard]] inline SurfaceContact contact_at(const CloudSlot& slot, const WalkEnd& end,
                                               const Vec3& h) noexcept {
  const PointModel& model = slot.model;
  const Vec3 g = model.points[end.place].at();
  SurfaceContact contact;
  contact.hip = h;
  contact.pull = g - h;
  NearestTwo two{end.place, end.place};
  const bool varied = (kFeatures & kVaried) != 0 && !model.surface.of_place.empty();
  if (slot.shading != Shading::kNone || varied) {
    two = slot.shading == Shading::kFacet || varied ? enclosing_two(model, end, slot.contact.outward(), h)
                                                    : nearest_two(model, end);
    __builtin_prefetch(&model.neighbours[two.first]);  // where the god object most likely goes next
    const Vec3 b = model.points[two.first].at();
    if (slot.shading != Shading::kNone &&
        (!slot.by_spacing || (b - g).squaredNorm() > slot.felt_spacing_sq_mm2)) {
      const Vec3 c = model.points[two.second].at();
      if (slot.shading == Shading::kFacet) {
        const FacetPlane plane = facet_plane(g, b, c);
        if (plane.usable) {
          const Vec3& n = plane.scaled_normal;
          contact.pull = (contact.pull.dot(n) / plane.area_sq) * n;
          if (at_crease(plane, slot.contact.outward()) && beside(plane, b - g, c - g, h - g)) [[unlikely]]
            contact.pull = pull_at_crease(model, end, slot.contact.outward(), h, contact.pull);
        }
      } else {
        contact.pull = shaded_vector(slot.shading, h, g, b, c);
      }
    }
  }
  if (varied) {
    const PlaceSurface& here = model.surface.of_place[end.place];
    const auto stiffness = [&](std::uint32_t place) {
      return static_cast<double>(model.surface.of_place[place].stiffness_n_per_mm);
    };
    const FacetStiffness k =
        stiffness_on_facet(g, model.points[two.first].at(), model.points[two.second].at(),
                           static_cast<double>(here.stiffness_n_per_mm), stiffness(two.first),
                           stiffness(two.second), h + contact.pull);
    contact.stiffness_n_per_mm = k.n_per_mm;
    contact.stiffness_gradient = k.gradient;
    contact.static_friction = static_cast<double>(here.static_friction);
    contact.dynamic_friction = static_cast<double>(here.dynamic_friction);
  } else {
    contact.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
    contact.static_friction = model.surface.friction.static_coefficient;
    contact.dynamic_friction = model.surface.friction.dynamic_coefficient;
  }
  return contact;
}

/// The surface's plane near a place, looked up from a walk's end without moving the contact: a half space in
/// the world.
[[nodiscard]] inline geometry::HalfSpace plane_near(const CloudSlot& slot, std::uint32_t start,
                                                    const Vec3& at, FrameCounters& counters) noexcept {
  const PointModel& model = slot.model;
  Sheet sheet = slot.contact.sheet();
  sheet.place = start;
  int steps = kMaxWalkSteps;
  const WalkEnd end = follow(model, sheet, at, steps, counters);
  const Vec3 g = model.points[end.place].at();
  Vec3 normal = sheet.outward;
  if (slot.shading != Shading::kNone) {
    const NearestTwo two = enclosing_two(model, end, sheet.outward, at);
    const FacetPlane plane = facet_plane(g, model.points[two.first].at(), model.points[two.second].at());
    if (plane.usable)
      normal = plane.scaled_normal.normalized() * (plane.scaled_normal.dot(sheet.outward) < 0.0 ? -1.0 : 1.0);
  }
  const Vec3 n = model.pose.direction_to_world(normal);
  return {n, n.dot(model.pose.to_world(g))};
}

}  // namespace palpate::render
