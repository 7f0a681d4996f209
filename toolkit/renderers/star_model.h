// The local model of `cloud` on stars: one cloud's triangles with the contact of one HIP, and how that is
// read.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "toolkit/deformation/giving_way.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/spread_step.h"
#include "toolkit/render/surface_response.h"
#include "toolkit/stars/star_contact.h"

namespace palpate::render {

/// What is prepared of a cloud, and never changes but where its points move.
struct StarGeometry {
  stars::StarMesh mesh;
  stars::StarTree tree;
  [[nodiscard]] std::size_t bytes() const noexcept { return mesh.bytes() + tree.bytes(); }
};

/// Belongs to one thread. Not moved once its contact is attached.
class StarModel {
  /// Tells the contact of a point that has moved.
  struct Told {
    stars::StarContact* contact;
    void operator()(std::uint32_t place, const Vec3& from, const Vec3& to) const noexcept {
      contact->point_moved(place, from, to);
    }
  };

 public:
  struct Memory {};
  static constexpr bool kComposed = true;

  [[nodiscard]] ModelPose& pose() noexcept { return placed; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return placed; }
  [[nodiscard]] unsigned features() const noexcept { return surface.features; }
  [[nodiscard]] bool moves_by_itself() const noexcept { return giving.moves_by_itself(); }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept { return geometry->tree.box_mm(); }
  [[nodiscard]] bool touching() const noexcept { return contact.contact() || spread.active(); }

  void restart(const Vec3& h) noexcept {
    giving.restart();
    contact.reset(h);
    spread.end();
    release();
  }
  void let_go(const Vec3& h) noexcept {
    contact.start_from(h);
    spread.end();
    release();
  }
  void release() noexcept {
    state.release();
    giving.release();
  }

  template <unsigned kFeatures>
  [[nodiscard, gnu::always_inline]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/,
                                               SurfaceContact& answer, FrameStatus& status,
                                               FrameCounters& counters) noexcept {
    stars::StarCounters work;
    bool held = contact.update(h, work);
    counters.walk_steps += work.moves;
    counters.box_tests += work.tested;
    counters.cells_visited += work.blocks;
    if (contact.bound_hit()) [[unlikely]]
      status = FrameStatus::kBoundHit;
    if (held) read_contact<kFeatures>(h, answer);
    if (contact.corrected_from() != nullptr || spread.active()) [[unlikely]]
      held = spread.answer(h, contact.corrected_from(), held, answer,
                           [&] { read_contact<kFeatures>(h, answer); });
    return held;
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceAnswer respond(const SurfaceContact& at) noexcept {
    return state.respond<kFeatures>(at, surface.texture, placed.origin_mm);
  }
  /// Of the facets that hold the god object of `at`: one, or those of an edge or corner, which is concave
  /// seen from the touched side.
  void planes_near(const Memory& /*memory*/, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept {
    const Vec3 at = placed.to_local(at_world);
    add_planes({contact.stand(), contact.side()}, at, planes, counters);
    for (const stars::StarContact::Held& held : contact.others()) add_planes(held, at, planes, counters);
  }

  void before_frame(FrameCounters& /*counters*/) noexcept {
    if (giving.take_moves(Told{&contact})) points_moved();
  }
  /// After a frame's force is answered: the surface gives way where it is pressed deeper than it bears. False
  /// where it left the box that it was prepared in.
  [[nodiscard]] bool after_frame(const SurfaceContact& at, double dt_s) noexcept {
    if (!giving.has_to(at.pull.norm())) return true;
    const Vec3 god_object = at.hip + at.pull;
    const std::uint32_t place = contact.facet().place[nearest_corner(god_object)];
    const Vec3 outward = contact.side() * giving.normal_around(place, god_object);
    const bool kept = giving.press(place, god_object, outward, at.pull.dot(outward), dt_s);
    points_moved();
    return kept;
  }
  /// Between two frames: the last touch's changes, or all of them, are taken back, by change(told) of the
  /// deformer. A HIP that rests meets what moves back on to it; what friction held was a place that is gone.
  template <class Change>
  void put_back(FrameCounters& /*counters*/, Change&& change) noexcept {
    change(Told{&contact});
    points_moved();
    state.release();
  }

  std::shared_ptr<const StarGeometry> geometry;
  std::shared_ptr<StarGeometry> moving;  ///< where points may move: the same, this renderer's own
  stars::StarContact contact;
  SpreadStep spread;
  SurfaceField surface;  ///< by place
  SurfaceState state;
  ModelPose placed;  ///< where it stands
  GivingWay giving;

 private:
  void add_planes(stars::StarContact::Held held, const Vec3& at, JointPlanes& planes,
                  FrameCounters& counters) const noexcept {
    int moves = stars::kMaxFacetMoves;
    (void)stars::descend(geometry->mesh, at, held.stand, moves);
    counters.walk_steps += static_cast<std::uint64_t>(stars::kMaxFacetMoves - moves);
    stars::for_facets_at(geometry->mesh, held.stand, [&](const stars::Facet& facet) noexcept {
      const Vec3 normal = facet.area_normal();
      const double size = normal.norm();
      if (!(size > 0.0)) return;
      const Vec3 n = placed.direction_to_world(normal * (held.side / size));
      planes.add({n, n.dot(placed.to_world(held.stand.foot.point))});
    });
  }
  void points_moved() noexcept {
    contact.points_moved([this](std::uint32_t place) noexcept { return giving.deformer()->standing(place); });
  }
  [[nodiscard]] std::size_t nearest_corner(const Vec3& at) const noexcept {
    const stars::Facet& facet = contact.facet();
    std::size_t nearest = 0;
    for (std::size_t i = 1; i < 3; ++i)
      if ((facet.corner[i] - at).squaredNorm() < (facet.corner[nearest] - at).squaredNorm()) nearest = i;
    return nearest;
  }
  template <unsigned kFeatures>
  void read_contact(const Vec3& h, SurfaceContact& at) const noexcept {
    at.hip = h;
    at.pull = contact.pull();
    if constexpr ((kFeatures & kVaried) != 0) {
      if (!surface.of_place.empty()) {
        read_properties(h, at);
        return;
      }
    }
    at.stiffness_n_per_mm = surface.stiffness_n_per_mm;
    at.static_friction = surface.friction.static_coefficient;
    at.dynamic_friction = surface.friction.dynamic_coefficient;
  }
  /// Stiffness linear over the facet, friction that of the nearest corner.
  void read_properties(const Vec3& h, SurfaceContact& at) const noexcept {
    const stars::Facet& facet = contact.facet();
    const Vec3 g = h + at.pull;
    std::array<double, 3> k;
    for (std::size_t i = 0; i < 3; ++i)
      k[i] = static_cast<double>(surface.of_place[facet.place[i]].stiffness_n_per_mm);
    const FacetStiffness stiffness =
        stiffness_on_facet(facet.corner[0], facet.corner[1], facet.corner[2], k[0], k[1], k[2], g);
    const PlaceSurface& here = surface.of_place[facet.place[nearest_corner(g)]];
    at.stiffness_n_per_mm = stiffness.n_per_mm;
    at.stiffness_gradient = stiffness.gradient;
    at.static_friction = static_cast<double>(here.static_friction);
    at.dynamic_friction = static_cast<double>(here.dynamic_friction);
  }
};

}  // namespace palpate::render
