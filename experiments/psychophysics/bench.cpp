#include "experiments/psychophysics/bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include <palpate/result.h>
#include "experiments/live/hand.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments::psychophysics {

render::Frame HeldRate::step(const Vec3& hip_mm, double t_s) noexcept {
  // A due time within a thousandth of a period counts as reached, since times are rounded sums.
  constexpr double kRounding = 1e-3;
  if (t_s + kRounding * period_s_ < due_s_) return held_;
  due_s_ += period_s_;
  if (due_s_ <= t_s) due_s_ = t_s + period_s_;  // missed times are skipped
  held_ = inner().step(hip_mm, t_s);
  return held_;
}

namespace {

// In catch trials of a comparison the other renderer is A at half the scene's stiffness: more than three
// times the largest known Weber fraction for it (8 to 23 %), without clipping or instability.
constexpr double kCatchStiffness = 0.5;
// Frames of the path on which the hand seeks a place and explores.
constexpr int kPathFrames = 4000;
// Spacing of a task's waypoints.
constexpr double kGoalEveryS = 5e-3;
// Extra room for samples beyond a trial's intervals and delays, for a hand that lifts off late.
constexpr double kWaitingS = 10.0;
// Phases of a task as shares of the interval, free at both ends so that the next renderer can take over.
constexpr double kDownFrom = 0.1, kDownAt = 0.35, kTurnAt = 0.5, kUpFrom = 0.65, kUpAt = 0.8;

bool changes_scene(const std::string& key) {
  return key == "spacing" || key == "noise";
}

Status set_in_scene(scene::SceneFile& file, const std::string& key, double value, const std::string& plan) {
  for (scene::SceneModel& model : file.models) {
    if (!model.generate)
      return Error{fmt::format("{} can only be turned on a generated scene", key),
                   "name a generator as the scene, such as sinusoid:points=10201", plan};
    Options options;
    for (const auto& [name, text] : model.generate->options.all())
      if (key != "spacing" || (name != "points" && name != "spacing_mm")) options.set(name, text);
    options.set(key == "spacing" ? "spacing_mm" : "noise", fmt::format("{}", value));
    model.generate->options = std::move(options);
  }
  return Done{};
}

Result<device::HandScript> task_at(const std::string& hand, const device::TaskPlace& place, double depth_mm,
                                   double interval_s) {
  const device::TaskSizes sizes;
  // A sideways motion starts this high, free over slopes of up to 45 degrees.
  const double above_mm = hand == "slide" ? std::max(sizes.above_mm, 0.5 * sizes.travel_mm) : sizes.above_mm;
  const Vec3 up = above_mm * place.normal, down = -depth_mm * place.normal;
  const Vec3 aside = hand == "slide" ? Vec3(0.5 * sizes.travel_mm * place.along) : Vec3(Vec3::Zero());
  const Vec3 from = place.point_mm - aside, to = place.point_mm + aside;
  std::vector<double> t_s;
  for (const double share : {0.0, kDownFrom, kDownAt, kTurnAt, kUpFrom, kUpAt, 1.0})
    t_s.push_back(share * interval_s);
  return device::HandScript::create(
      hand, std::move(t_s), {from + up, from + up, from + down, to + down, from + down, from + up, from + up},
      device::HandScript::Between::kMinimumJerk);
}

/// Goes along the path and back.
Result<device::HandScript> exploring_task(const trace::ProbePath& path, const device::DeviceMap& map,
                                          double interval_s) {
  std::vector<double> t_s;
  std::vector<Vec3> goal_mm;
  const double rows_a_s = static_cast<double>(path.size() - 1) / (path.t_s.back() - path.t_s.front());
  for (double t = 0.0; t < interval_s; t += kGoalEveryS) {
    const double way_s = std::min(t, kUpAt * interval_s - t);
    const auto row = static_cast<std::size_t>(std::max(0.0, way_s) * rows_a_s);
    t_s.push_back(t);
    goal_mm.push_back(map.device_mm(path.hip_mm[std::min(row, path.size() - 1)]));
  }
  return device::HandScript::create("explore", std::move(t_s), std::move(goal_mm),
                                    device::HandScript::Between::kStraight);
}

}  // namespace

Bench::Bench(const Plan& plan, const BenchOptions& options)
    : plan_(plan), options_(options), registry_(all_renderers()) {}

Result<std::unique_ptr<Bench::Bay>> Bench::make_bay(std::optional<double> value, Progress& progress) const {
  RunArguments run;
  run.scene = plan_.scene;
  run.reference = "none";  // no scoring
  ProgressBar quiet;
  PALPATE_ASSIGN(CheckedRun checked, check_run(run, registry_, quiet));
  quiet.clear();
  if (value) PALPATE_TRY(set_in_scene(checked.stage.scene, plan_.option->key, *value, plan_.name));
  checked.stage.usual_frames = kPathFrames;
  PALPATE_ASSIGN(Stage stage, set_up(checked.stage, all_readers(), progress));
  auto bay = std::make_unique<Bay>();
  bay->stage = std::make_unique<Stage>(std::move(stage));
  bay->workshop.reset(new Workshop{*bay->stage, registry_, run.load.threads, options_.paced});
  return bay;
}

