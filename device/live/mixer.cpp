#include "device/live/mixer.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <utility>

#include <palpate/result.h>

namespace palpate::device {
namespace {

// Returns to full rate only if all together take a sixth less than the threshold: one interrupted frame moves
// a mean by a 64th of a period and must not toggle it.
constexpr double kFullAgainShare = 5.0 / 6.0;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

}  // namespace

const char* decision_text(MixDecision decision) noexcept {
  constexpr std::array kTexts = {"",           "waits",     "swapped in free space",
                                 "fade begun", "fade done", "refused",
                                 "queued",     "aborted",   "cancelled",
                                 "replaced"};
  static_assert(kTexts.size() == static_cast<std::size_t>(MixDecision::kReplaced) + 1);
  const auto at = static_cast<std::size_t>(decision);
  return at < kTexts.size() ? kTexts[at] : "unknown";
}

Mixer::~Mixer() {
  delete inbox_.exchange(nullptr);
  for (auto& out : outbox_) delete out.exchange(nullptr);
}

void Mixer::add(std::unique_ptr<render::HapticRenderer> renderer) {
  assert(lanes_ < kMaxLanes && renderer != nullptr);
  Place& place = places_[lanes_];
  place.lane = static_cast<std::uint8_t>(lanes_++);
  place.tracked.adopt(std::move(renderer), 1, std::nullopt, 0.0);
  if (felt_ == kNobody) felt_ = 0;
}

Result<render::Decisions> Mixer::decide(const render::SceneInput& scene,
                                        const render::PrepareContext& context) const {
  render::Decisions all;
  for (const Place& place : places_) {
    if (!place.tracked.present()) continue;
    PALPATE_ASSIGN(render::Decisions one, place.tracked.renderer().decide(scene, context));
    for (render::Decision& decision : one.decisions) {
      decision.about = place.tracked.renderer().describe().name + ": " + decision.about;
      all.decisions.push_back(std::move(decision));
    }
    for (render::ModelDecisions& model : one.models) all.models.push_back(std::move(model));
    all.bytes += one.bytes;
  }
  return all;
}

Result<render::PrepareReport> Mixer::prepare(const render::SceneInput& scene,
                                             const render::PrepareContext& context) {
  render::PrepareReport all;
  for (Place& place : places_) {
    if (!place.tracked.present()) continue;
    PALPATE_ASSIGN(render::PrepareReport one, place.tracked.renderer().prepare(scene, context));
    all.total_ms += one.total_ms;
    all.bytes += one.bytes;
    all.shared_bytes += one.shared_bytes;
    for (render::PreparePhase& phase : one.phases) all.phases.push_back(std::move(phase));
    for (std::string& note : one.notes) all.notes.push_back(std::move(note));
    for (std::string& warning : one.warnings) all.warnings.push_back(std::move(warning));
    for (render::Decision& decision : one.decisions.decisions)
      all.decisions.decisions.push_back(std::move(decision));
    for (render::ModelDecisions& model : one.decisions.models)
      all.decisions.models.push_back(std::move(model));
    all.decisions.bytes += one.decisions.bytes;
  }
  all.bytes += sizeof(*this);
  return all;
}

void Mixer::restart(const Vec3& hip_mm, double t_s) noexcept {
  abort();
  dead_ = false;
  time_.restart(t_s);
  speed_.restart();
  for (Place& place : places_)
    if (place.tracked.present()) place.tracked.restart(hip_mm, t_s);
  if (felt_ == kNobody) felt_ = first_healthy();
}

void Mixer::release_contact(const Vec3& hip_mm) noexcept {
  abort();
  dead_ = false;
  time_.release_contact();
  speed_.restart();
  for (Place& place : places_)
    if (place.tracked.healthy()) place.tracked.release_contact(hip_mm, time_.now_s());
  if (felt_ == kNobody || !places_[felt_].tracked.healthy()) felt_ = first_healthy();
}

/// Ends a fade or wait where it is. Others bring the force to zero.
void Mixer::abort() noexcept {
  if (state_ == MixState::kSteady) return;
  aborted_ = true;
  state_ = MixState::kSteady;
  to_ = kNobody;
  weight_ = 0.0;
  turned_back_ = false;
}

render::Frame Mixer::step(const Vec3& hip_mm, double t_s) noexcept {
  mixed_.request = {};
  mixed_.decision = MixDecision::kNone;
  mixed_.reason = SwitchReason::kNone;
  if (std::exchange(aborted_, false)) report(MixDecision::kAborted, SwitchReason::kFault);
  render::Frame frame;
  frame.god_object_mm = hip_mm;
  if (!is_finite(hip_mm)) {
    frame.status = render::FrameStatus::kNonFinite;
    mixed_.force_n.setZero();
    return frame;
  }
  speed_.observe(hip_mm, time_.advance(t_s));
  for (Place& place : places_) place.tracked.skip();
  if (!dead_ && felt_ != kNobody) {
    take_arrival(t_s);
    step_all(hip_mm, t_s);
    watch_pair();
  }
  if (!dead_ && felt_ != kNobody) {
    settle_arrival();
    if (state_ == MixState::kFading) advance_fade(t_s);
    take_request(t_s);
    if (state_ == MixState::kWaiting) decide_waiting(hip_mm, t_s);
    frame = mix(t_s);
  } else if (felt_ != kNobody && places_[felt_].tracked.stepped()) {
    // The failed frame's answer goes to the governor, which latches.
    frame.force_n.setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  hand_out();
  mixed_.force_n = frame.force_n;
  show(t_s);
  return frame;
}

void Mixer::step_all(const Vec3& hip_mm, double t_s) noexcept {
  odd_frame_ = !odd_frame_;
  step_one(felt_, hip_mm, t_s);
  if (state_ == MixState::kFading) step_one(to_, hip_mm, t_s);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (i == felt_ || (state_ == MixState::kFading && i == to_) || places_[i].leaving) continue;
    const TrackedRenderer& one = places_[i].tracked;
    if (!one.healthy()) continue;
    const bool due = !half_rate_ || !one.ready() || (i % 2 == 1) == odd_frame_;
    if (due) step_one(i, hip_mm, t_s);
  }
  judge_load();
}

void Mixer::step_one(std::size_t at, const Vec3& hip_mm, double t_s) noexcept {
  const double period_ns = options_.period_s * kFrameNsPerS;
  const double spare_ns =
      at == felt_ ? kUnlimited : options_.budget_share * period_ns - places_[felt_].tracked.mean_ns();
  // Fading back from a slow renderer, no other is blamed for its time.
  places_[at].tracked.step(hip_mm, t_s, clock_, shown_, turned_back_ ? kUnlimited : spare_ns, options_);
}

void Mixer::judge_load() noexcept {
  double all_ns = 0.0;
  for (const Place& place : places_)
    if (place.tracked.healthy() && !place.leaving) all_ns += place.tracked.mean_ns();
  const double limit_ns = options_.load_share * options_.period_s * kFrameNsPerS;
  half_rate_ = all_ns > (half_rate_ ? kFullAgainShare * limit_ns : limit_ns);
}

/// A NaN force ends everything until the next release_contact(); a fade to a renderer that is too slow is
/// reversed.
void Mixer::watch_pair() noexcept {
  const bool lost =
      places_[felt_].tracked.disqualified() == Disqualified::kNonFinite ||
      (state_ == MixState::kFading && places_[to_].tracked.disqualified() == Disqualified::kNonFinite);
  if (!lost) return;
  dead_ = true;
  abort();
  aborted_ = false;  // reported in this frame
  report(MixDecision::kAborted, SwitchReason::kFault);
}

void Mixer::take_arrival(double t_s) noexcept {
  if (inbox_.load(std::memory_order_acquire) == nullptr) return;
  const std::size_t at = empty_place();
  if (at == kNobody) return;
  for (const Place& place : places_)
    if (place.arriving) return;
  std::unique_ptr<render::HapticRenderer> renderer(inbox_.load(std::memory_order_relaxed));
  Place& place = places_[at];
  place.lane = inbox_lane_;
  // Release: the lane has been read; the worker may write the next one.
  inbox_.store(nullptr, std::memory_order_release);
  place.arriving = true;
  generations_ = std::max(generations_, 1u) + 1;
  place.tracked.adopt(std::move(renderer), generations_, places_[felt_].tracked.last_free_mm(),
                      t_s - options_.period_s);
}

/// A new renderer replaces the old one of its lane, by the switching rules if that one is felt.
void Mixer::settle_arrival() noexcept {
  const auto found =
      std::find_if(places_.begin(), places_.end(), [](const Place& place) { return place.arriving; });
  if (found == places_.end()) return;
  const auto at = static_cast<std::size_t>(found - places_.begin());
  if (at == to_) return;
  const std::size_t old = in_lane(found->lane);
  if (old == kNobody || !found->tracked.healthy()) {
    report(MixDecision::kRefused,
           old == kNobody ? SwitchReason::kNoSuchRenderer : SwitchReason::kDisqualified);
    retire(at);
    return;
  }
  if (old == felt_ || old == to_) {
    if (state_ != MixState::kSteady) return;
    mixed_.request = {SwitchRequest::Kind::kSelect, SwitchSource::kParameters, found->lane};
    ask_for(at, time_.now_s());
    return;
  }
  if (!found->tracked.ready()) return;
  retire(old);
  found->arriving = false;
  report(MixDecision::kReplaced, SwitchReason::kNone);
}

void Mixer::retire(std::size_t at) noexcept {
  places_[at].leaving = true;
  places_[at].arriving = false;
}

void Mixer::hand_out() noexcept {
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (!places_[i].leaving || outbox_[i].load(std::memory_order_acquire) != nullptr) continue;
    outbox_[i].store(places_[i].tracked.release().release(), std::memory_order_release);
    places_[i].leaving = false;
  }
}

