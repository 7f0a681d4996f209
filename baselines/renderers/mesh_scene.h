// The renderer behind `mesh-godobject` and `mesh-proxy`: meshes, one probe for each, the surface's response,
// several models constrained jointly and found by a broad phase, as `cloud` does.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "baselines/mesh_holder.h"
#include "baselines/renderers/mesh_slot.h"
#include "toolkit/render/joint_contact.h"
#include "toolkit/render/near_models.h"
#include "toolkit/render/slow_phase.h"

namespace palpate::baselines {

/// Times that the models near are looked at again from where the others hold the probe.
inline constexpr int kJointLooks = 3;

/// A mesh renderer of one kind of probe (see mesh_slot.h).
template <class Probe>
class MeshScene final : public render::HapticRenderer, public MeshHolder, public render::SlowPhase {
 public:
  using Slot = MeshSlot<Probe>;
  using Touch = MeshTouch<Probe>;
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
    if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
    slots_.clear();
    force_limit_n_ = scene.force_limit_n;
    sum_ = described_.options.text("combine") == "sum";
    const bool shaded = wants_shading(described_.options);
    Bodies bodies;
    bool many = scene.models.size() > 1;
    for (const render::ModelInput& input : scene.models) {
      auto body = prepare_body(input, described_.options, {needs_crossings_, shaded}, context, report);
      if (!body.ok()) return std::move(body).error();
      bodies.push_back(std::move(body).value());
      many |= input.motion != nullptr;
    }
    if (survey_)
      if (Status done = survey_(bodies, report); !done.ok()) return std::move(done).error();
    for (auto& body : bodies) {
      Probe probe = make_probe_(*body);
      slots_.push_back(std::make_unique<Slot>(std::move(body), std::move(probe)));
    }
    if (many) index_boxes(report);
    report.notes.push_back(shaded ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                  : "shading off");
    reset(Vec3::Zero());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    counters_ = {};
    now_s_ = 0.0;
    for (const auto& slot : slots_) {
      slot->body->pose.take(now_s_);
      slot->reset(slot->body->pose.to_local(hip_mm));
    }
    near_.reset(hip_mm, [](std::uint32_t, const Vec3&, double) noexcept {});
  }

  render::Frame step(const Vec3& hip_mm, double dt_s) noexcept override {
    ++counters_.frames;
    now_s_ += dt_s;
    render::Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = render::FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    if (near_.built())
      many(hip_mm, frame);
    else
      single(hip_mm, frame);
    counters_.bound_hits += frame.status == render::FrameStatus::kBoundHit;
    return frame;
  }

