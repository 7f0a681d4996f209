// The exact answer on analytic surfaces: ground truth.
//
// A constrained god object (Zilles and Salisbury 1995) in double precision. It is free until the HIP's
// segment enters the surface, then at the local minimum of the distance to the HIP, tracked along the
// surface, until the HIP is outside again as seen from there. The motion is sub-stepped within a frame, so
// the answer is converged. It is never timed. Several touched models hold the god object together
// (frame_loop.h); the frame reports the model of the largest force.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "toolkit/render/frame_loop_renderer.h"
#include "toolkit/render/prepare.h"
#include "toolkit/renderers/renderer_infos.h"

namespace palpate::render {
namespace {

constexpr const char* kName = "analytic";
constexpr const char* kSummary = "exact answer on surfaces known by formula: ground truth";
constexpr const char* kSource =
    "constrained god object of Zilles and Salisbury 1995, solved in closed form or by Newton";

// Largest step of the followed HIP, as a share of the model's box: a hundredth of a wave where ten waves span
// it, so the god object stays in its valley.
constexpr double kSubStepPerBox = 1e-3;
// Most sub-steps of one stretch of contact; faster motions (a quarter of the box in one frame) use longer
// steps.
constexpr int kMaxSubSteps = 256;
// Most entries and releases in one frame. Only a segment that grazes many waves has more; the rest waits for
// the next frame.
constexpr int kMaxEvents = 16;

}  // namespace

/// The local model of the frame loop.
class AnalyticModel {
 public:
  using Memory = geometry::SurfacePoint;
  AnalyticModel(const ModelInput& input, double sub_step_mm);

  [[nodiscard]] ModelPose& pose() noexcept { return pose_; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return pose_; }
  void release_contact(const Vec3& h) noexcept;
  void release() noexcept {}
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& memory, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& contact) const noexcept;
  void planes_near(const Memory& memory, const Vec3& at_world, JointPlanes& planes,
                   FrameCounters& counters) const noexcept;

 private:
  /// Follows the HIP's motion to `h`; false if a bound stopped it.
  bool follow(const Vec3& h, FrameCounters& counters) noexcept;
  /// Tracks in contact; false on release, at reached_.
  bool stay_in_contact(const Vec3& h, FrameCounters& counters) noexcept;

  std::shared_ptr<const geometry::AnalyticSurface> surface_;
  ModelPose pose_;
  double stiffness_n_per_mm_;
  double sub_step_mm_;
  bool touching_ = false;
  bool started_ = false;
  geometry::SurfacePoint god_object_;
  Vec3 reached_ = Vec3::Zero();  ///< the HIP's motion is followed up to here
};

class AnalyticRenderer final : public FrameLoopRenderer<AnalyticModel> {
 public:
  AnalyticRenderer() : FrameLoopRenderer({}) {}
  [[nodiscard]] Description describe() const override;

 private:
  /// Fails when the model has no formula.
  Result<ModelDecisions> decide_model(const ModelInput& input, const PrepareContext& context) const override;
  Status add_models(const SceneInput& scene, const PrepareContext& context, PrepareReport& report) override;
};

Result<ModelDecisions> AnalyticRenderer::decide_model(const ModelInput& input,
                                                      const PrepareContext& /*context*/) const {
  if (!input.analytic)
    return Error{fmt::format("model '{}' has no formula", input.name),
                 "use 'analytic' with generated models only"};
  ModelDecisions out;
  out.name = input.name;
  out.points = input.cloud != nullptr ? input.cloud->size() : 0;  // the points are not read
  out.decisions.push_back(
      {"surface", input.analytic->formula(), "the formula it was generated from; no point is read"});
  out.bytes = sizeof(AnalyticModel);
  out.prepare_ms = 0.0;
  return out;
}

Status AnalyticRenderer::add_models(const SceneInput& scene, const PrepareContext& context,
                                    PrepareReport& report) {
  PreparePhases phases(report, context);
  phases.begin("set up");
  for (const ModelInput& input : scene.models) {
    PALPATE_ASSIGN(ModelDecisions decided, decide_model(input, context));
    phases.note(fmt::format("{}: {}", input.name, decided.decisions.front().choice));
    report.decisions.models.push_back(std::move(decided));
    models_.add(
        std::make_unique<AnalyticModel>(input, kSubStepPerBox * input.analytic->box_mm().extent_mm().norm()));
    report.bytes += sizeof(AnalyticModel);
  }
  phases.end();
  return Done{};
}