bool Mixer::offer(std::unique_ptr<render::HapticRenderer>& renderer, std::uint8_t lane) noexcept {
  if (inbox_.load(std::memory_order_acquire) != nullptr) return false;
  inbox_lane_ = lane;
  inbox_.store(renderer.release(), std::memory_order_release);
  return true;
}

std::unique_ptr<render::HapticRenderer> Mixer::take_retired() noexcept {
  for (auto& out : outbox_)
    if (render::HapticRenderer* const renderer = out.exchange(nullptr, std::memory_order_acq_rel))
      return std::unique_ptr<render::HapticRenderer>(renderer);
  return nullptr;
}

void Mixer::take_request(double t_s) noexcept {
  if (state_ == MixState::kFading) {
    const bool queued = slot_.peek().kind != SwitchRequest::Kind::kNone;
    if (queued && !queue_reported_) {
      mixed_.request = slot_.peek();
      report(MixDecision::kQueued, SwitchReason::kNone);
    }
    queue_reported_ = queued;
    return;
  }
  // One decision per frame: a second would hide the first.
  if (mixed_.decision != MixDecision::kNone) return;
  const SwitchRequest request = slot_.take();
  queue_reported_ = false;
  if (request.kind == SwitchRequest::Kind::kNone) return;
  mixed_.request = request;
  if (request.kind == SwitchRequest::Kind::kCancel) {
    if (state_ != MixState::kWaiting) return;
    drop_waiting();
    report(MixDecision::kCancelled, SwitchReason::kOverridden);
    return;
  }
  ask_for(request.kind == SwitchRequest::Kind::kNext ? next_lane() : in_lane(request.lane), t_s);
}

