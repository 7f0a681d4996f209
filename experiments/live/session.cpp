#include "experiments/live/session.h"

#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <thread>

#include "device/safety/watchdog.h"
#include "experiments/live/hand.h"
#include "experiments/live/keys.h"
#include "experiments/live/live_recording.h"
#include "experiments/live/moving_scene.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

constexpr double kLiveNsPerS = 1e9, kLiveMsPerS = 1e3;
// How often the main thread looks at keys, changes and the bar: a person sees no delay of it.
constexpr std::chrono::milliseconds kLook{20};
// A fault is shown for so long before it is armed again, where that is asked for.
constexpr double kRearmAfterS = 1.0;

/// What the process has in memory; what was freed is given back first.
std::uint64_t resident_bytes() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  std::uint64_t pages = 0, in_memory = 0;
  file >> pages >> in_memory;
  return in_memory * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

/// Asks for the next renderer at fixed times of the session.
class SwitchTimer final : public device::TickObserver {
 public:
  SwitchTimer(device::Mixer& mixer, double every_s) : mixer_(mixer), every_s_(every_s) {}
  void took(const device::Tick& tick) noexcept override {
    if (!begun_) next_s_ = tick.t_s + every_s_;
    begun_ = true;
    if (!(every_s_ > 0.0) || tick.t_s < next_s_) return;
    // Not from the last time on: what was late would add up.
    while (next_s_ <= tick.t_s) next_s_ += every_s_;
    mixer_.request({device::SwitchRequest::Kind::kNext, device::SwitchSource::kTimer, 0});
  }

 private:
  device::Mixer& mixer_;
  double every_s_;
  double next_s_ = 0.0;
  bool begun_ = false;
};

/// Arms again a while after a fault.
class Rearmer final : public device::TickObserver {
 public:
  explicit Rearmer(bool on) : on_(on) {}
  void took(const device::Tick& tick) noexcept override {
    const bool faulted = tick.fault != device::Fault::kNone;
    if (faulted && !faulted_) since_s_ = tick.t_s;
    faulted_ = faulted;
    if (!on_ || !faulted || tick.t_s - since_s_ < kRearmAfterS) return;
    since_s_ = tick.t_s;
    if (loop_ != nullptr) loop_->request_rearm();
    if (thread_ != nullptr) thread_->request_rearm();
  }
  [[nodiscard]] bool faulted() const noexcept { return faulted_; }
  /// Before the first tick.
  void of(device::ServoLoop& loop) noexcept { loop_ = &loop; }
  void of(device::ServoThread& thread) noexcept { thread_ = &thread; }

 private:
  bool on_;
  bool faulted_ = false;
  double since_s_ = 0.0;
  device::ServoLoop* loop_ = nullptr;
  device::ServoThread* thread_ = nullptr;
};

/// Makes renderers while the session runs, hands them over, and destroys those that come back.
class Worker {
 public:
  /// `recording`: null where none is made.
  Worker(Workshop& workshop, const std::vector<LiveChange>& changes, device::Mixer& mixer,
         const Vec3& free_mm, LiveRecording* recording, const Clock& clock)
      : workshop_(workshop),
        changes_(changes),
        mixer_(mixer),
        free_mm_(free_mm),
        recording_(recording),
        clock_(clock) {}

  /// What is due at `now_s` of the session; may take as long as a preparation. Never in the servo's thread,
  /// but for a virtual clock, which stands still meanwhile.
  void work(double now_s) {
    while (mixer_.take_retired()) {
    }
    if (pending_ && mixer_.offer(pending_, lane_)) return;
    if (pending_ || next_ == changes_.size() || now_s < changes_[next_].at_s) return;
    const LiveChange& change = changes_[next_++];
    Result<std::unique_ptr<render::HapticRenderer>> made = make(change.setting);
    if (!made) {
      failures_.push_back(fmt::format("The change of {} at {:g} s was not made: {}",
                                      change.setting.request.label, change.at_s, made.error().message()));
      return;
    }
    (*made)->restart(free_mm_, 0.0);
    pending_ = *std::move(made);
    lane_ = static_cast<std::uint8_t>(change.lane);
    (void)mixer_.offer(pending_, lane_);
  }
  [[nodiscard]] const std::vector<std::string>& failures() const { return failures_; }

