// A renderer that is the frame shell and a way to build its local models: what all of ours, the literal
// forms, the oracles, the mesh renderers and the rivals are. What one adds is decide_model(), add_models()
// and describe().
#pragma once

#include <utility>

#include "toolkit/core/try.h"
#include "toolkit/render/frame_shell.h"
#include "toolkit/render/model_store.h"
#include "toolkit/render/renderer.h"

namespace palpate::render {

template <LocalModel Model>
class ShellRenderer : public HapticRenderer {
 public:
  Result<Decisions> decide(const SceneInput& scene, const PrepareContext& context) const final {
    Decisions decided;
    if (scene.models.empty()) return no_model();
    for (const ModelInput& input : scene.models) {
      Result<ModelDecisions> one = decide_model(input, context);
      if (!one.ok()) return std::move(one).error();
      decided.models.push_back(std::move(one).value());
    }
    say_scene(scene, decide_scene(scene, FrameShell<Model>::kKind, combine()), decided);
    return decided;
  }
  Result<PrepareReport> prepare(const SceneInput& scene, const PrepareContext& context) final {
    PrepareReport report;
    if (scene.models.empty()) return no_model();
    models_.clear();
    // Models of one scene that are made of the same are held once.
    ModelStore own;
    PrepareContext with = context;
    if (with.store == nullptr && scene.models.size() > 1) with.store = &own;
    PALPATE_TRY(add_models(scene, with, report));
    const SceneDecision decided = decide_scene(scene, FrameShell<Model>::kKind, combine());
    models_.finish(decided, report);
    say_scene(scene, decided, report.decisions);
    return report;
  }
  void restart(const Vec3& hip_mm, double t_s) noexcept final { models_.restart(hip_mm, t_s); }
  void let_go(const Vec3& hip_mm) noexcept final { models_.let_go(hip_mm); }
  [[nodiscard]] Frame step(const Vec3& hip_mm, double t_s) noexcept final {
    return models_.step(hip_mm, t_s);
  }
  [[nodiscard]] FrameCounters counters() const noexcept final { return models_.counters(); }

 protected:
  explicit ShellRenderer(Options options) : options_(std::move(options)) {}

  /// What add_models() makes of a model, by the same functions, which stop where building begins.
  [[nodiscard]] virtual Result<ModelDecisions> decide_model(const ModelInput& input,
                                                            const PrepareContext& context) const = 0;
  /// Builds one local model for each of the scene's, of which there is at least one, and adds them in order;
  /// the decisions that each follows go to report.decisions.models.
  [[nodiscard]] virtual Status add_models(const SceneInput& scene, const PrepareContext& context,
                                          PrepareReport& report) = 0;
  /// What becomes of several models touched at once.
  [[nodiscard]] virtual Combine combine() const { return Combine::kJoint; }

  Options options_;  ///< complete and validated
  FrameShell<Model> models_;

 private:
  static Error no_model() { return {"the scene has no model", "add a [[model]]", {}, 0}; }
};

}  // namespace palpate::render
