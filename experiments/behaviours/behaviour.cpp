#include "experiments/behaviours/behaviour.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <palpate/accuracy.h>
#include <palpate/generate.h>
#include <palpate/replay.h>
#include "toolkit/core/tolerances.h"

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

namespace {

constexpr double kRateHz = 1000.0;
constexpr double kFloorN = kBehaviourStiffness * metrics::kOmniResolutionMm;

BehaviourScene with_model(render::ModelInput model,
                          std::shared_ptr<const geometry::AnalyticSurface> surface) {
  model.surface.stiffness_n_per_mm = kBehaviourStiffness;
  BehaviourScene scene;
  scene.input.models.push_back(std::move(model));
  scene.surface = std::move(surface);
  return scene;
}

}  // namespace

Result<BehaviourScene> generated_scene(const std::string& generator) {
  PALPATE_ASSIGN(const NamedOptions spec, parse_named_options(generator));
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(spec));
  render::ModelInput model;
  model.name = generator;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  model.original_mesh = made.original_mesh;
  model.analytic = made.surface;
  return with_model(std::move(model), made.surface);
}

Result<BehaviourScene> scene_of_points(const std::vector<Vec3>& points, std::string name,
                                       std::shared_ptr<const geometry::AnalyticSurface> surface) {
  Result<cloud::Cloud> cloud = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  if (!cloud) return std::move(cloud).error();
  render::ModelInput model;
  model.name = std::move(name);
  model.cloud = std::make_shared<const cloud::Cloud>(*std::move(cloud));
  model.analytic = surface;
  return with_model(std::move(model), std::move(surface));
}

Result<Stroke> stroke_along(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                            trace::ProbePath path) {
  PALPATE_ASSIGN(trace::ReferenceTrace truth,
                 metrics::analytic_reference(*scenes[scene].surface, path, kBehaviourStiffness, 0.0, {}, {}));
  Stroke made{scene, std::move(path), std::move(truth)};
  const auto first = std::find_if(made.truth.frames.begin(), made.truth.frames.end(),
                                  [](const trace::TruthFrame& t) { return t.frame.contact; });
  if (first != made.truth.frames.end()) made.entry = first->normal;
  return made;
}

Result<Stroke> stroke(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                      const std::vector<Vec3>& corners, double speed_mm_s) {
  trace::ProbePath path;
  path.name = "straight ways";
  const double step_mm = speed_mm_s / kRateHz;
  double left_mm = 0.0;  // remainder of the last step, beyond the previous corner
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const Vec3 way = corners[c + 1] - corners[c];
    const double length = way.norm();
    for (; left_mm < length; left_mm += step_mm) {
      path.t_s.push_back(static_cast<double>(path.t_s.size()) / kRateHz);
      path.hip_mm.emplace_back(corners[c] + way * (left_mm / length));
    }
    left_mm -= length;
  }
  path.t_s.push_back(static_cast<double>(path.t_s.size()) / kRateHz);
  path.hip_mm.push_back(corners.back());
  return stroke_along(scenes, scene, std::move(path));
}

double scattered(std::size_t i, double low, double high) noexcept {
  const double turns = static_cast<double>(i + 1) * (std::numbers::phi - 1.0);
  return low + (high - low) * (turns - std::floor(turns));
}

bool out_of_band(const render::Frame& frame, const trace::TruthFrame& truth) noexcept {
  const double allowed = std::max(kForceJnd * truth.frame.force_n.norm(), kFloorN);
  return (frame.force_n - truth.frame.force_n).norm() > allowed;
}

bool turned_by(const render::Frame& frame, const trace::TruthFrame& truth, double deg) noexcept {
  const double sizes = frame.force_n.norm() * truth.frame.force_n.norm();
  return !(frame.force_n.dot(truth.frame.force_n) >= sizes * std::cos(deg * std::numbers::pi / 180.0)) ||
         !(sizes > 0.0);
}

std::uint64_t contact_frames(const Stroke& stroke) noexcept {
  return static_cast<std::uint64_t>(std::count_if(stroke.truth.frames.begin(), stroke.truth.frames.end(),
                                                  [](const auto& t) { return t.frame.contact; }));
}

}  // namespace palpate::experiments
