// The local model of the mesh renderers: one mesh with its probe, and how a contact with it is read.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <utility>

#include "baselines/renderers/mesh_body.h"
#include "baselines/renderers/vertex_normals.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// Belongs to one thread. Probe: MeshProbe or SphereProbe; which functions it needs is what these two have in
/// common.
template <class Probe>
struct MeshSlot {
  std::unique_ptr<MeshBody> body;
  Probe probe;
  render::SurfaceState state;

  MeshSlot(std::unique_ptr<MeshBody> held, Probe&& made) : body(std::move(held)), probe(std::move(made)) {}

  struct Memory {};
  [[nodiscard]] render::ModelPose& pose() noexcept { return body->pose; }
  [[nodiscard]] const render::ModelPose& pose() const noexcept { return body->pose; }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept {
    return body->mesh().local_box_mm().grown(probe.reach_mm());
  }
  [[nodiscard]] bool touching() const noexcept { return probe.contact(); }
  [[nodiscard]] bool felt(const Vec3& h) const noexcept { return probe.felt(h); }
  [[nodiscard]] Vec3 body_mm() const noexcept { return probe.body_mm(); }
  [[nodiscard]] double skin_mm() const noexcept { return probe.skin_mm(); }
  void restart(const Vec3& h) noexcept {
    probe.reset(h);
    state.release();
  }
  /// Clear of the HIP up to h; its side stays.
  void let_go(const Vec3& h) noexcept {
    probe.start_from(h);
    state.release();
  }
  void release() noexcept { state.release(); }
  /// Up to the frictionless contact, the probe pulled to `goal`.
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& /*memory*/,
                           render::SurfaceContact& contact, render::FrameStatus& status,
                           render::FrameCounters& counters) noexcept {
    const std::uint64_t moves = probe.moves();
    const bool held = probe.update(goal);
    counters.walk_steps += probe.moves() - moves;
    if (probe.bound_hit()) status = render::FrameStatus::kBoundHit;
    if (held) contact = contact_at(h);
    return held;
  }
  /// The surface's own part: the same stage that the point renderers use, composed of what it asks for.
  [[nodiscard]] render::SurfaceAnswer respond(const render::SurfaceContact& contact) noexcept {
    return render::respond_as_asked(state, body->surface, contact, body->mesh().origin_mm());
  }
  void planes_near(const Memory& /*memory*/, const Vec3& at_world, render::JointPlanes& planes,
                   render::FrameCounters& /*counters*/) noexcept {
    probe.planes_near(body->pose.to_local(at_world), body->pose, planes);
  }

 private:
  /// Held: the frictionless contact, with the surface's properties there.
  [[nodiscard]] render::SurfaceContact contact_at(const Vec3& h) noexcept {
    render::SurfaceContact contact;
    contact.hip = h;
    contact.pull =
        (body->geometry->vertex_normals.empty() ? probe.target(h)
                                                : probe.shaded_target(h, body->geometry->vertex_normals)) -
        h;
    const render::SurfaceField& surface = body->surface;
    if ((surface.features & render::kVaried) != 0) {
      read_properties(contact);
      return contact;
    }
    contact.stiffness_n_per_mm = surface.stiffness_n_per_mm;
    contact.static_friction = surface.friction.static_coefficient;
    contact.dynamic_friction = surface.friction.dynamic_coefficient;
    return contact;
  }

  /// Interpolated over the facets that hold the probe, each by its share.
  void read_properties(render::SurfaceContact& contact) const noexcept {
    probe.places([&](std::uint32_t facet, const Vec3& point, double share) {
      const Facet& f = body->mesh().facet(facet);
      std::array<render::PlaceSurface, 3> corner;
      for (std::size_t i = 0; i < 3; ++i) corner[i] = body->surface.of_place[f.vertex[i]];
      const render::FacetStiffness k = render::stiffness_on_facet(
          f.corner[0], f.corner[1], f.corner[2], static_cast<double>(corner[0].stiffness_n_per_mm),
          static_cast<double>(corner[1].stiffness_n_per_mm),
          static_cast<double>(corner[2].stiffness_n_per_mm), point);
      contact.stiffness_n_per_mm += share * k.n_per_mm;
      contact.stiffness_gradient += share * k.gradient;
      const std::array<double, 3> weight = corner_shares(f, point);
      for (std::size_t i = 0; i < 3; ++i) {
        contact.static_friction += share * weight[i] * static_cast<double>(corner[i].static_friction);
        contact.dynamic_friction += share * weight[i] * static_cast<double>(corner[i].dynamic_friction);
      }
    });
  }
};

}  // namespace palpate::baselines
