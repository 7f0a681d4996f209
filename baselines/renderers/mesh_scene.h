// Renderer of `mesh-godobject` and `mesh-proxy`: a mesh and a probe per model, constrained jointly with a
// broad phase, as in `cloud`.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "baselines/mesh/surface_mesh.h"
#include "baselines/renderers/depth_rebuild.h"
#include "baselines/renderers/mesh_body.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {

/// The mesh of an image and the probe on it; without a probe there is nothing to feel.
template <class Probe>
struct ImageMesh {
  std::shared_ptr<const MeshGeometry> geometry;
  std::optional<Probe> probe;
  Vec3 camera_mm = Vec3::Zero();  ///< local
  double match_per_depth = 0.0;   ///< reach of a match over the distance from the camera
};

/// For one thread. Probe: MeshProbe or SphereProbe; it needs the functions that these share.
template <class Probe>
struct MeshSlot {
  using Images = DepthRebuild<ImageMesh<Probe>>;
  std::unique_ptr<MeshBody> body;
  std::optional<Probe> probe;
  render::SurfaceState state;
  std::unique_ptr<Images> images;  ///< of a stream, or null
  bool there = true;               ///< false: nothing to feel

  MeshSlot(std::unique_ptr<MeshBody> held, Probe&& made) : body(std::move(held)), probe(std::move(made)) {}
  MeshSlot(std::unique_ptr<MeshBody> held, std::unique_ptr<Images> stream)
      : body(std::move(held)), images(std::move(stream)), there(false) {}

  struct Memory {};
  [[nodiscard]] render::ModelPose& pose() noexcept { return body->pose; }
  [[nodiscard]] const render::ModelPose& pose() const noexcept { return body->pose; }
  [[nodiscard]] geometry::Aabb box_mm() const noexcept {
    return images != nullptr ? geometry::Aabb{Vec3::Zero(), Vec3::Zero()}
                             : body->mesh().local_box_mm().grown(probe->reach_mm());
  }
  /// A stream may bring a surface anywhere.
  [[nodiscard]] bool moves_by_itself() const noexcept { return images != nullptr; }
  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept { return images.get(); }
  [[nodiscard]] bool touching() const noexcept { return there && probe->contact(); }
  [[nodiscard]] bool felt(const Vec3& h) const noexcept { return probe->felt(h); }
  [[nodiscard]] Vec3 body_mm() const noexcept { return probe->body_mm(); }
  [[nodiscard]] double skin_mm() const noexcept { return probe->skin_mm(); }
  void restart(const Vec3& h) noexcept {
    (void)take_image(h);
    if (there) probe->reset(h);
    state.release();
  }
  /// Clear of the HIP up to h; the side stays.
  void release_contact(const Vec3& h) noexcept {
    if (there) probe->start_from(h);
    state.release();
  }
  void release() noexcept { state.release(); }
  /// Finds the frictionless contact with the probe pulled to `goal`.
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& /*memory*/,
                           render::SurfaceContact& contact, render::FrameStatus& status,
                           render::FrameCounters& counters) noexcept {
    if (images != nullptr) {
      if (take_image(h)) ++counters.swaps;
      if (!there) return false;
    }
    const std::uint64_t moves = probe->moves();
    const bool held = probe->update(goal);
    counters.walk_steps += probe->moves() - moves;
    if (probe->bound_hit()) status = render::FrameStatus::kBoundHit;
    if (held) contact = contact_at(h);
    return held;
  }
  /// Response of the surface, the stage shared with the point renderers.
  [[nodiscard]] render::SurfaceResponse respond(const render::SurfaceContact& contact) noexcept {
    return render::respond_for_features(state, body->surface, contact, body->pose.origin_mm);
  }
  void planes_near(const Memory& /*memory*/, const Vec3& at_world, render::JointPlanes& planes,
                   render::FrameCounters& /*counters*/) noexcept {
    probe->planes_near(body->pose.to_local(at_world), body->pose, planes);
  }

 private:
  /// Takes the newest image's mesh, with which the probe goes on; true if there was one. The receiving thread
  /// frees the exchanged one.
  bool take_image([[maybe_unused]] const Vec3& h) noexcept {
    if (images == nullptr || !images->take()) return false;
    const bool was_there = there;
    ImageMesh<Probe>* const newest = images->newest();
    there = newest != nullptr && newest->probe.has_value();
    if (!there) return true;
    if constexpr (requires(Probe & p) { p.continue_from(p, h, 0.0); }) {
      const double reach_mm = newest->match_per_depth * (h - newest->camera_mm).norm();
      if (was_there)
        newest->probe->continue_from(*probe, newest->camera_mm, reach_mm);
      else
        newest->probe->start_from(h);
    }
    std::swap(body->geometry, newest->geometry);
    std::swap(probe, newest->probe);
    return true;
  }

  /// Held: the frictionless contact with the surface's properties.
  [[nodiscard]] render::SurfaceContact contact_at(const Vec3& h) noexcept {
    const Vec3 target = body->geometry->vertex_normals.empty()
                            ? probe->target(h)
                            : probe->shaded_target(h, body->geometry->vertex_normals);
    render::SurfaceContact contact = render::uniform_contact(body->surface, h, target - h);
    if ((body->surface.features & render::kVaried) != 0) read_properties(contact);
    return contact;
  }
  /// Interpolates over the facets that hold the probe, by their shares.
  void read_properties(render::SurfaceContact& contact) const noexcept {
    contact.stiffness_n_per_mm = contact.static_friction = contact.dynamic_friction = 0.0;
    probe->places([&](std::uint32_t facet, const Vec3& point, double share) {
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
  using MakeProbe = std::function<Probe(const MeshGeometry&)>;

  MeshScene(render::Description described, MeshProbeKind kind, Survey survey, MakeProbe make_probe)
      : Shell(described.options),
        described_(std::move(described)),
        kind_(std::move(kind)),
        survey_(std::move(survey)),
        make_probe_(std::move(make_probe)) {}

  render::Description describe() const override { return described_; }
  const geometry::TriangleMesh* mesh(std::size_t model) const override {
    if (model >= models_.size()) return nullptr;
    if (models_[model].images != nullptr) return nullptr;  // it has another one for each image
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
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      std::unique_ptr<MeshBody>& body = bodies[i];
      if (scene.models[i].camera != nullptr) {
        auto images = images_of(scene.models[i], body->pose.origin_mm, shaded);
        models_.add(std::make_unique<Slot>(std::move(body), std::move(images)));
        continue;
      }
      Probe probe = make_probe_(*body->geometry);
      models_.add(std::make_unique<Slot>(std::move(body), std::move(probe)));
    }
    report.notes.push_back(shaded ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                  : "shading off");
    return Done{};
  }
  [[nodiscard]] std::unique_ptr<typename Slot::Images> images_of(const render::ModelInput& input,
                                                                 const Vec3& origin_mm, bool shaded) const {
    const double match_per_depth = kMatchPixels / input.camera->fx_px;
    return std::make_unique<typename Slot::Images>(
        input, origin_mm,
        [make_probe = make_probe_, origin_mm, shaded, match_per_depth](const DepthPatch& patch) {
          auto made = std::make_shared<ImageMesh<Probe>>();
          made->geometry = mesh_of_image(patch, origin_mm, shaded);
          if (made->geometry != nullptr) made->probe.emplace(make_probe(*made->geometry));
          made->camera_mm = patch.camera_mm;
          made->match_per_depth = match_per_depth;
          return made;
        });
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