void Mixer::drop_waiting() noexcept {
  if (to_ != kNobody && places_[to_].arriving) retire(to_);
  state_ = MixState::kSteady;
  to_ = kNobody;
}

void Mixer::ask_for(std::size_t to, double t_s) noexcept {
  if (to == kNobody) return refuse(SwitchReason::kNoSuchRenderer);
  if (!places_[to].tracked.healthy()) return refuse(SwitchReason::kDisqualified);
  if (to == felt_) {
    if (state_ != MixState::kWaiting) return refuse(SwitchReason::kAlreadyFelt);
    drop_waiting();
    return report(MixDecision::kCancelled, SwitchReason::kOverridden);
  }
  if (state_ == MixState::kWaiting && to == to_) return;  // it is waited for already
  state_ = MixState::kWaiting;
  to_ = to;
  since_s_ = t_s;
  waits_for_free_ = catching_up_reported_ = false;
}

void Mixer::decide_waiting(const Vec3& hip_mm, double t_s) noexcept {
  TrackedRenderer& to = places_[to_].tracked;
  if (!to.healthy()) {
    drop_waiting();
    return refuse(SwitchReason::kDisqualified);
  }
  if (to.ready() && places_[felt_].tracked.ready()) return decide_by_rules(hip_mm, t_s);
  if (!std::exchange(catching_up_reported_, true)) report(MixDecision::kWaits, SwitchReason::kBringingUp);
}

void Mixer::decide_by_rules(const Vec3& hip_mm, double t_s) noexcept {
  const TrackedRenderer& from = places_[felt_].tracked;
  TrackedRenderer& to = places_[to_].tracked;
  if (from.is_free(hip_mm, t_s, options_) && to.is_free(hip_mm, t_s, options_)) {
    if (half_rate_) to.place(hip_mm);
    return take_over(MixDecision::kSwapped);
  }
  if (waits_for_free_) return;
  SwitchReason reason = SwitchReason::kNotFree;
  if (options_.rule != SwitchRule::kFreeSpace) {
    reason = half_rate_ ? SwitchReason::kHalfRate
                        : fade_refusal({from.frame().force_n, from.frame().contact},
                                       {to.frame().force_n, to.frame().contact},
                                       speed_.mm_s() / options_.world_per_device, options_);
    if (reason == SwitchReason::kNone) {
      state_ = MixState::kFading;
      since_s_ = t_s;
      weight_ = 0.0;
      return report(MixDecision::kFadeBegun, SwitchReason::kNone);
    }
    if (options_.rule == SwitchRule::kContactElseRefuse) {
      drop_waiting();
      return refuse(reason);
    }
  }
  waits_for_free_ = true;
  report(MixDecision::kWaits, reason);
}

