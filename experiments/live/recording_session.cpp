#include "experiments/live/recording_session.h"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "device/record/recorder.h"
#include "device/servo/servo_thread.h"
#include "device/simulated/arm_models.h"
#include "experiments/data/scene_scans.h"
#include "experiments/live/moving_scene.h"
#include "experiments/run/choices.h"
#include "experiments/session/version.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments {
namespace {

// A fault of a simulated device ends by itself: so long a person needs to let go and arm it again.
constexpr std::int64_t kRearmAfterNs = 1'000'000'000;
// The bar is drawn no oftener than somebody looks.
constexpr std::chrono::milliseconds kLook{100};
constexpr std::uint64_t kTicksALook = 1000;
constexpr double kNsPerS = 1e9;

/// Counts, and arms again after a fault.
class SessionWatch final : public device::TickObserver {
 public:
  void took(const device::Tick& tick) noexcept override {
    if (tick.frame.contact) contact_.fetch_add(1, std::memory_order_relaxed);
    if (tick.missed > 0) missed_.fetch_add(tick.missed, std::memory_order_relaxed);
    if (tick.fault == device::Fault::kNone) {
      fault_ns_ = -1;
      return;
    }
    if (fault_ns_ < 0) {
      fault_ns_ = tick.t_ns;
      faults_.fetch_add(1, std::memory_order_relaxed);
    }
    if (tick.t_ns - fault_ns_ < kRearmAfterNs) return;
    fault_ns_ = -1;
    rearm_.store(true, std::memory_order_release);
  }
  /// Once after each fault.
  [[nodiscard]] bool wants_rearm() noexcept { return rearm_.exchange(false, std::memory_order_acquire); }
  [[nodiscard]] std::uint64_t contact() const noexcept { return contact_.load(); }
  [[nodiscard]] std::uint64_t faults() const noexcept { return faults_.load(); }
  [[nodiscard]] std::uint64_t missed() const noexcept { return missed_.load(); }

