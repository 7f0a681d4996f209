// The renderer behind `mesh-godobject` and `mesh-proxy`: meshes, one probe for each, the surface's response.
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "baselines/mesh_holder.h"
#include "baselines/renderers/mesh_body.h"
#include "toolkit/render/summed_models.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// Probe: reset(h), bool update(h), bound_hit(), moves(), target(h), shaded_target(h, vertex normals): see
/// MeshProbe.
template <class Probe>
class MeshModel {
 public:
  MeshModel(std::unique_ptr<MeshBody> held, Probe&& made) : body(std::move(held)), probe(std::move(made)) {}
  std::unique_ptr<MeshBody> body;
  Probe probe;

  [[nodiscard]] render::ModelPose& pose() noexcept { return body->pose; }
  void reset(const Vec3& h) noexcept {
    probe.reset(h);
    state_.release();
  }
  [[nodiscard]] render::ModelAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    const std::uint64_t moves = probe.moves();
    const bool touching = probe.update(h);
    counters.walk_steps += probe.moves() - moves;
    render::ModelAnswer answer;
    answer.bound_hit = probe.bound_hit();
    if (!touching) {
      state_.release();
      return answer;
    }
    const Vec3 target =
        body->vertex_normals.empty() ? probe.target(h) : probe.shaded_target(h, body->vertex_normals);
    const auto [force, god_object] = respond(h, target);
    answer.contact = true;
    answer.force_n = force;
    answer.god_object = god_object;
    return answer;
  }

 private:
  /// The surface's own part: the same stage that the point renderers use.
  [[nodiscard]] render::SurfaceAnswer respond(const Vec3& hip, const Vec3& target) noexcept {
    const render::SurfaceField& surface = body->surface;
    render::SurfaceContact contact;
    contact.hip = hip;
    contact.pull = target - hip;
    contact.stiffness_n_per_mm = surface.stiffness_n_per_mm;
    if (surface.features == 0) return state_.respond<0>(contact, surface.texture, Vec3::Zero());
    contact.static_friction = surface.friction.static_coefficient;
    contact.dynamic_friction = surface.friction.dynamic_coefficient;
    const Vec3& origin = body->mesh.origin_mm();
    if ((surface.features & render::kTexture) == 0)
      return state_.respond<render::kFriction>(contact, surface.texture, origin);
    return state_.respond<render::kFriction | render::kTexture>(contact, surface.texture, origin);
  }

  render::SurfaceState state_;
};

/// A mesh renderer of one kind of probe.
template <class Probe>
class MeshScene final : public render::HapticRenderer, public MeshHolder {
 public:
  using Bodies = std::vector<std::unique_ptr<MeshBody>>;
  /// Once every body is built: what else the probes need to know, or why there can be none.
  using Survey = std::function<Status(const Bodies&, render::PrepareReport&)>;
  using MakeProbe = std::function<Probe(const MeshBody&)>;

  MeshScene(render::Description described, bool needs_crossings, Survey survey, MakeProbe make_probe)
      : described_(std::move(described)),
        needs_crossings_(needs_crossings),
        survey_(std::move(survey)),
        make_probe_(std::move(make_probe)) {}

  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override {
    render::PrepareReport report;
    models_.clear(scene.force_limit_n);
    const bool shaded = wants_shading(described_.options);
    Bodies bodies;
    for (const render::ModelInput& input : scene.models) {
      auto body = prepare_body(input, described_.options, {needs_crossings_, shaded}, context, report);
      if (!body.ok()) return std::move(body).error();
      bodies.push_back(std::move(body).value());
    }
    if (survey_)
      if (Status done = survey_(bodies, report); !done.ok()) return std::move(done).error();
    for (auto& body : bodies) {
      Probe probe = make_probe_(*body);
      models_.add(std::make_unique<MeshModel<Probe>>(std::move(body), std::move(probe)));
    }
    report.notes.push_back(shaded ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                  : "shading off");
    return report;
  }
  void reset(const Vec3& hip_mm) noexcept override { models_.reset(hip_mm); }
  render::Frame step(const Vec3& hip_mm, double dt_s) noexcept override { return models_.step(hip_mm, dt_s); }
  render::FrameCounters counters() const noexcept override { return models_.counters(); }
  render::Description describe() const override { return described_; }
  const geometry::TriangleMesh* mesh(std::size_t model) const noexcept override {
    return model < models_.size() ? models_[model].body->source.get() : nullptr;
  }

 private:
  render::Description described_;
  bool needs_crossings_;
  Survey survey_;
  MakeProbe make_probe_;
  render::SummedModels<MeshModel<Probe>> models_;
};

}  // namespace palpate::baselines
