#include "experiments/behaviours/behaviour.h"

#include <palpate/replay.h>

namespace palpate::experiments {

BehaviourOutcome observe(const Behaviour& behaviour, const RendererRequest& request,
                         const render::Registry& registry, int threads, Progress& progress) {
  BehaviourOutcome outcome;
  std::vector<std::unique_ptr<render::HapticRenderer>> renderers;
  for (const BehaviourScene& scene : behaviour.scenes) {
    auto made = registry.make(request.name, request.options);
    if (!made) {
      outcome.failure = made.error().what;
      return outcome;
    }
    progress.report(behaviour.id + ": preparing " + request.label, -1.0);
    if (const Result<render::PrepareReport> ready = (*made)->prepare(scene.input, {threads, &progress});
        !ready) {
      outcome.failure = ready.error().what;
      return outcome;
    }
    renderers.push_back(*std::move(made));
  }
  for (std::size_t k = 0; k < behaviour.strokes.size(); ++k) {
    const Stroke& stroke = behaviour.strokes[k];
    Result<trace::ForceTrace> felt = trace::replay(*renderers[stroke.scene], stroke.path,
                                                   behaviour.scenes[stroke.scene].input.simulation.get());
    if (!felt) {
      outcome.failure = felt.error().what;
      return outcome;
    }
    const std::vector<render::Frame>& frames = felt->frames;
    outcome.wrong += behaviour.judge(stroke, frames);
    outcome.of += behaviour.whole(stroke);
    if (k != behaviour.shown) continue;
    for (const render::Frame& frame : frames) outcome.shown.push_back(behaviour.y(frame));
  }
  return outcome;
}

}  // namespace palpate::experiments
