#include "toolkit/render/analytic_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toolkit/core/clock.h"

namespace palpate::render {
namespace {

constexpr const char* kName = "analytic";
constexpr const char* kSummary = "exact answer on surfaces known by formula: ground truth";
constexpr const char* kSource =
    "constrained god object of Zilles and Salisbury 1995, solved in closed form or by Newton";

// The HIP is followed in steps of at most this part of the model's box: a hundredth of a wave where ten waves
// span it, so that the god object cannot lose its valley.
constexpr double kSubStepPerBox = 1e-3;
// Sub-steps of one stretch of contact. Beyond it (a motion of a quarter of the box in one frame) they grow.
constexpr int kMostSubSteps = 256;
// Entries and releases in one frame. A segment has more only when it grazes many waves; the rest waits for
// the next.
constexpr int kMostEvents = 16;

}  // namespace

Result<PrepareReport> AnalyticRenderer::prepare(const SceneInput& scene, const PrepareContext&) {
  const Stopwatch watch;
  PrepareReport report;
  models_.clear();
  for (const ModelInput& input : scene.models) {
    if (!input.analytic)
      return Error{fmt::format("model '{}' has no formula", input.name),
                   "use 'analytic' with generated models only",
                   {},
                   0};
    Model model;
    model.surface = input.analytic;
    model.pose = ModelPose(input, Vec3::Zero());
    model.stiffness_n_per_mm = input.surface.stiffness_n_per_mm;
    model.sub_step_mm = kSubStepPerBox * input.analytic->box_mm().extent_mm().norm();
    report.notes.push_back(fmt::format("{}: {}", input.name, input.analytic->formula()));
    models_.push_back(std::move(model));
  }
  force_limit_n_ = scene.force_limit_n;
  started_ = false;
  counters_ = {};
  report.bytes = models_.size() * sizeof(Model);
  report.total_ms = watch.ms();
  report.phases.push_back({"set up", report.total_ms});
  return report;
}

void AnalyticRenderer::reset(const Vec3& hip_mm) noexcept {
  counters_ = {};
  now_s_ = 0.0;
  normal_ = Vec3::UnitZ();
  started_ = is_finite(hip_mm);
  for (Model& model : models_) {
    model.touching = false;
    model.pose.take(now_s_);
    if (started_) model.reached_mm = model.pose.to_local(hip_mm);
  }
}

bool AnalyticRenderer::stay_in_contact(Model& model, const Vec3& hip_mm, FrameCounters& counters) noexcept {
  const Vec3 start = model.reached_mm;
  const Vec3 motion = hip_mm - start;
  const double wanted = std::ceil(motion.norm() / model.sub_step_mm);
  const int steps = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(kMostSubSteps)));
  Vec3 before = start;
  for (int i = 1; i <= steps; ++i) {
    const Vec3 hip = i == steps ? hip_mm : Vec3(start + (static_cast<double>(i) / steps) * motion);
    model.god_object = model.surface->track(model.god_object, hip);
    ++counters.walk_steps;
    if ((model.god_object.point_mm - hip).dot(model.god_object.normal) <= 0.0) {
      // Out of this sheet. Where that led into another part of the inside (a narrow valley), the motion is
      // searched again from the sub-step before, so that the crossing between is found.
      model.reached_mm = model.surface->signed_distance_mm(hip) < 0.0 ? before : hip;
      model.touching = false;
      return false;
    }
    before = hip;
  }
  model.reached_mm = hip_mm;
  return true;
}

bool AnalyticRenderer::follow(Model& model, const Vec3& hip_mm, FrameCounters& counters) noexcept {
  for (int event = 0; event < kMostEvents; ++event) {
    if (model.touching) {
      if (stay_in_contact(model, hip_mm, counters)) return true;
      continue;
    }
    const std::optional<geometry::SurfacePoint> entry = model.surface->first_entry(model.reached_mm, hip_mm);
    if (!entry) {
      model.reached_mm = hip_mm;
      return true;
    }
    model.touching = true;
    model.god_object = *entry;
    model.reached_mm = entry->point_mm;
  }
  return false;
}

Frame AnalyticRenderer::step(const Vec3& hip_mm, double dt_s) noexcept {
  now_s_ += dt_s;
  Frame frame;
  frame.god_object_mm = hip_mm;
  ++counters_.frames;
  normal_ = Vec3::UnitZ();
  if (!is_finite(hip_mm)) {
    frame.status = FrameStatus::kNonFinite;
    return frame;
  }
  if (!started_) {
    for (Model& model : models_) model.reached_mm = model.pose.to_local(hip_mm);
    started_ = true;
  }
  double largest_n = -1.0;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    Model& model = models_[i];
    model.pose.take(now_s_);
    const Vec3 hip = model.pose.to_local(hip_mm);
    if (!follow(model, hip, counters_)) frame.status = FrameStatus::kBoundHit;
    if (!model.touching) continue;
    const Vec3 force_n =
        model.pose.direction_to_world(model.stiffness_n_per_mm * (model.god_object.point_mm - hip));
    frame.force_n += force_n;
    if (force_n.norm() > largest_n) {
      largest_n = force_n.norm();
      frame.contact = true;
      frame.model = static_cast<std::int32_t>(i);
      frame.god_object_mm = model.pose.to_world(model.god_object.point_mm);
      normal_ = model.pose.direction_to_world(model.god_object.normal);
    }
  }
  frame.force_n = limited(frame.force_n, force_limit_n_);
  if (frame.status == FrameStatus::kBoundHit) ++counters_.bound_hits;
  return frame;
}

Description AnalyticRenderer::describe() const {
  Description description;
  description.name = kName;
  description.summary = kSummary;
  description.source = kSource;
  description.work_bound = fmt::format(
      "per model and frame {} entries or releases of at most 4096 segment steps and {} sub-steps of at most "
      "300 Newton "
      "steps; not meant to be timed",
      kMostEvents, kMostSubSteps);
  return description;
}

RendererInfo analytic_renderer_info() {
  RendererInfo info;
  info.name = kName;
  info.summary = kSummary;
  info.source = kSource;
  info.needs_analytic = true;
  info.make = [](const Options&) { return std::make_unique<AnalyticRenderer>(); };
  return info;
}

}  // namespace palpate::render