Result<std::unique_ptr<Bench>> Bench::make(const Plan& plan, const BenchOptions& options,
                                           Progress& progress) {
  std::unique_ptr<Bench> bench(new Bench(plan, options));
  PALPATE_TRY(bench->check_values());
  PALPATE_ASSIGN(bench->standard_, bench->make_bay(std::nullopt, progress));
  return bench;
}

std::uint8_t Bench::lanes() const noexcept {
  return plan_.compares() && plan_.catch_every > 0 ? kLaneOfCatch : kLaneOfB;
}

Passes Bench::passes(const Trial& trial) const noexcept {
  Passes passes;
  passes.count = trial.shown.size();
  passes.interval_s = plan_.interval_s;
  passes.delay_s = plan_.switch_delay_s;
  const bool easy = plan_.compares() && trial.kind == TrialKind::kCatch;
  for (std::size_t i = 0; i < passes.count; ++i)
    passes.lanes[i] = trial.shown[i] == 'A' ? kLaneOfA : easy ? kLaneOfCatch : kLaneOfB;
  return passes;
}

std::size_t Bench::most_samples() const noexcept {
  const double seconds =
      static_cast<double>(intervals_of(plan_.task)) * (plan_.interval_s + plan_.switch_delay_s) + kWaitingS;
  return static_cast<std::size_t>(seconds * options_.rate_hz);
}

/// `value` matters only where an option is varied.
Result<LiveSetting> Bench::setting(std::uint8_t lane, double value) const {
  LiveSetting setting;
  const std::string& text = plan_.option ? plan_.option->renderer : lane == kLaneOfB ? plan_.b : plan_.a;
  PALPATE_ASSIGN(const std::vector<RendererRequest> requests, parse_renderers(text, registry_));
  setting.request = requests.front();
  if (!plan_.option) return setting;
  const std::string& key = plan_.option->key;
  if (key == "stiffness")
    setting.stiffness_n_per_mm = value;
  else if (key != "rate" && !changes_scene(key))
    setting.request.options.set(key, fmt::format("{}", value));
  return setting;
}

Status Bench::check_values() const {
  if (!plan_.option) return Done{};
  std::vector<double> levels = plan_.levels;
  levels.push_back(0.0);
  levels.push_back(easiest_level(plan_));
  for (const double level : levels) {
    const double value = plan_.option->value_at(level);
    const Error wrong{
        fmt::format("{} = {:g} is asked for, and cannot be felt", plan_.option->key, value), {}, plan_.name};
    const bool from_nothing = plan_.option->key == "noise";
    if (!(from_nothing ? value >= 0.0 : value > 0.0))
      return Error{wrong.what, "keep the differences within the standard", plan_.name};
    if (plan_.option->key == "rate" && value > options_.rate_hz)
      return Error{wrong.what, fmt::format("the servo runs at {:g} Hz: keep below it", options_.rate_hz),
                   plan_.name};
    PALPATE_ASSIGN(const LiveSetting made, setting(kLaneOfB, value));
    const auto able = registry_.make(made.request.name, made.request.options);
    if (!able) return Error{wrong.what + ": " + able.error().what, able.error().remedy, plan_.name};
  }
  return Done{};
}

Result<Bench::Bay*> Bench::bay_of(double value, Progress& progress) {
  if (!plan_.option || !changes_scene(plan_.option->key)) return standard_.get();
  auto found = bays_.find(value);
  if (found == bays_.end()) {
    PALPATE_ASSIGN(std::unique_ptr<Bay> bay, make_bay(value, progress));
    found = bays_.emplace(value, std::move(bay)).first;
  }
  return found->second.get();
}

Result<std::unique_ptr<render::HapticRenderer>> Bench::renderer(std::uint8_t lane, double level,
                                                                Progress& progress) {
  const double value = plan_.option ? plan_.option->value_at(lane == kLaneOfA ? 0.0 : level) : 0.0;
  PALPATE_ASSIGN(Bay* const bay, bay_of(value, progress));
  PALPATE_ASSIGN(LiveSetting made_as, setting(lane, value));
  if (lane == kLaneOfCatch)
    made_as.stiffness_n_per_mm =
        kCatchStiffness * bay->stage->scene.input.models.front().surface.stiffness_n_per_mm;
  PALPATE_ASSIGN(MadeRenderer made, make_live(*bay->workshop, made_as, progress));
  if (plan_.option && plan_.option->key == "rate")
    return std::unique_ptr<render::HapticRenderer>(
        std::make_unique<HeldRate>(std::move(made.renderer), value));
  return std::move(made.renderer);
}

Result<device::HandScript> Bench::task(const device::DeviceMap& map, Progress& progress) {
  const trace::ProbePath& path = stage().path;
  if (options_.hand == "explore") return exploring_task(path, map, plan_.interval_s);
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> toucher, renderer(kLaneOfA, 0.0, progress));
  PALPATE_ASSIGN(const device::TaskPlace place, touched_place(path, *toucher, map));
  return task_at(options_.hand, place, options_.depth_mm, plan_.interval_s);
}

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