 private:
  std::int64_t fault_ns_ = -1;  // the servo thread's alone
  std::atomic<std::uint64_t> contact_{0}, faults_{0}, missed_{0};
  std::atomic<bool> rearm_{false};
};

/// Everything that a session is made of before its clock starts.
struct Session {
  Stage stage;
  RendererRequest request;
  std::unique_ptr<render::HapticRenderer> renderer;
  device::SimulatedRig rig;
  std::optional<device::HandScript> script;
  geometry::RigidTransform world_from_device;
  device::RecordingHeader header;
  device::RecordedRenderer recorded;
};

/// What a session did.
struct SessionReport {
  device::RecorderCounts counts;
  std::uint64_t contact = 0, faults = 0, missed = 0;
  std::string scheduling;
  std::optional<Error> lost;  ///< the recording is not whole
};

std::string text_of_scene(const scene::SceneFile& scene) {
  if (!scene.path.ends_with(".toml")) return {};
  const Result<std::string> text = read_file(scene.path, scene::kMaxSceneBytes);
  return text ? *text : std::string();
}

void fill_header(const RecordArguments& a, const scene::SceneFile& file, Session& s) {
  s.header = recording_header(a.scene, file, s.stage.scene, a.surface);
  s.header.world_from_device = s.world_from_device;
  s.header.mapping = "one to one";
  s.header.rate_hz = a.rate_hz;
  s.header.scheduling = a.accelerated ? "virtual clock" : "real time; what was granted stands in a note";
}

Result<Session> set_up_session(const RecordArguments& a, const CheckedRun& checked,
                               const render::Registry& registry, Context& context) {
  Session s;
  PALPATE_ASSIGN(s.rig, device::simulated_rig_of_driver(a.device, a.hand));
  PALPATE_ASSIGN(s.stage, set_up(checked.stage, all_readers(), context.progress));
  if (!checked.renderers.empty()) {
    s.request = checked.renderers.front();
  } else {
    Chosen chosen = usual_renderers(s.stage.scene.input, checked.own, registry);
    s.request = chosen.renderers.front();
  }
  PALPATE_TRY(registry.check_supports(*registry.find(s.request.name), s.stage.scene.input));
  PALPATE_ASSIGN(s.recorded, recorded_renderer(s.request, registry));
  PALPATE_ASSIGN(s.renderer,
                 prepared_renderer(s.request, registry, s.stage.scene, a.load.threads, context.progress));
  // The device's middle is that of the hand's way.
  geometry::Aabb box;
  for (const Vec3& hip_mm : s.stage.path.hip_mm) box.add(hip_mm);
  s.world_from_device.translation_mm = box.centre_mm();
  trace::ProbePath goal = s.stage.path;
  for (Vec3& hip_mm : goal.hip_mm) hip_mm -= s.world_from_device.translation_mm;
  PALPATE_ASSIGN(s.script, device::HandScript::along(goal));
  fill_header(a, checked.stage.scene, s);
  return s;
}

device::GovernorOptions governor_options(const RecordArguments& a, const device::DeviceLimits& limits) {
  device::GovernorOptions options;
  options.period_s = 1.0 / a.rate_hz;
  options.user_limit_n = limits.force_max_n;
  return options;
}

device::RecorderOptions recorder_options(const RecordArguments& a) {
  device::RecorderOptions options;
  options.flush = a.flush == "system" ? device::Flush::kSystem : device::Flush::kData;
  options.replace = a.force;
  return options;
}

SessionReport report_of(device::Recorder& recorder, const SessionWatch& watch, std::string scheduling) {
  SessionReport report;
  const Status finished = recorder.finish();
  if (!finished) report.lost = finished.error();
  report.counts = recorder.counts();
  report.contact = watch.contact();
  report.faults = watch.faults();
  report.missed = watch.missed();
  report.scheduling = std::move(scheduling);
  return report;
}

/// On a virtual clock. The recorder is waited for.
Result<SessionReport> run_virtual(const RecordArguments& a, Session& s, Context& context) {
  VirtualClock clock;
  const std::unique_ptr<device::SimulatedPlant> plant = s.rig.make(*s.script, clock, 1.0 / a.rate_hz);
  device::RendererTap tap(*s.renderer, clock);
  device::TapSource source({&tap}, s.world_from_device);
  device::Servo servo(tap, governor_options(a, plant->limits()), *plant, clock, s.world_from_device);
  PALPATE_TRY(servo.start(s.stage.path.hip_mm.front()));
  s.header.device = plant->name();
  s.header.limits = plant->limits();
  PALPATE_ASSIGN(std::unique_ptr<device::Recorder> recorder,
                 device::Recorder::create(a.out, s.header, source, recorder_options(a)));
  PALPATE_TRY(recorder->add_renderer(s.recorded));
  SessionWatch watch;
  const std::array<device::TickObserver*, 2> observers = {recorder.get(), &watch};
  PALPATE_ASSIGN(std::unique_ptr<device::ServoLoop> loop,
                 device::ServoLoop::create(servo, clock, a.rate_hz, observers));
  const auto until_ns = static_cast<std::int64_t>(a.seconds * kNsPerS);
  std::uint64_t ticks = 0;
  device::run_accelerated(*loop, clock, until_ns, [&] {
    recorder->wait_for_room();
    if (watch.wants_rearm()) loop->request_rearm();
    if (ticks++ % kTicksALook == 0)
      context.progress.report("recording", static_cast<double>(clock.now_ns()) / (a.seconds * kNsPerS));
    return true;
  });
  servo.stop();
  return report_of(*recorder, watch, "virtual clock");
}

/// On the machine's clock, in a servo thread.
Result<SessionReport> run_real(const RecordArguments& a, Session& s, Context& context) {
  const MonotonicClock clock;
  const std::unique_ptr<device::SimulatedPlant> plant = s.rig.make(*s.script, clock, 1.0 / a.rate_hz);
  device::RendererTap tap(*s.renderer, clock);
  device::TapSource source({&tap}, s.world_from_device);
  device::Servo servo(tap, governor_options(a, plant->limits()), *plant, clock, s.world_from_device);
  s.header.device = plant->name();
  s.header.limits = plant->limits();
  s.header.clock_start_ns = clock.start_ns();
  PALPATE_ASSIGN(std::unique_ptr<device::Recorder> recorder,
                 device::Recorder::create(a.out, s.header, source, recorder_options(a)));
  PALPATE_TRY(recorder->add_renderer(s.recorded));
  SessionWatch watch;
  const std::array<device::TickObserver*, 2> observers = {recorder.get(), &watch};
  device::ServoThreadOptions options;
  options.rate_hz = a.rate_hz;
  options.free_mm = s.stage.path.hip_mm.front();
  PALPATE_ASSIGN(std::unique_ptr<device::ServoThread> thread,
                 device::ServoThread::create(servo, clock, options, observers));
  PALPATE_TRY(thread->start());
  const std::string scheduling = thread->mode().text();
  PALPATE_TRY(recorder->note("scheduling: " + scheduling));
  const std::int64_t begun_ns = clock.now_ns();
  for (double past_s = 0.0; past_s < a.seconds && thread->running();
       past_s = static_cast<double>(clock.now_ns() - begun_ns) / kNsPerS) {
    context.progress.report("recording", past_s / a.seconds);
    if (watch.wants_rearm()) thread->request_rearm();
    std::this_thread::sleep_for(kLook);
  }
  thread->stop();
  return report_of(*recorder, watch, scheduling);
}

void print_report(const RecordArguments& a, const Session& s, const SessionReport& report) {
  if (a.json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"recording", a.out},
                                              {"renderer", s.request.label},
                                              {"device", s.header.device},
                                              {"scheduling", report.scheduling},
                                              {"ticks", report.counts.ticks},
                                              {"written", report.counts.written},
                                              {"lost", report.counts.lost},
                                              {"bytes", report.counts.bytes},
                                              {"contact_ticks", report.contact},
                                              {"faults", report.faults},
                                              {"missed_periods", report.missed}}
                           .dump(2));
    return;
  }
  fmt::print(
      "{}: {} ticks of {} on {} ({}), {} in contact, {} faults, {} missed periods, {} lost; {} bytes\n",
      a.out, report.counts.written, s.request.label, s.header.device, report.scheduling, report.contact,
      report.faults, report.missed, report.counts.lost, report.counts.bytes);
}

}  // namespace

