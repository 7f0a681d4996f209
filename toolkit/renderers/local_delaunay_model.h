// The local model of `cloud`: the local Delaunay mesh of one cloud, and the contact of one HIP with it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include <palpate/geometry.h>
#include "toolkit/deformation/deformer.h"
#include "toolkit/local_delaunay/mesh_contact.h"
#include "toolkit/render/correction_ramp.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// Prepared data of a cloud; immutable unless its points move.
struct LocalDelaunayGeometry {
  local_delaunay::LocalDelaunayMesh mesh;
  local_delaunay::BlockBvh tree;
  [[nodiscard]] std::size_t bytes() const noexcept { return mesh.bytes() + tree.bytes(); }
};

/// Belongs to one thread. The model stays where it is once its contact is attached.
class LocalDelaunayModel {
  /// Tells the contact of a moved point.
  struct OnMoved {
    local_delaunay::MeshContact* contact;
    void operator()(std::uint32_t place, const Vec3& from, const Vec3& to) const noexcept {
      contact->point_moved(place, from, to);
    }
  };

 public:
  struct Memory {};
  static constexpr bool kTemplatedOnFeatures = true;

  [[nodiscard]] ModelPose& pose() noexcept { return placed; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return placed; }
  [[nodiscard]] unsigned features() const noexcept { return surface.features; }
  [[nodiscard]] bool moves_by_itself() const noexcept { return deformation.moves_by_itself(); }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept { return geometry->tree.box_mm(); }
  [[nodiscard]] bool touching() const noexcept { return contact.contact() || spread.active(); }

  void restart(const Vec3& h) noexcept {
    deformation.restart();
    contact.reset(h);
    spread.end();
    release();
  }
  void release_contact(const Vec3& h) noexcept {
    contact.start_from(h);
    spread.end();
    release();
  }
  void release() noexcept {
    state.release();
    deformation.release();
  }

  template <unsigned kFeatures>
  [[nodiscard, gnu::always_inline]] bool touch(const Vec3& /*goal*/, const Vec3& h, Memory& /*memory*/,
                                               SurfaceContact& answer, FrameStatus& status,
                                               FrameCounters& counters) noexcept {
    local_delaunay::ContactCounters work;
    const bool held = contact.update(h, work);
    counters.walk_steps += work.moves;
    counters.box_tests += work.tested;
    counters.cells_visited += work.blocks;
    if (contact.bound_hit()) [[unlikely]]
      status = FrameStatus::kBoundHit;
    if (held) read_contact<kFeatures>(h, answer);
    return spread.answer(h, held, answer, [&] { read_contact<kFeatures>(h, answer); });
  }
  template <unsigned kFeatures>
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& at) noexcept {
    return state.respond<kFeatures>(at, surface.texture, placed.origin_mm);
  }
  /// The facet that holds the god object of `at`, or those of an edge or corner, which is concave seen from
  /// the touched side.
  void planes_near(const Memory& /*memory*/, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept {
    const Vec3 at = placed.to_local(at_world);
    add_planes({contact.position(), contact.side()}, at, planes, counters);
    for (const local_delaunay::MeshContact::Held& held : contact.others())
      add_planes(held, at, planes, counters);
  }

  void before_frame(FrameCounters& /*counters*/) noexcept {
    if (deformation.take_moves(OnMoved{&contact})) points_moved();
  }
  /// After a frame's force: deforms the surface where it is pressed too deep. False if it left its prepared
  /// box.
  [[nodiscard]] bool after_frame(const SurfaceContact& at, double dt_s) noexcept {
    if (!deformation.must_yield(at.pull.norm())) return true;
    const Vec3 god_object = at.hip + at.pull;
    const std::uint32_t place = contact.facet().place[nearest_corner(god_object)];
    const Vec3 outward = contact.side() * deformation.normal_around(place, god_object);
    const bool kept = deformation.press(place, god_object, outward, at.pull.dot(outward), dt_s);
    points_moved();
    return kept;
  }
  /// Between frames: takes back the last touch's changes, or all, by the deformer's change(on_moved). A
  /// resting HIP meets the surface that returns; the friction anchor is dropped, because its place is gone.
  template <class Change>
  void put_back(FrameCounters& /*counters*/, Change&& change) noexcept {
    change(OnMoved{&contact});
    spread.end();
    points_moved();
    state.release();
  }

  std::shared_ptr<const LocalDelaunayGeometry> geometry;
  std::shared_ptr<LocalDelaunayGeometry> moving;  ///< with moving points: this renderer's own geometry
  local_delaunay::MeshContact contact;
  CorrectionRamp spread;
  SurfaceField surface;  ///< by place
  SurfaceState state;
  ModelPose placed;  ///< its pose
  deformation::DeformationState deformation;

 private:
  void add_planes(local_delaunay::MeshContact::Held held, const Vec3& at, JointPlanes& planes,
                  FrameCounters& counters) const noexcept {
    int moves = local_delaunay::kMaxFacetMoves;
    (void)local_delaunay::descend(geometry->mesh, at, held.position, moves);
    counters.walk_steps += static_cast<std::uint64_t>(local_delaunay::kMaxFacetMoves - moves);
    local_delaunay::for_facets_at(geometry->mesh, held.position,
                                  [&](const local_delaunay::Facet& facet) noexcept {
                                    const Vec3 normal = facet.area_normal();
                                    const double size = normal.norm();
                                    if (!(size > 0.0)) return;
                                    const Vec3 n = placed.direction_to_world(normal * (held.side / size));
                                    planes.add({n, n.dot(placed.to_world(held.position.closest.point))});
                                  });
  }
  void points_moved() noexcept {
    spread.surface_moved();
    contact.points_moved(
        [this](std::uint32_t place) noexcept { return deformation.deformer()->standing(place); });
  }
  [[nodiscard]] std::size_t nearest_corner(const Vec3& at) const noexcept {
    const local_delaunay::Facet& facet = contact.facet();
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
      if (!surface.by_point.empty()) {
        read_properties(h, at);
        return;
      }
    }
    at.stiffness_n_per_mm = surface.stiffness_n_per_mm;
    at.static_friction = surface.friction.static_coefficient;
    at.dynamic_friction = surface.friction.dynamic_coefficient;
  }
  /// Stiffness linear over the facet; friction of the nearest corner.
  void read_properties(const Vec3& h, SurfaceContact& at) const noexcept {
    const local_delaunay::Facet& facet = contact.facet();
    const Vec3 g = h + at.pull;
    std::array<double, 3> k;
    for (std::size_t i = 0; i < 3; ++i)
      k[i] = static_cast<double>(surface.by_point[facet.place[i]].stiffness_n_per_mm);
    const FacetStiffness stiffness =
        stiffness_on_facet(facet.corner[0], facet.corner[1], facet.corner[2], k[0], k[1], k[2], g);
    const PointSurface& here = surface.by_point[facet.place[nearest_corner(g)]];
    at.stiffness_n_per_mm = stiffness.n_per_mm;
    at.stiffness_gradient = stiffness.gradient;
    at.static_friction = static_cast<double>(here.static_friction);
    at.dynamic_friction = static_cast<double>(here.dynamic_friction);
  }
};

}  // namespace palpate::render