 private:
  Result<std::unique_ptr<render::HapticRenderer>> make(const LiveSetting& setting) {
    PALPATE_ASSIGN(MadeRenderer made, make_live(workshop_, setting, no_progress()));
    if (recording_ == nullptr) return std::move(made.renderer);
    return recording_->tracked(std::move(made.renderer), setting, workshop_.passivity_apart(), clock_);
  }

  Workshop& workshop_;
  const std::vector<LiveChange>& changes_;
  device::Mixer& mixer_;
  Vec3 free_mm_;
  LiveRecording* recording_;
  const Clock& clock_;
  std::size_t next_ = 0;
  std::unique_ptr<render::HapticRenderer> pending_;
  std::uint8_t lane_ = 0;
  std::vector<std::string> failures_;
};

/// The renderers, prepared on one store, as the document has them.
Result<std::vector<MadeRenderer>> prepare_all(const LivePlan& plan, Workshop& workshop, Progress& progress,
                                              LiveDocument& document) {
  std::vector<MadeRenderer> all;
  for (const LiveSetting& setting : plan.settings) {
    Result<MadeRenderer> made = make_live(workshop, setting, progress);
    if (!made) return std::move(made).error();
    LiveRenderer shown;
    shown.label = setting.request.label;
    shown.name = setting.request.name;
    const render::Description described = made->renderer->describe();
    for (const auto& [key, value] : described.options.all()) shown.options.emplace_back(key, value);
    shown.prepare_ms = made->report.total_ms;
    shown.bytes = made->report.bytes;
    shown.shared_bytes = made->report.shared_bytes;
    for (const std::string& warning : made->report.warnings)
      document.warnings.push_back(fmt::format("{}: {}", setting.request.label, warning));
    document.renderers.push_back(std::move(shown));
    all.push_back(*std::move(made));
  }
  return all;
}

device::SwitchOptions switch_options(const LiveArguments& arguments, const LivePlan& plan,
                                     const device::DeviceLimits& limits, const device::DeviceMap& map,
                                     double force_limit_n) {
  device::SwitchOptions options;
  options.rule = plan.rule;
  options.device_force_max_n = limits.force_max_n;
  options.force_limit_n = force_limit_n;
  options.world_per_device = map.world_per_device;
  options.period_s = 1.0 / arguments.rate_hz;
  options.fade_s = arguments.fade_ms / kLiveMsPerS;
  return options;
}

/// A key of the terminal. False: end the session.
bool act_on(char key, device::Mixer& mixer, device::ServoThread& thread) {
  using Kind = device::SwitchRequest::Kind;
  if (key == 'q') return false;
  if (key == 'r') thread.request_rearm();
  if (key == '\t') mixer.request({Kind::kNext, device::SwitchSource::kKey, 0});
  if (key == 'c') mixer.request({Kind::kCancel, device::SwitchSource::kKey, 0});
  if (key >= '1' && key <= '9')
    mixer.request({Kind::kSelect, device::SwitchSource::kKey, static_cast<std::uint8_t>(key - '1')});
  return true;
}

/// The parts of a session that both ways of running it need.
struct Running {
  const LiveArguments& arguments;
  device::Device& device;
  device::Servo& servo;
  device::Mixer& mixer;
  std::vector<device::TickObserver*> observers;
  Rearmer& rearmer;
  Worker& worker;
  device::Recorder* recorder;  // null: none
  Progress& progress;
  LiveDocument& document;
  device::Heartbeat heart{};
};

Status run_fast(Running& with, VirtualClock& clock) {
  PALPATE_ASSIGN(
      std::unique_ptr<device::ServoLoop> loop,
      device::ServoLoop::create(with.servo, clock, std::llround(with.arguments.rate_hz), with.observers));
  with.rearmer.of(*loop);
  const std::int64_t begun_ns = clock.now_ns();
  const auto until_ns = begun_ns + std::llround(with.arguments.seconds * kLiveNsPerS);
  std::uint64_t asked = 0;
  const auto report_every = static_cast<std::uint64_t>(with.arguments.rate_hz);  // a second of the session
  device::run_accelerated(*loop, clock, until_ns, [&] {
    const double now_s = static_cast<double>(clock.now_ns() - begun_ns) / kLiveNsPerS;
    with.worker.work(now_s);
    if (with.recorder != nullptr) with.recorder->wait_for_room();
    if (asked++ % report_every == 0)
      with.progress.report("live, accelerated", now_s / with.arguments.seconds);
    return true;
  });
  with.document.loop = loop->histograms().statistics();
  with.document.scheduling = "accelerated: a virtual clock, every tick at its due time";
  return Done{};
}

