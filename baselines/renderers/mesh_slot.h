// One model of a mesh renderer, with its probe, and how a contact with it is read.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <utility>

#include "baselines/renderers/mesh_body.h"
#include "baselines/renderers/vertex_normals.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// Belongs to one thread. Probe: MeshProbe or SphereProbe; which functions it needs is what these two have in
/// common.
template <class Probe>
struct MeshSlot {
  std::unique_ptr<MeshBody> body;
  Probe probe;
  render::SurfaceState state;
  bool touched = false;  ///< in this frame, in a scene of several

  MeshSlot(std::unique_ptr<MeshBody> held, Probe&& made) : body(std::move(held)), probe(std::move(made)) {}

  void reset(const Vec3& h) noexcept {
    probe.reset(h);
    state.release();
  }

  /// Held: the frictionless contact, with the surface's properties there.
  [[nodiscard]] render::SurfaceContact contact_at(const Vec3& h) noexcept {
    render::SurfaceContact contact;
    contact.hip = h;
    contact.pull =
        (body->vertex_normals.empty() ? probe.target(h) : probe.shaded_target(h, body->vertex_normals)) - h;
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

  /// The surface's own part: the same stage that the point renderers use, composed of what it asks for.
  [[nodiscard]] render::SurfaceAnswer respond(const render::SurfaceContact& contact) noexcept {
    return render::respond_as_asked(state, body->surface, contact, body->mesh.origin_mm());
  }

 private:
  /// Interpolated over the facets that hold the probe, each by its share.
  void read_properties(render::SurfaceContact& contact) const noexcept {
    probe.places([&](std::uint32_t facet, const Vec3& point, double share) {
      const Facet& f = body->mesh.facet(facet);
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

/// A model in contact, before it is known what the others do.
template <class Probe>
struct MeshTouch {
  MeshSlot<Probe>* slot = nullptr;
  std::int32_t model = -1;
  render::SurfaceContact contact;  ///< local
  [[nodiscard]] const render::ModelPose& pose() const noexcept { return slot->body->pose; }
};

}  // namespace palpate::baselines