  render::FrameCounters counters() const noexcept override { return counters_; }
  render::Description describe() const override { return described_; }
  const geometry::TriangleMesh* mesh(std::size_t model) const noexcept override {
    return model < slots_.size() ? slots_[model]->body->source.get() : nullptr;
  }
  void run_slow_phase_elsewhere() noexcept override { near_.run_elsewhere(); }
  void slow_phase(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept override {
    near_.slow_phase(t_s, from_mm, to_mm);
  }

 private:
  void index_boxes(render::PrepareReport& report) {
    std::vector<render::ModelBox> boxes;
    for (const auto& slot : slots_) {
      const MeshBody& body = *slot->body;
      const geometry::Aabb local = body.mesh.local_box_mm().grown(slot->probe.reach_mm());
      const Vec3& origin = body.pose.origin_mm;
      boxes.push_back(
          {{local.low_mm + origin, local.high_mm + origin}, body.pose.world_from_model, body.pose.motion});
    }
    near_.build(std::move(boxes));
    report.bytes += near_.bytes();
  }

  /// The model's frame up to the frictionless contact, the probe pulled to `goal`; false where there is none.
  [[nodiscard]] bool touch(std::uint32_t index, const Vec3& goal_mm, const Vec3& hip_mm, render::Frame& frame,
                           Touch& touch) noexcept {
    Slot& slot = *slots_[index];
    const std::uint64_t moves = slot.probe.moves();
    const bool held = slot.probe.update(slot.body->pose.to_local(goal_mm));
    counters_.walk_steps += slot.probe.moves() - moves;
    if (slot.probe.bound_hit()) frame.status = render::FrameStatus::kBoundHit;
    if (!held) return false;
    touch.slot = &slot;
    touch.model = static_cast<std::int32_t>(index);
    touch.contact = slot.contact_at(slot.body->pose.to_local(hip_mm));
    return true;
  }

  void single(const Vec3& hip_mm, render::Frame& frame) noexcept {
    if (touch(0, hip_mm, hip_mm, frame, touches_[0]))
      answer(touches_[0], hip_mm, frame);
    else
      slots_[0]->state.release();
  }

  void answer(Touch& touch, const Vec3& hip_mm, render::Frame& frame) noexcept {
    const render::ModelPose& pose = touch.pose();
    if (!touch.slot->probe.felt(pose.to_local(hip_mm))) {
      touch.slot->state.release();
      return;
    }
    const render::SurfaceAnswer answer = touch.slot->respond(touch.contact);
    frame.contact = true;
    frame.model = touch.model;
    frame.god_object_mm = pose.to_world(answer.god_object_mm);
    frame.force_n = render::limited(pose.direction_to_world(answer.force_n), force_limit_n_);
  }

  void many(const Vec3& hip_mm, render::Frame& frame) noexcept {
    const auto enter = [this](std::uint32_t i, const Vec3& from, double t_s) noexcept {
      Slot& slot = *slots_[i];
      slot.body->pose.take(t_s);
      slot.probe.start_from(slot.body->pose.to_local(from));
      slot.state.release();
    };
    const auto touching = [this](std::uint32_t i) noexcept { return slots_[i]->probe.contact(); };
    if (!near_.choose(hip_mm, now_s_, enter, touching)) frame.status = render::FrameStatus::kBoundHit;
    for (const std::uint32_t index : near_.models()) {
      slots_[index]->body->pose.take(now_s_);
      slots_[index]->touched = false;
    }
    std::size_t touched = 0;
    look_at_untouched(hip_mm, hip_mm, frame, touched);
    for (int look = 1; touched > 0; ++look) {
      const Vec3 body = place_of(std::span(touches_).first(touched), hip_mm);
      // What holds the probe may have pushed it into a model that the HIP itself is clear of.
      if (look == kJointLooks || sum_ || near_.models().size() == touched) break;
      if (!look_at_untouched(body, hip_mm, frame, touched)) break;
    }
    for (const std::uint32_t index : near_.models())
      if (!slots_[index]->touched) slots_[index]->state.release();
    near_.done(hip_mm, now_s_);
    if (touched == 1) answer(touches_.front(), hip_mm, frame);
    if (touched > 1) answer_jointly(std::span(touches_).first(touched), hip_mm, frame);
  }

  /// Adds the models near that a probe pulled to `goal_mm` touches; true where there were any.
  bool look_at_untouched(const Vec3& goal_mm, const Vec3& hip_mm, render::Frame& frame,
                         std::size_t& touched) noexcept {
    const std::size_t before = touched;
    for (const std::uint32_t index : near_.models()) {
      if (slots_[index]->touched) continue;
      if (touched == touches_.size()) {
        frame.status = render::FrameStatus::kBoundHit;
        break;
      }
      slots_[index]->touched = touch(index, goal_mm, hip_mm, frame, touches_[touched]);
      touched += slots_[index]->touched;
    }
    return touched > before;
  }

  /// Where the touched models hold the probe's body; of several each gets its share of the way.
  [[nodiscard]] Vec3 place_of(std::span<Touch> touches, const Vec3& hip_mm) noexcept {
    const Touch& first = touches.front();
    if (touches.size() == 1 || sum_) return first.pose().to_world(first.slot->probe.body_mm());
    double skin = 0.0;
    for (const Touch& touch : touches) skin = std::max(skin, touch.slot->probe.skin_mm());
    return render::constrain_jointly(
        hip_mm, touches,
        [](Touch& touch, const Vec3& at, render::JointPlanes& planes) noexcept {
          touch.slot->probe.planes_near(touch.pose().to_local(at), touch.pose(), planes);
        },
        skin);
  }

  void answer_jointly(std::span<Touch> touches, const Vec3& hip_mm, render::Frame& frame) noexcept {
    const bool any = std::any_of(touches.begin(), touches.end(),
                                 [](const Touch& touch) { return touch.contact.pull != Vec3::Zero(); });
    if (!any) {  // a skin that has not come under any surface
      for (const Touch& touch : touches) touch.slot->state.release();
      return;
    }
    frame.god_object_mm = hip_mm;
    render::add_up(
        touches, [](Touch& touch) noexcept { return touch.slot->respond(touch.contact); }, force_limit_n_,
        frame);
  }

  render::Description described_;
  bool needs_crossings_;
  Survey survey_;
  MakeProbe make_probe_;
  std::vector<std::unique_ptr<Slot>> slots_;
  std::array<Touch, render::kMaxTouched> touches_;
  render::NearModels near_;  ///< built in a scene of several models, or moving ones
  bool sum_ = false;         ///< several models: the sum of their forces
  double force_limit_n_ = 0.0;
  double now_s_ = 0.0;
  render::FrameCounters counters_;
};

}  // namespace palpate::baselines
