// The renderer behind `mesh-godobject` and `mesh-proxy`: meshes, one probe for each, the surface's response,
// several models constrained jointly and found by a broad phase, as `cloud` does.
#pragma once

#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "baselines/mesh_holder.h"
#include "baselines/renderers/mesh_slot.h"
#include "toolkit/core/try.h"
#include "toolkit/render/shell_renderer.h"

namespace palpate::baselines {

/// A mesh renderer of one kind of probe (see mesh_slot.h).
template <class Probe>
class MeshScene final : public render::ShellRenderer<MeshSlot<Probe>>, public MeshHolder {
  using Shell = render::ShellRenderer<MeshSlot<Probe>>;
  using Shell::models_;

 public:
  using Slot = MeshSlot<Probe>;
  using Bodies = std::vector<std::unique_ptr<MeshBody>>;
  /// Once every body is built: what else the probes need to know, or why there can be none.
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
    return said(input, *decided, kind_);
  }
  Status add_models(const render::SceneInput& scene, const render::PrepareContext& context,
                    render::PrepareReport& report) override {
    bool shaded = false;
    handed_out_.clear();
    Bodies bodies;
    for (const render::ModelInput& input : scene.models) {
      const Result<MeshDecision> decided = decide_body(input, described_.options, kind_);
      if (!decided.ok()) return decided.error();
      report.decisions.models.push_back(said(input, *decided, kind_));
      shaded = decided->normals;
      auto body = prepare_body(input, *decided, described_.options, context, report);
      if (!body.ok()) return std::move(body).error();
      bodies.push_back(std::move(body).value());
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
  [[nodiscard]] render::Combine combine() const override {
    return described_.options.text("combine") == "sum" ? render::Combine::kSum : render::Combine::kJoint;
  }

  render::Description described_;
  MeshProbeKind kind_;
  Survey survey_;
  MakeProbe make_probe_;
  mutable std::vector<std::unique_ptr<const geometry::TriangleMesh>> handed_out_;  ///< see mesh()
};

}  // namespace palpate::baselines