Status run_real(Running& with, const MonotonicClock& clock, const Vec3& free_mm) {
  device::ServoThreadOptions options;
  options.rate_hz = std::llround(with.arguments.rate_hz);
  options.free_mm = free_mm;
  PALPATE_ASSIGN(std::unique_ptr<device::ServoThread> thread,
                 device::ServoThread::create(with.servo, clock, options, with.observers));
  with.rearmer.of(*thread);
  with.servo.watched_by(&with.heart);
  device::Watchdog watchdog(with.device, with.heart);
  PALPATE_TRY(watchdog.start());
  PALPATE_TRY(thread->start());
  Keys keys;
  const double begun_s = clock.now_s();
  bool going_on = true;
  while (going_on && thread->running()) {
    std::this_thread::sleep_for(kLook);
    const double now_s = clock.now_s() - begun_s;
    with.worker.work(now_s);
    with.progress.report("live", now_s / with.arguments.seconds);
    while (const std::optional<char> key = keys.next())
      going_on = going_on && act_on(*key, with.mixer, *thread);
    if (now_s >= with.arguments.seconds) going_on = false;
  }
  thread->stop();
  watchdog.stop();
  with.servo.watched_by(nullptr);
  with.document.watchdog_trips = watchdog.trips();
  with.document.loop = thread->histograms().statistics();
  with.document.scheduling = thread->mode().text();
  with.document.steal_percent = thread->steal_percent();
  for (const std::string& sentence : thread->mode().not_obtained) with.document.notes.push_back(sentence);
  return Done{};
}

void say_mapping(const geometry::Aabb& box, const device::DeviceMap& map, const device::DeviceLimits& limits,
                 LiveDocument& document) {
  document.world_per_device = map.world_per_device;
  document.felt_stiffness_n_per_mm = document.stiffness_n_per_mm * map.world_per_device;
  const Vec3 needed = 0.5 * box.extent_mm() / map.world_per_device, reach = device::reachable_half_mm(limits);
  if ((needed.array() > reach.array()).any())
    document.warnings.push_back(fmt::format(
        "The scene needs {:.3g} mm of the device to each side, which reaches {:.3g}: parts of it can only be "
        "reached by the clutch. --mapping fitted brings all of it into the workspace.",
        needed.maxCoeff(), reach.minCoeff()));
  if (const Status fits = device::surface_fits(limits, document.felt_stiffness_n_per_mm, 0.0); !fits)
    document.warnings.push_back(fits.error().message());
}

device::RecordingHeader header_of(const LiveArguments& arguments, const LivePlan& plan,
                                  const device::DeviceLimits& limits, const device::DeviceMap& map,
                                  const Clock& clock) {
  device::RecordingHeader header = plan.header;
  header.device = "sim:" + plan.rig.device_name();
  header.limits = limits;
  header.world_from_device = map.world_from_device;
  header.scale = map.world_per_device;
  header.mapping = arguments.mapping;
  header.rate_hz = arguments.rate_hz;
  header.scheduling = arguments.accelerated ? "virtual clock" : "real time";
  header.clock_start_ns = arguments.accelerated ? 0 : monotonic_ns() - clock.now_ns();
  return header;
}

/// What was lost is a warning: the session itself was felt.
void end_recording(const std::string& file, device::Recorder& recorder, LiveDocument& document) {
  if (!document.scheduling.empty()) (void)recorder.note("scheduling: " + document.scheduling);
  if (const Status whole = recorder.finish(); !whole) document.warnings.push_back(whole.error().message());
  const device::RecorderCounts counts = recorder.counts();
  document.recording = {file, counts.ticks, counts.written, counts.lost, counts.bytes};
}

