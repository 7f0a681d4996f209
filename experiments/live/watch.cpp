#include "experiments/live/session.h"

#include <algorithm>
#include <cmath>

namespace palpate::experiments {
namespace {

using device::MixDecision;
using device::MixedFrame;

/// Share of `index` in a frame's force.
double weight_of(const MixedFrame& frame, std::size_t index) {
  return index < frame.tracked.size() ? frame.tracked[index].weight : 0.0;
}

/// True for a lane's representative. A lane being replaced has two renderers: the felt one represents it,
/// else the older.
bool speaks_for_its_lane(const MixedFrame& frame, std::size_t index) {
  if (index == frame.felt) return true;
  const device::TrackedFrame& one = frame.tracked[index];
  for (std::size_t i = 0; i < frame.tracked.size(); ++i) {
    const device::TrackedFrame& other = frame.tracked[i];
    if (i == index || !other.present || other.lane != one.lane) continue;
    if (i == frame.felt || other.generation < one.generation) return false;
  }
  return true;
}

}  // namespace

LiveWatch::LiveWatch(const device::Mixer& mixer, std::size_t lanes, double stretch_s,
                     double stiffness_n_per_mm)
    : mixer_(mixer), lanes_(lanes), stretch_s_(stretch_s) {
  for (Lane& lane : lanes_) lane.felt_steps = metrics::ForceSteps(stiffness_n_per_mm);
  decisions_.reserve(kMostDecisions);
  samples_.resize(kLiveSamples + 1);
  for (LiveSample& one : samples_) one.each_n.resize(lanes);
}

void LiveWatch::took(const device::Tick& tick) noexcept {
  if (!begun_) begun_s_ = tick.t_s;
  begun_ = true;
  ++ticks_;
  if (tick.rearmed && ticks_ > 1) ++rearmed_;
  const bool faulted = tick.fault != device::Fault::kNone;
  if (faulted && !faulted_) {
    ++faults_;
    fault_seen_[std::min(static_cast<std::size_t>(tick.fault), fault_seen_.size() - 1)] = true;
  }
  faulted_ = faulted;
  if (faulted || tick.rearmed) {
    has_before_ = false;
    for (Lane& lane : lanes_) lane.felt_steps.interrupt();
    if (faulted) return;
  }
  const MixedFrame& now = mixer_.last();
  if (now.half_rate) ++half_rate_;
  watch_lanes(tick, now);
  if (has_before_) watch_steps(now);
  note_decision(tick, now);
  sample(tick, now);
  before_ = now;
  has_before_ = true;
}

void LiveWatch::watch_lanes(const device::Tick& tick, const MixedFrame& now) noexcept {
  for (std::size_t i = 0; i < now.tracked.size(); ++i) {
    const device::TrackedFrame& one = now.tracked[i];
    if (!one.present || one.lane >= lanes_.size()) continue;
    Lane& lane = lanes_[one.lane];
    if (one.stepped) lane.step.count(one.step_ns);
    if (!speaks_for_its_lane(now, i)) continue;
    const bool same = lane.known && lane.generation == one.generation;
    if (lane.known && !same) ++lane.made;
    if (same && has_before_ && one.stepped)
      lane.largest_step_n = std::max(lane.largest_step_n, (one.frame.force_n - lane.last_n).norm());
    if (!same || i != now.felt) lane.felt_steps.interrupt();
    if (i == now.felt) lane.felt_steps.observe(tick.t_s - begun_s_, tick.hip_mm, one.frame.force_n);
    lane.known = true;
    lane.generation = one.generation;
    lane.last_n = one.frame.force_n;
    lane.disqualified = one.disqualified;
    if (one.stepped) {
      ++lane.frames;
      if (one.frame.contact) ++lane.contact_frames;
    }
    if (i == now.felt) ++lane.felt_frames;
  }
}

/// A step of the sent force consists of the renderers' weighted steps and the weights' change: |dw| times the
/// two forces' difference.
void LiveWatch::watch_steps(const MixedFrame& now) noexcept {
  const double step_n = (now.force_n - before_.force_n).norm();
  largest_step_n_ = std::max(largest_step_n_, step_n);
  double own_n = 0.0, weights_n = 0.0;
  Vec3 reference_n = Vec3::Zero();
  bool has_reference = false;
  for (std::size_t i = 0; i < now.tracked.size(); ++i) {
    const double before = weight_of(before_, i), after = weight_of(now, i);
    if (before == 0.0 && after == 0.0) continue;
    own_n = std::max(own_n, (now.tracked[i].frame.force_n - before_.tracked[i].frame.force_n).norm());
    if (!has_reference) reference_n = before_.tracked[i].frame.force_n;
    has_reference = true;
    weights_n += std::abs(after - before) * (before_.tracked[i].frame.force_n - reference_n).norm();
  }
  largest_excess_n_ = std::max(largest_excess_n_, step_n - own_n - weights_n);
}

void LiveWatch::note_decision(const device::Tick& tick, const MixedFrame& now) noexcept {
  // A decision may follow its request frames later.
  if (now.request.kind != device::SwitchRequest::Kind::kNone) source_ = now.request.source;
  if (now.decision == MixDecision::kNone) return;
  if (now.decision == MixDecision::kSwapped || now.decision == MixDecision::kFadeDone) ++switches_;
  if (now.decision == MixDecision::kFadeBegun) ++fades_;
  if (now.decision == MixDecision::kRefused) ++refused_;
  if (now.decision == MixDecision::kWaits) ++waited_;
  if (decisions_.size() == kMostDecisions) {
    ++decisions_lost_;
    return;
  }
  LiveDecision one;
  one.t_s = tick.t_s - begun_s_;
  one.source = source_;
  one.decision = now.decision;
  one.reason = now.reason;
  const bool switched = now.decision == MixDecision::kSwapped || now.decision == MixDecision::kFadeDone;
  const std::size_t from = switched && has_before_ ? before_.felt : now.felt;
  const std::size_t to = switched ? now.felt : now.to;
  if (from < now.tracked.size()) one.from = one.to = now.tracked[from].lane;
  if (to < now.tracked.size()) one.to = now.tracked[to].lane;
  one.before_n = has_before_ ? before_.force_n.norm() : 0.0;
  if (from < now.tracked.size() && to < now.tracked.size())
    one.difference_n = (now.tracked[from].frame.force_n - now.tracked[to].frame.force_n).norm();
  decisions_.push_back(one);
}

void LiveWatch::sample(const device::Tick& tick, const MixedFrame& now) noexcept {
  const auto at = static_cast<std::size_t>(std::max(0.0, (tick.t_s - begun_s_) / stretch_s_));
  if (at >= samples_.size()) return;
  if (at != sample_) in_sample_ = 0;
  sample_ = at;
  ++in_sample_;
  LiveSample& into = samples_[at];
  const double share = 1.0 / static_cast<double>(in_sample_);
  into.t_s += share * (tick.t_s - begun_s_ - into.t_s);
  into.out_n += share * (now.force_n.norm() - into.out_n);
  for (std::size_t lane = 0; lane < lanes_.size(); ++lane)
    into.each_n[lane] += share * (lanes_[lane].last_n.norm() - into.each_n[lane]);
}

void LiveWatch::tell(LiveDocument& document) const {
  document.ticks = ticks_;
  document.faults = faults_;
  document.rearmed = rearmed_;
  document.half_rate_ticks = half_rate_;
  document.switches = switches_;
  document.fades = fades_;
  document.refused = refused_;
  document.waited = waited_;
  document.largest_step_n = largest_step_n_;
  document.largest_excess_n = std::max(0.0, largest_excess_n_);
  document.decisions_lost = decisions_lost_;
  document.decisions = decisions_;
  for (std::size_t i = 0; i < fault_seen_.size(); ++i)
    if (fault_seen_[i]) document.fault_names.emplace_back(device::fault_name(static_cast<device::Fault>(i)));
  for (std::size_t i = 0; i < lanes_.size() && i < document.renderers.size(); ++i) {
    LiveRenderer& to = document.renderers[i];
    const Lane& lane = lanes_[i];
    to.frames = lane.frames;
    to.contact_frames = lane.contact_frames;
    to.felt_frames = lane.felt_frames;
    to.step = lane.step.statistics();
    to.largest_step_n = lane.largest_step_n;
    to.felt_steps = lane.felt_steps;
    to.made = lane.made;
    to.disqualified = device::disqualified_text(lane.disqualified);
  }
  for (const LiveSample& one : samples_)
    if (one.t_s > 0.0) document.samples.push_back(one);
}

}  // namespace palpate::experiments