void Mixer::advance_fade(double t_s) noexcept {
  if (places_[to_].tracked.disqualified() == Disqualified::kTooSlow) {
    // Reverses: w(1 - u) = 1 - w(u), so the force is continuous.
    std::swap(felt_, to_);
    since_s_ = t_s - (options_.fade_s - (t_s - since_s_));
    turned_back_ = true;
    report(MixDecision::kAborted, SwitchReason::kDisqualified);
  }
  const double u = (t_s - since_s_) / options_.fade_s;
  weight_ = raised_cosine(u);
  if (u >= 1.0) take_over(MixDecision::kFadeDone);
}

void Mixer::take_over(MixDecision decision) noexcept {
  const std::size_t old = std::exchange(felt_, std::exchange(to_, kNobody));
  weight_ = 0.0;
  state_ = MixState::kSteady;
  turned_back_ = false;
  if (places_[felt_].arriving) {
    places_[felt_].arriving = false;
    retire(old);
  }
  report(decision, SwitchReason::kNone);
}

void Mixer::refuse(SwitchReason reason) noexcept {
  report(MixDecision::kRefused, reason);
}

void Mixer::report(MixDecision decision, SwitchReason reason) noexcept {
  mixed_.decision = decision;
  mixed_.reason = reason;
}

std::size_t Mixer::in_lane(std::uint8_t lane) const noexcept {
  for (std::size_t i = 0; i < places_.size(); ++i)
    if (places_[i].tracked.present() && !places_[i].leaving && !places_[i].arriving &&
        places_[i].lane == lane)
      return i;
  return kNobody;
}

std::size_t Mixer::next_lane() const noexcept {
  for (std::size_t step = 1; step < lanes_; ++step) {
    const std::size_t at = in_lane(static_cast<std::uint8_t>((places_[felt_].lane + step) % lanes_));
    if (at != kNobody && places_[at].tracked.healthy()) return at;
  }
  return kNobody;
}

std::size_t Mixer::empty_place() const noexcept {
  for (std::size_t i = 0; i < places_.size(); ++i)
    if (!places_[i].tracked.present()) return i;
  return kNobody;
}

std::size_t Mixer::first_healthy() const noexcept {
  for (std::size_t i = 0; i < places_.size(); ++i)
    if (places_[i].tracked.healthy() && !places_[i].leaving && !places_[i].arriving) return i;
  return kNobody;
}

render::Frame Mixer::mix(double t_s) noexcept {
  mixed_.lift_off = state_ == MixState::kWaiting && waits_for_free_ && t_s - since_s_ > options_.lift_off_s;
  const render::Frame& from = places_[felt_].tracked.frame();
  if (state_ != MixState::kFading) return from;
  const render::Frame& to = places_[to_].tracked.frame();
  render::Frame frame = weight_ > 0.5 ? to : from;
  frame.force_n = (1.0 - weight_) * from.force_n + weight_ * to.force_n;
  return frame;
}

void Mixer::show(double t_s) noexcept {
  mixed_.t_s = t_s;
  mixed_.felt = dead_ ? kNobody : felt_;
  mixed_.to = to_;
  mixed_.state = state_;
  mixed_.half_rate = half_rate_;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    Place& place = places_[i];
    TrackedFrame& shown = mixed_.tracked[i];
    shown.present = place.tracked.present();
    if (!shown.present) {
      shown = {};
      continue;
    }
    shown.renderer = &place.tracked.renderer();
    shown.lane = place.lane;
    shown.generation = place.tracked.generation();
    shown.stepped = place.tracked.stepped();
    shown.ready = place.tracked.ready();
    shown.disqualified = place.tracked.disqualified();
    shown.frame = place.tracked.frame();
    shown.step_ns = shown.stepped ? place.tracked.step_ns() : 0;
    shown.weight = i == felt_ ? 1.0 - weight_ : i == to_ ? weight_ : 0.0;
    if (dead_) shown.weight = 0.0;
  }
}

render::FrameCounters Mixer::counters_of(std::uint8_t lane) const noexcept {
  const std::size_t at = in_lane(lane);
  return at == kNobody ? render::FrameCounters{} : places_[at].tracked.renderer().counters();
}

render::FrameCounters Mixer::counters() const noexcept {
  return felt_ == kNobody ? render::FrameCounters{} : places_[felt_].tracked.renderer().counters();
}

render::Description Mixer::describe() const {
  render::Description d;
  d.name = "mixer";
  d.source = "several renderers on one HIP, of which one is felt";
  for (const Place& place : places_) {
    if (!place.tracked.present()) continue;
    const render::Description one = place.tracked.renderer().describe();
    d.summary += (d.summary.empty() ? "one of: " : ", ") + one.name;
    d.work_bound += (d.work_bound.empty() ? "" : "; ") + one.name + ": " + one.work_bound;
  }
  d.work_bound += "; the mixer: some 300 instructions for each";
  return d;
}

}  // namespace palpate::device