Status check_recording_file(const std::string& file, bool replace) {
  const std::filesystem::path path = file;
  std::error_code code;
  if (path.extension() != "." + std::string(device::kRecordingEnding))
    return Error{"a recording's name ends in .palrec", "give the name FILE.palrec", file, 0};
  if (!path.parent_path().empty() && !std::filesystem::is_directory(path.parent_path(), code))
    return Error{"the folder for it is not there", "create the folder first", file, 0};
  if (std::filesystem::exists(path, code) && !replace)
    return Error{"a file of this name is there already, and recordings are not replaced unasked",
                 "give another name, or --force to replace it", file, 0};
  return Done{};
}

device::RecordingHeader recording_header(const std::string& scene, const scene::SceneFile& file,
                                         const scene::LoadedScene& loaded, const SurfaceArguments& surface) {
  device::RecordingHeader header;
  const metrics::MachineInfo machine = metrics::machine_info();
  header.program = fmt::format("palpate {} ({})", version_text(), kCommit);
  header.scene = scene;
  header.scene_text = text_of_scene(file);
  header.scene_hash = scene_hash(file, loaded, surface);
  header.machine = fmt::format("{}, {} CPUs, {}", machine.cpu, machine.cores, machine.kernel);
  header.started_utc = metrics::utc_now();
  return header;
}

