#include "experiments/psychophysics/rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include <palpate/result.h>
#include "device/live/hand_controls.h"
#include "experiments/live/changes.h"
#include "experiments/psychophysics/bench.h"
#include "experiments/psychophysics/psychometric.h"
#include "toolkit/render/prepare.h"

namespace palpate::experiments::psychophysics {
namespace {

// Upper bound only: a person's session ends with the study.
constexpr double kLongestSessionS = 86'400.0;

SessionSettings rig_settings(double rate_hz) {
  SessionSettings settings;
  settings.rate_hz = rate_hz;
  settings.seconds = kLongestSessionS;
  settings.label = "study";
  return settings;
}

/// One trial, which ends the session.
class OneTrial final : public SessionTasks {
 public:
  OneTrial(Rig& rig, const Passes& passes, double longest_s)
      : rig_(rig), passes_(passes), longest_s_(longest_s) {}
  void work(double now_s) override {
    Conductor& conductor = rig_.conductor();
    const Passage passage = conductor.passage();
    if (passage == Passage::kIdle && conductor.calm()) conductor.begin(passes_);
    if (passage == Passage::kDone || passage == Passage::kBroken || passage == Passage::kStuck ||
        now_s > longest_s_)
      rig_.assembly().request_stop();
  }
  void key(char /*pressed*/) override {}

 private:
  Rig& rig_;
  Passes passes_;
  double longest_s_;
};

}  // namespace

Status Rig::seat(SessionDevice& device, Progress& progress) {
  const SessionSettings settings = rig_settings(bench_.options().rate_hz);
  PALPATE_ASSIGN(limits_, device.limits());
  PALPATE_ASSIGN(map_, device::map_for(render::box_of(bench_.stage().scene.input.models), limits_, {}));
  PALPATE_ASSIGN(const device::ForceGovernor governor,
                 device::ForceGovernor::create(limits_, Assembly::governor_options(settings)));
  force_limit_n_ = governor.limit_n();
  free_mm_ = bench_.stage().path.hip_mm.front();
  if (!device.is_simulated_hand()) return Done{};
  PALPATE_ASSIGN(task_, bench_.task(map_, progress));
  const Vec3 start_mm = task_->at(0.0).position_mm;
  free_mm_ = map_.world_mm(start_mm);
  guide_ = std::make_shared<device::HandGuide>(start_mm);
  device.hold(device::HandScript::guided("trials", guide_));
  return Done{};
}

Status Rig::mix(double level, Progress& progress) {
  device::SwitchOptions switching;
  switching.rule = device::SwitchRule::kFreeSpace;
  switching.device_force_max_n = limits_.force_max_n;
  switching.force_limit_n = force_limit_n_;
  switching.world_per_device = map_.world_per_device;
  switching.period_s = 1.0 / bench_.options().rate_hz;
  PALPATE_TRY(device::check(switching));
  auto mixer = std::make_unique<device::Mixer>(switching, clock_.clock(), clock_.machine_clock());
  mixer_ = mixer.get();
  mixer->add(std::make_unique<Nothing>());
  for (std::uint8_t lane = 1; lane <= bench_.lanes(); ++lane) {
    PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> made, bench_.renderer(lane, level, progress));
    mixer->add(std::move(made));
  }
  const Stage& stage = bench_.stage();
  control::ControlOptions around_all;
  around_all.passivity = stage.scene.control.passivity;
  felt_ = control::wrap(std::move(mixer), around_all);
  // Wraps the mixer once, so all renderers see the models at the same place.
  if (stage.scene.input.simulation)
    felt_ = std::make_unique<MovingScene>(std::move(felt_), *stage.scene.input.simulation);
  return Done{};
}

Result<std::unique_ptr<Rig>> Rig::make(Bench& bench, SessionClock& clock, SessionDevice& device, double level,
                                       Progress& progress) {
  std::unique_ptr<Rig> rig(new Rig(bench, clock));
  PALPATE_TRY(rig->seat(device, progress));
  PALPATE_TRY(rig->mix(level, progress));
  SessionSettings settings = rig_settings(bench.options().rate_hz);
  settings.free_mm = rig->free_mm_;
  settings.auto_rearm = device.is_simulated_hand();
  rig->assembly_ = std::make_unique<Assembly>(settings, clock, device, *rig->felt_, rig->map_);
  rig->conductor_ = std::make_unique<Conductor>(*rig->mixer_, rig->assembly_->servo(), rig->guide_,
                                                rig->task_, bench.most_samples());
  rig->assembly_->observe(*rig->conductor_);
  return rig;
}

Result<std::unique_ptr<render::HapticRenderer>> Rig::renderer_of(double level, Progress& progress) {
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> made, bench_.renderer(kLaneOfB, level, progress));
  made->restart(free_mm_, 0.0);
  return made;
}

Result<FeltTrial> feel_alone(Bench& bench, const DeviceChoice& choice, const Passes& passes, double level,
                             ProgressBar& progress) {
  SessionClock clock(true);
  PALPATE_ASSIGN(SessionDevice device,
                 SessionDevice::make(choice, clock.clock(), 1.0 / bench.options().rate_hz));
  PALPATE_ASSIGN(const std::unique_ptr<Rig> rig, Rig::make(bench, clock, device, level, progress));
  OneTrial tasks(*rig, passes, static_cast<double>(bench.most_samples()) / bench.options().rate_hz);
  PALPATE_ASSIGN(const SessionEnd end, rig->run(tasks, progress));
  switch (rig->conductor().passage()) {
    case Passage::kDone:
      return rig->conductor().take();
    case Passage::kBroken:
      return Error{
          fmt::format("a fault stopped the trial: {}", device::fault_name(rig->assembly().watch().fault())),
          "look at what this renderer does with `palpate live`"};
    default:
      return Error{
          "the simulated hand did not get through a trial: it did not come free of the surface",
          "give the intervals more time ([trials] interval_s), or press less (the observer's option depth)"};
  }
}