geometry::Aabb scene_box(const render::SceneInput& scene) {
  geometry::Aabb box;
  for (const render::ModelInput& model : scene.models) {
    const geometry::Aabb own = model.cloud->box_mm();
    for (int corner = 0; corner < 8; ++corner) {
      Vec3 at = own.low_mm;
      for (int axis = 0; axis < 3; ++axis)
        if ((corner >> axis & 1) != 0) at[axis] = own.high_mm[axis];
      box.add(model.world_from_model * at);
    }
  }
  return box;
}

}  // namespace

Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                   Progress& progress, LiveDocument& document) {
  PALPATE_ASSIGN(std::vector<MadeRenderer> made, prepare_all(plan, workshop, progress, document));
  VirtualClock virtual_clock;
  MonotonicClock machine_clock;
  const Clock& clock = arguments.accelerated ? static_cast<const Clock&>(virtual_clock) : machine_clock;
  const trace::ProbePath& path = workshop.stage.path;
  const geometry::Aabb box = scene_box(workshop.stage.scene.input);
  // Limits are known once a device stands there; where the hand goes, once they are.
  const device::HandScript nobody =
      device::HandScript::create("nobody", {0.0}, {Vec3::Zero()}, device::HandScript::Between::kStraight)
          .value();
  const device::DeviceLimits limits = plan.rig.make(nobody, clock, 1.0 / arguments.rate_hz)->limits();
  PALPATE_ASSIGN(const device::DeviceMap map, device::map_for(box, limits, plan.workspace));
  say_mapping(box, map, limits, document);
  PALPATE_ASSIGN(const device::HandScript script,
                 live_hand(arguments.hand, path, *made.front().renderer, map, arguments.seconds));
  const std::unique_ptr<device::SimulatedPlant> plant = plan.rig.make(script, clock, 1.0 / arguments.rate_hz);

  device::GovernorOptions governed;
  governed.period_s = 1.0 / arguments.rate_hz;
  // Of the same limits as the servo's own, which is made once the device is open.
  PALPATE_ASSIGN(const device::ForceGovernor governor, device::ForceGovernor::create(limits, governed));
  document.force_limit_n = governor.limit_n();
  const device::SwitchOptions switching = switch_options(arguments, plan, limits, map, governor.limit_n());
  PALPATE_TRY(device::check(switching));
  auto owned_mixer = std::make_unique<device::Mixer>(switching, clock);
  device::Mixer& mixer = *owned_mixer;
  LiveRecording recording;
  const bool recorded = !arguments.record.empty();
  for (std::size_t i = 0; i < made.size(); ++i) {
    if (recorded) {
      PALPATE_ASSIGN(made[i].renderer, recording.tracked(std::move(made[i].renderer), plan.settings[i],
                                                         workshop.passivity_apart(), clock));
    }
    mixer.add(std::move(made[i].renderer));
  }
  control::ControlOptions around_all;
  around_all.passivity = workshop.stage.scene.control.passivity;
  std::unique_ptr<render::HapticRenderer> felt = control::wrap(std::move(owned_mixer), around_all);
  // Once for all renderers: they see the models at one place.
  if (workshop.stage.scene.input.simulation)
    felt = std::make_unique<MovingScene>(std::move(felt), *workshop.stage.scene.input.simulation);
  device::Servo servo(*felt, governed, *plant, clock, map);

  const Vec3 free_mm = map.world_mm(script.at(0.0).position_mm);
  LiveWatch watch(mixer, plan.settings.size(), arguments.seconds / static_cast<double>(kLiveSamples));
  SwitchTimer timer(mixer, arguments.switch_every_s);
  device::SwitchButton switch_button(mixer);
  device::ClutchButton clutch(servo, mixer);
  Rearmer rearmer(arguments.rearm);
  Worker worker(workshop, plan.changes, mixer, free_mm, recorded ? &recording : nullptr, clock);
  Running running{arguments, *plant, servo,   mixer,    {&watch, &timer, &switch_button, &clutch, &rearmer},
                  rearmer,   worker, nullptr, progress, document};
  if (recorded) {
    PALPATE_TRY(recording.open(arguments.record, arguments.replace,
                               header_of(arguments, plan, limits, map, clock), mixer));
    running.recorder = recording.recorder();
    // First, so that it sees the tick before buttons move the map.
    running.observers.insert(running.observers.begin(), running.recorder);
  }
  document.resident_before_bytes = resident_bytes();
  if (arguments.accelerated) {
    PALPATE_TRY(servo.start(free_mm));
    PALPATE_TRY(run_fast(running, virtual_clock));
    servo.stop();
  } else {
    PALPATE_TRY(run_real(running, machine_clock, free_mm));
  }
  while (mixer.take_retired()) {
  }
  document.resident_after_bytes = resident_bytes();
  watch.tell(document);
  if (recorded) end_recording(arguments.record, *running.recorder, document);
  for (const std::string& failure : worker.failures()) document.warnings.push_back(failure);
  if (rearmer.faulted()) document.notes.emplace_back("The session ended with a fault latched.");
  return Done{};
}

}  // namespace palpate::experiments
