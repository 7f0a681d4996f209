// Renderer of `mesh-godobject` and `mesh-proxy`: a mesh and a probe per model, constrained jointly with a
// broad phase, as in `cloud`.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/mesh/surface_mesh.h"
#include "baselines/renderers/mesh_body.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// For one thread. Probe: MeshProbe or SphereProbe; it needs the functions that these share.
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
  /// Clear of the HIP up to h; the side stays.
  void release_contact(const Vec3& h) noexcept {
    probe.start_from(h);
    state.release();
  }
  void release() noexcept { state.release(); }
  /// Finds the frictionless contact with the probe pulled to `goal`.
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
  /// Response of the surface, the stage shared with the point renderers.
  [[nodiscard]] render::SurfaceResponse respond(const render::SurfaceContact& contact) noexcept {
    return render::respond_for_features(state, body->surface, contact, body->mesh().origin_mm());
  }
  void planes_near(const Memory& /*memory*/, const Vec3& at_world, render::JointPlanes& planes,
                   render::FrameCounters& /*counters*/) noexcept {
    probe.planes_near(body->pose.to_local(at_world), body->pose, planes);
  }

 private:
  /// Held: the frictionless contact with the surface's properties.
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

  /// Interpolates over the facets that hold the probe, by their shares.
  void read_properties(render::SurfaceContact& contact) const noexcept {
    probe.places([&](std::uint32_t facet, const Vec3& point, double share) {
      const Facet& f = body->mesh().facet(facet);
      std::array<render::PointSurface, 3> corner;
      for (std::size_t i = 0; i < 3; ++i) corner[i] = body->surface.by_point[f.vertex[i]];
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

/// A mesh renderer for one kind of probe (see mesh_slot.h).
template <class Probe>
class MeshScene final : public render::FrameLoopRenderer<MeshSlot<Probe>>, public MeshHolder {
  using Shell = render::FrameLoopRenderer<MeshSlot<Probe>>;
  using Shell::models_;

 public:
  using Slot = MeshSlot<Probe>;
  using Bodies = std::vector<std::unique_ptr<MeshBody>>;
  /// Runs after all bodies are built: collects what the probes need, or an Error.
  using Survey = std::function<Status(const Bodies&, render::PrepareReport&)>;
  using MakeProbe = std::function<Probe(const MeshBody&)>;

  MeshScene(render::Description described, MeshProbeKind kind, Survey survey, MakeProbe make_probe)
      : Shell(described.options),
        described_(std::move(described)),
        kind_(std::move(kind)),
        survey_(std::move(survey)),
        make_probe_(std::move(make_probe)) {}

  render::Description describe() const override { return described_; }
  const geometry::TriangleMesh* mesh(std::size_t model) const override {
    if (model >= models_.size()) return nullptr;
    const MeshGeometry& geometry = *models_[model].body->geometry;
    if (geometry.given != nullptr) return geometry.given.get();
    handed_out_.resize(models_.size());
    if (!handed_out_[model])
      handed_out_[model] = std::make_unique<const geometry::TriangleMesh>(geometry.mesh.as_mesh());
    return handed_out_[model].get();
  }

 private:
  Result<render::ModelDecisions> decide_model(const render::ModelInput& input,
                                              const render::PrepareContext& /*context*/) const override {
    const Result<MeshDecision> decided = decide_body(input, described_.options, kind_);
    if (!decided.ok()) return decided.error();
    return explanation(input, *decided, kind_);
  }
  Status add_models(const render::SceneInput& scene, const render::PrepareContext& context,
                    render::PrepareReport& report) override {
    bool shaded = false;
    handed_out_.clear();
    Bodies bodies;
    for (const render::ModelInput& input : scene.models) {
      PALPATE_ASSIGN(const MeshDecision decided, decide_body(input, described_.options, kind_));
      report.decisions.models.push_back(explanation(input, decided, kind_));
      shaded = decided.normals;
      PALPATE_ASSIGN(auto body, prepare_body(input, decided, described_.options, context, report));
      bodies.push_back(std::move(body));
    }
    if (survey_) PALPATE_TRY(survey_(bodies, report));
    for (auto& body : bodies) {
      Probe probe = make_probe_(*body);
      models_.add(std::make_unique<Slot>(std::move(body), std::move(probe)));
    }
    report.notes.push_back(shaded ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                  : "shading off");
    return Done{};
  }
  [[nodiscard]] render::ContactCombination combine() const override {
    return described_.options.text("combine") == "sum" ? render::ContactCombination::kSum
                                                       : render::ContactCombination::kJoint;
  }

  render::Description described_;
  MeshProbeKind kind_;
  Survey survey_;
  MakeProbe make_probe_;
  mutable std::vector<std::unique_ptr<const geometry::TriangleMesh>> handed_out_;  ///< see mesh()
};

}  // namespace palpate::baselines
