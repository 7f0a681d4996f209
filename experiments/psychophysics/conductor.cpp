#include "experiments/psychophysics/conductor.h"

#include <algorithm>
#include <utility>

namespace palpate::experiments::psychophysics {
namespace {

// Longer off the surface than a tap, and past the governor's soft start (0.5 s).
constexpr double kCalmS = 0.6;

}  // namespace

Conductor::Conductor(device::Mixer& mixer, const device::Servo& servo,
                     std::shared_ptr<device::HandGuide> guide, std::optional<device::HandScript> task,
                     std::size_t most_samples)
    : mixer_(mixer), servo_(servo), guide_(std::move(guide)), task_(std::move(task)) {
  trial_.samples.reserve(most_samples);
}

void Conductor::begin(const Passes& passes) noexcept {
  passes_ = passes;
  std::vector<FeltSample> room = std::move(trial_.samples);
  room.clear();
  trial_ = {};
  trial_.samples = std::move(room);
  begun_ = false;
  interval_.store(0, std::memory_order_relaxed);
  // Release: publishes the above to the servo.
  passage_.store(Passage::kDelay, std::memory_order_release);
}

FeltTrial Conductor::take() noexcept {
  trial_.map = servo_.map();
  passage_.store(Passage::kIdle, std::memory_order_release);
  return std::move(trial_);
}

void Conductor::return_room(FeltTrial&& trial) noexcept {
  trial_.samples = std::move(trial.samples);
}

void Conductor::ask(std::uint8_t lane) noexcept {
  mixer_.request({device::SwitchRequest::Kind::kSelect, device::SwitchSource::kProgram, lane});
}

bool Conductor::felt(std::uint8_t lane) const noexcept {
  const device::MixedFrame& mixed = mixer_.last();
  return mixed.state == device::MixState::kSteady && mixed.felt != device::MixedFrame::kNobody &&
         mixed.tracked[mixed.felt].lane == lane;
}

std::uint64_t Conductor::clipped() const noexcept {
  const device::ForceGovernor* const governor = servo_.governor();
  return governor == nullptr ? 0 : governor->counters().clamped + governor->counters().slewed;
}

void Conductor::watch_calm(const device::Tick& tick) noexcept {
  bool touches = tick.rearmed || tick.fault != device::Fault::kNone || !seen_;
  for (const device::TrackedFrame& one : mixer_.last().tracked)
    touches = touches || (one.present && (one.frame.contact || !one.ready));
  seen_ = true;
  if (touches) restless_s_ = tick.t_s;
  calm_.store(tick.t_s - restless_s_ >= kCalmS, std::memory_order_release);
}

void Conductor::note(const device::Tick& tick, Passage passage) noexcept {
  trial_.missed_deadlines += tick.missed;
  const std::uint64_t clipped_now = clipped();
  trial_.clipped_frames += clipped_now - clipped_before_;
  clipped_before_ = clipped_now;
  ++trial_.frames;
  const auto& tracked = mixer_.last().tracked;
  trial_.whole_frames += std::all_of(tracked.begin(), tracked.end(), [](const device::TrackedFrame& one) {
    return !one.present || one.stepped;
  });
  if (trial_.samples.size() == trial_.samples.capacity()) {
    ++trial_.samples_lost;
    return;
  }
  FeltSample sample;
  sample.t_s = tick.t_s;
  sample.interval = passage == Passage::kInterval || passage == Passage::kLeaving
                        ? interval_.load(std::memory_order_relaxed)
                        : 0;
  sample.at_mm = tick.state.position_mm;
  sample.force_n = tick.sent_n;
  sample.contact = tick.frame.contact;
  trial_.samples.push_back(sample);
}

void Conductor::guide_hand(const device::Tick& tick, Passage passage) noexcept {
  if (!guide_ || !task_) return;
  // Off the surface, above the next interval's start.
  double within_s = 0.0;
  if (passage == Passage::kInterval) within_s = tick.t_s - since_s_;
  if (passage == Passage::kLeaving) within_s = task_->duration_s();
  guide_->aim(task_->at(within_s).position_mm);
}

void Conductor::advance(const device::Tick& tick, Passage passage) noexcept {
  const auto go = [&](Passage to) {
    since_s_ = tick.t_s;
    passage_.store(to, std::memory_order_release);
  };
  if (tick.fault != device::Fault::kNone) return go(Passage::kBroken);
  if (mixer_.last().decision == device::MixDecision::kRefused) return go(Passage::kStuck);
  const std::uint32_t done = interval_.load(std::memory_order_relaxed);
  switch (passage) {
    case Passage::kDelay:
      if (!felt(kNothingLane)) ask(kNothingLane), since_s_ = tick.t_s;
      if (tick.t_s - since_s_ < passes_.delay_s) return;
      ask(passes_.lanes[done]);
      return go(Passage::kEntering);
    case Passage::kEntering:
      if (!felt(passes_.lanes[done])) return;
      interval_.store(done + 1, std::memory_order_release);
      return go(Passage::kInterval);
    case Passage::kInterval:
      if (tick.t_s - since_s_ < passes_.interval_s) return;
      ask(kNothingLane);
      return go(Passage::kLeaving);
    case Passage::kLeaving:
      if (!felt(kNothingLane)) return;
      return go(done < passes_.count ? Passage::kDelay : Passage::kDone);
    case Passage::kIdle:
    case Passage::kDone:
    case Passage::kBroken:
    case Passage::kStuck:
      return;
  }
}

void Conductor::took(const device::Tick& tick) noexcept {
  watch_calm(tick);
  const Passage passage = passage_.load(std::memory_order_acquire);
  guide_hand(tick, passage);
  const bool ours = passage == Passage::kDelay || passage == Passage::kEntering ||
                    passage == Passage::kInterval || passage == Passage::kLeaving;
  if (!ours) return;
  if (!begun_) {
    begun_ = true;
    since_s_ = tick.t_s;
    clipped_before_ = clipped();
  }
  note(tick, passage);
  advance(tick, passage);
}

}  // namespace palpate::experiments::psychophysics
