// Renderer of the frame loop and its local models. It is the base of nearly all renderers. Derived classes
// add decide_model(), add_models() and describe().
#pragma once

#include <utility>

#include <palpate/model_store.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/render/frame_loop.h"

namespace palpate::render {

template <LocalModel Model>
class FrameLoopRenderer : public HapticRenderer {
 public:
  Result<Decisions> decide(const SceneInput& scene, const PrepareContext& context) const final {
    Decisions decided;
    if (scene.models.empty()) return no_model();
    for (const ModelInput& input : scene.models) {
      Result<ModelDecisions> one = decide_model(input, context);
      if (!one.ok()) return std::move(one).error();
      decided.models.push_back(std::move(one).value());
    }
    describe_scene(scene, decide_scene(scene, FrameLoop<Model>::kKind, combine()), decided);
    return decided;
  }
  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) final {
    PrepareReport report;
    if (scene.models.empty()) return no_model();
    models_.clear();
    // Shares data between this scene's models.
    ModelStore own;
    PrepareContext with = context;
    if (with.store == nullptr && scene.models.size() > 1) with.store = &own;
    PALPATE_TRY(add_models(scene, with, report));
    const SceneDecision decided = decide_scene(scene, FrameLoop<Model>::kKind, combine());
    models_.finish(decided, report);
    describe_scene(scene, decided, report.decisions);
    return report;
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept final { models_.restart(hip_mm, t_s); }
  void release_contact(const Vec3& hip_mm) noexcept final { models_.release_contact(hip_mm); }
  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept final {
    return models_.step(hip_mm, t_s);
  }
  [[nodiscard]] stream::DepthReceiver* depth_receiver() noexcept final { return models_.depth_receiver(); }
  [[nodiscard]] FrameCounters counters() const noexcept final { return models_.counters(); }

 protected:
  explicit FrameLoopRenderer(Options options) : options_(std::move(options)) {}

  /// The decisions that add_models() would take for a model, without building.
  [[nodiscard]] virtual Result<ModelDecisions> decide_model(const ModelInput& input,
                                                            const PrepareContext& context) const = 0;
  /// Builds a local model for each of the scene's models (at least one) and adds them in order. Writes the
  /// decisions to report.decisions.models.
  [[nodiscard]] virtual Status add_models(const SceneInput& scene, const PrepareContext& context,
                                          PrepareReport& report) = 0;
  /// Combination of contacts with several models.
  [[nodiscard]] virtual ContactCombination combine() const { return ContactCombination::kJoint; }

  Options options_;  ///< complete and validated
  FrameLoop<Model> models_;

 private:
  static Error no_model() { return {"the scene has no model", "add a [[model]]", {}, 0}; }
};

}  // namespace palpate::render