AnalyticModel::AnalyticModel(const ModelInput& input, double sub_step_mm)
    : surface_(input.analytic),
      pose_(input, Vec3::Zero()),
      stiffness_n_per_mm_(input.surface.stiffness_n_per_mm),
      sub_step_mm_(sub_step_mm) {}

void AnalyticModel::release_contact(const Vec3& h) noexcept {
  touching_ = false;
  started_ = is_finite(h);
  if (started_) reached_ = h;
}

bool AnalyticModel::stay_in_contact(const Vec3& h, FrameCounters& counters) noexcept {
  const Vec3 start = reached_;
  const Vec3 motion = h - start;
  const double wanted = std::ceil(motion.norm() / sub_step_mm_);
  const int steps = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(kMaxSubSteps)));
  Vec3 before = start;
  for (int i = 1; i <= steps; ++i) {
    const Vec3 hip = i == steps ? h : Vec3(start + (static_cast<double>(i) / steps) * motion);
    god_object_ = surface_->track(god_object_, hip);
    ++counters.walk_steps;
    if ((god_object_.point_mm - hip).dot(god_object_.normal) <= 0.0) {
      // The HIP left this sheet. If it is in another part of the inside (a narrow valley), the motion is
      // searched again from the previous sub-step to find the crossing.
      reached_ = surface_->signed_distance_mm(hip) < 0.0 ? before : hip;
      touching_ = false;
      return false;
    }
    before = hip;
  }
  reached_ = h;
  return true;
}

bool AnalyticModel::follow(const Vec3& h, FrameCounters& counters) noexcept {
  for (int event = 0; event < kMaxEvents; ++event) {
    if (touching_) {
      if (stay_in_contact(h, counters)) return true;
      continue;
    }
    const std::optional<geometry::SurfacePoint> entry = surface_->first_entry(reached_, h);
    if (!entry) {
      reached_ = h;
      return true;
    }
    touching_ = true;
    god_object_ = *entry;
    reached_ = entry->point_mm;
  }
  return false;
}

bool AnalyticModel::touch(const Vec3& /*goal*/, const Vec3& h, Memory& memory, SurfaceContact& contact,
                          FrameStatus& status, FrameCounters& counters) noexcept {
  if (!started_) reached_ = h;
  started_ = true;
  if (!follow(h, counters)) status = FrameStatus::kBoundHit;
  if (!touching_) return false;
  memory = god_object_;
  contact.hip = h;
  contact.pull = god_object_.point_mm - h;
  contact.stiffness_n_per_mm = stiffness_n_per_mm_;
  return true;
}

SurfaceResponse AnalyticModel::respond(const SurfaceContact& contact) const noexcept {
  // If no other model moved the god object, uses the point itself, free of rounding.
  const bool alone = contact.pull == god_object_.point_mm - contact.hip;
  return {stiffness_n_per_mm_ * contact.pull,
          alone ? god_object_.point_mm : Vec3(contact.hip + contact.pull)};
}

/// The tangent plane at the surface point nearest to `at_world`, tracked from the god object.
void AnalyticModel::planes_near(const Memory& memory, const Vec3& at_world, JointPlanes& planes,
                                FrameCounters& /*counters*/) const noexcept {
  const geometry::SurfacePoint near = surface_->track(memory, pose_.to_local(at_world));
  const Vec3 normal = pose_.direction_to_world(near.normal);
  planes.add({normal, normal.dot(pose_.to_world(near.point_mm))});
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
      kMaxEvents, kMaxSubSteps);
  return description;
}

RendererInfo analytic_info() {
  RendererInfo info;
  info.name = kName;
  info.summary = kSummary;
  info.source = kSource;
  info.role = Role::kReference;
  info.geometry = Geometry::kFormula;
  info.supports = Feature::kMotion | Feature::kManyModels | Feature::kJointContact;
  info.make = [](const Options&) { return std::make_unique<AnalyticRenderer>(); };
  return info;
}

}  // namespace palpate::render