Status write_trace(const OutputFolder& folder, std::uint64_t trial, const FeltTrial& felt) {
  PALPATE_ASSIGN(const OutputFolder traces, folder.inside(kTracesFolder));
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,interval\n");
  for (const FeltSample& one : felt.samples) {
    const Vec3 hip = felt.map.world_mm(one.at_mm), force = felt.map.world_n(one.force_n);
    fmt::format_to(out, "{},{},{},{},{},{},{},{},{}\n", one.t_s, hip.x(), hip.y(), hip.z(), force.x(),
                   force.y(), force.z(), one.contact ? 1 : 0, one.interval);
  }
  return traces.write(fmt::format("trial-{:04}.csv", trial), {text.data(), text.size()});
}

namespace {

/// The cue that differs most; the first of equals.
std::size_t widest(const CueScales& differences) {
  std::size_t at = 0;
  for (std::size_t c = 1; c < kCues; ++c)
    if (std::abs(differences[c]) > std::abs(differences[at])) at = c;
  return at;
}

CueScales spread(const std::vector<CueScales>& intervals) {
  CueScales widths{};
  for (std::size_t c = 0; c < kCues; ++c) {
    const auto [low, high] =
        std::minmax_element(intervals.begin(), intervals.end(),
                            [c](const CueScales& a, const CueScales& b) { return a[c] < b[c]; });
    widths[c] = (*high)[c] - (*low)[c];
  }
  return widths;
}

}  // namespace

std::span<const FeltSample> samples_of(const FeltTrial& felt, std::uint32_t interval) noexcept {
  const auto is = [interval](const FeltSample& one) { return one.interval == interval; };
  const auto first = std::find_if(felt.samples.begin(), felt.samples.end(), is);
  const auto last = std::find_if_not(first, felt.samples.end(), is);
  return {first, last};
}

std::vector<CueScales> Machine::scales(const FeltTrial& felt) const {
  std::vector<CueScales> all;
  for (std::uint32_t i = 1; i <= intervals_of(plan_.task); ++i)
    all.push_back(
        scales_of(cues_of(samples_of(felt, i), spec_.thresholds), spec_.thresholds, way_a_, way_b_));
  return all;
}

Status Machine::learn(ProgressBar& progress) {
  // Uses the easiest pair; in a comparison, the two renderers themselves.
  Trial pair;
  pair.level = easiest_level(plan_);
  pair.shown = "AB";
  PALPATE_ASSIGN(const FeltTrial felt,
                 feel_alone(bench_, device_, bench_.passes(pair), pair.level, progress));
  const Cues a = cues_of(samples_of(felt, 1), spec_.thresholds),
             b = cues_of(samples_of(felt, 2), spec_.thresholds);
  if (!a.touched && !b.touched)
    return Error{"the simulated hand touches nothing of this scene",
                 "take another hand (machine:hand=explore), or press deeper (machine:depth=6)", plan_.name};
  way_a_ = a.direction;
  way_b_ = b.direction;
  of_a_ = scales_of(a, spec_.thresholds, way_a_, way_b_);
  const CueScales of_b = scales_of(b, spec_.thresholds, way_a_, way_b_);
  for (std::size_t c = 0; c < kCues; ++c) apart_[c] = of_b[c] - of_a_[c];
  return Done{};
}

/// Each interval's strength in sensation deviations from A, positive towards B.
std::vector<double> Machine::strengths(const std::vector<CueScales>& intervals) const {
  // A single interval is judged by the cue that best separated the pair.
  const std::size_t cue = widest(intervals.size() > 1 ? spread(intervals) : apart_);
  const double unit = dprime_at_jnd(Task::kTwoInterval), way = apart_[cue] < 0.0 ? -1.0 : 1.0;
  std::vector<double> all;
  for (const CueScales& one : intervals) all.push_back(unit * way * (one[cue] - of_a_[cue]));
  return all;
}

Result<std::vector<double>> Machine::feel(const Trial& trial, FeltTrial& felt, ProgressBar& progress) {
  PALPATE_ASSIGN(felt, feel_alone(bench_, device_, bench_.passes(trial), trial.level, progress));
  return strengths(scales(felt));
}

Result<Answer> Machine::answer(const Trial& trial, FeltTrial& felt, ProgressBar& progress) {
  PALPATE_ASSIGN(std::vector<double> sensed, feel(trial, felt, progress));
  ObserverOptions deciding = spec_.options;
  deciding.dprime = dprime_at_jnd(Task::kTwoInterval) * std::abs(apart_[widest(apart_)]);
  Answer answer = answer_of(deciding, {plan_.task, trial.number, std::move(sensed)}, answer_seed(plan_));
  answer.missed_deadlines = felt.missed_deadlines;
  answer.clipped_frames = felt.clipped_frames;
  return answer;
}

}  // namespace palpate::experiments::psychophysics
