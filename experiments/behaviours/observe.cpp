#include "experiments/behaviours/behaviour.h"

#include <algorithm>

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
  std::vector<render::Frame> frames;
  for (std::size_t k = 0; k < behaviour.strokes.size(); ++k) {
    const Stroke& stroke = behaviour.strokes[k];
    render::HapticRenderer& renderer = *renderers[stroke.scene];
    frames.resize(stroke.path.size());
    renderer.reset(stroke.path.hip_mm.front());
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const double dt_s =
          i > 0 ? stroke.path.t_s[i] - stroke.path.t_s[i - 1]
                : stroke.path.t_s[std::min<std::size_t>(1, frames.size() - 1)] - stroke.path.t_s[0];
      frames[i] = renderer.step(stroke.path.hip_mm[i], dt_s);
    }
    outcome.wrong += behaviour.judge(stroke, frames);
    outcome.of += behaviour.whole(stroke);
    if (k != behaviour.shown) continue;
    for (const render::Frame& frame : frames) outcome.shown.push_back(behaviour.y(frame));
  }
  return outcome;
}

}  // namespace palpate::experiments