std::string scene_hash(const scene::SceneFile& file, const scene::LoadedScene& scene,
                       const SurfaceArguments& surface) {
  Hash64 hash;
  const auto add = [&](std::string_view text) {
    hash.u64(text.size());
    hash.bytes(std::as_bytes(std::span(text)));
  };
  add(text_of_scene(file));
  for (const std::string* text : {&surface.stiffness, &surface.friction, &surface.deformation}) add(*text);
  for (const scene::Provenance& from : scene.provenance) add(from.content_hash);
  for (const render::ModelInput& model : scene.input.models) {
    for (int axis = 0; axis < 3; ++axis) hash.real(model.world_from_model.translation_mm[axis]);
    for (int i = 0; i < 4; ++i) hash.real(model.world_from_model.rotation.coeffs()[i]);
    hash.real(model.surface.stiffness_n_per_mm);
  }
  hash.real(scene.input.force_limit_n);
  return hash.hex();
}

Result<std::unique_ptr<render::HapticRenderer>> prepared_renderer(const RendererRequest& request,
                                                                  const render::Registry& registry,
                                                                  const scene::LoadedScene& scene,
                                                                  int threads, Progress& progress) {
  if (!request.clean.empty())
    return Error{"a renderer that is recorded cannot clean its points first",
                 "clean them with `palpate clean`, and record on the cleaned file", request.label, 0};
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(request.name, request.options));
  renderer = control::wrap(std::move(renderer), scene.control);
  progress.report("preparing " + request.label, -1.0);
  render::PrepareContext prepare{threads, &progress};
  PALPATE_TRY(renderer->prepare(scene.input, prepare));
  if (scene.input.simulation)
    renderer = std::make_unique<MovingScene>(std::move(renderer), *scene.input.simulation);
  return renderer;
}

Result<device::RecordedRenderer> recorded_renderer(const RendererRequest& request,
                                                   const render::Registry& registry) {
  PALPATE_ASSIGN(const Options complete,
                 validate(request.options, registry.find(request.name)->options, request.name));
  device::RecordedRenderer recorded{request.label, request.name, {}};
  recorded.options.assign(complete.all().begin(), complete.all().end());
  return recorded;
}

int run_record(const RecordArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  if (arguments.renderer.find(',') != std::string::npos)
    return fail({"record runs one renderer", "`palpate live --record` runs several", {}, 0}, kExitBadInput);
  RunArguments run;
  run.scene = arguments.scene;
  run.renderers = arguments.renderer;
  run.path = arguments.path;
  run.traj_columns = arguments.traj_columns;
  run.load = arguments.load;
  run.surface = arguments.surface;
  run.reference = "none";
  if (const Status good = check_recording_file(arguments.out, arguments.force); !good)
    return fail(good.error(), kExitBadInput);
  Result<CheckedRun> checked = check_run(run, registry, context.progress);
  if (!checked) return fail(checked.error(), kExitBadInput, &context.progress);
  // Generated paths have 1000 samples a second; the hand keeps moving to the end.
  constexpr double kSamplesPerS = 1000.0;
  checked->stage.usual_frames = static_cast<int>(std::ceil(arguments.seconds * kSamplesPerS)) + 1;
  Result<Session> session = set_up_session(arguments, *checked, registry, context);
  if (!session) return fail(session.error(), kExitBadInput, &context.progress);
  const Result<SessionReport> report = arguments.accelerated ? run_virtual(arguments, *session, context)
                                                             : run_real(arguments, *session, context);
  context.progress.clear();
  if (!report) return fail(report.error(), kExitFellShort);
  print_report(arguments, *session, *report);
  if (report->lost) return fail(*report->lost, kExitFellShort);
  return kExitOk;
}

}  // namespace palpate::experiments
