#include "experiments/live/recording_session.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include <palpate/control.h>
#include <palpate/result.h>
#include "device/live/hand_controls.h"
#include "device/record/recorder.h"
#include "experiments/data/scans.h"
#include "experiments/live/assembly.h"
#include "experiments/live/changes.h"
#include "experiments/run/arguments.h"
#include "experiments/session/version.h"
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments {
namespace {

/// A session's parts before its device opens.
struct Session {
  Stage stage;
  RendererRequest request;
  std::unique_ptr<render::HapticRenderer> renderer;
  device::RecordingHeader header;
  device::RecordedRenderer recorded;
};

class NoTasks final : public SessionTasks {
 public:
  void work(double /*now_s*/) override {}
  void key(char /*pressed*/) override {}
};

struct SessionReport {
  device::RecorderCounts counts;
  std::uint64_t contact = 0, faults = 0, missed = 0, replugged = 0;
  std::string scheduling;
  std::optional<Error> lost;  ///< error that left the recording incomplete
};

std::string text_of_scene(const scene::SceneFile& scene) {
  if (!scene.path.ends_with(".toml")) return {};
  const Result<std::string> text = read_file(scene.path, scene::kMaxSceneBytes);
  return text ? *text : std::string();
}

Result<Session> set_up_session(const RecordArguments& a, const CheckedRun& checked,
                               const render::Registry& registry, Context& context) {
  Session s;
  PALPATE_ASSIGN(s.stage, set_up(checked.stage, all_readers(), context.progress));
  if (!checked.renderers.empty()) {
    s.request = checked.renderers.front();
  } else {
    Chosen chosen = usual_renderers(s.stage.scene.input, checked.own, registry);
    s.request = chosen.renderers.front();
  }
  PALPATE_TRY(registry.check_supports(*registry.find(s.request.name), s.stage.scene.input));
  PALPATE_ASSIGN(s.recorded, recorded_renderer(s.request, registry));
  PALPATE_ASSIGN(s.renderer, prepared_renderer(s.request, registry, s.stage.scene, a.load.threads,
                                               !a.accelerated, context.progress));
  s.header = recording_header(a.scene, checked.stage.scene, s.stage.scene, a.surface);
  return s;
}

device::RecorderOptions recorder_options(const RecordArguments& a) {
  device::RecorderOptions options;
  options.flush = a.flush == "system" ? device::Flush::kSystem : device::Flush::kData;
  options.replace = a.force;
  return options;
}

/// Maps the path's centre to the device's centre at scale 1; a simulated hand follows the path.
Result<device::DeviceMap> seat_of(const Stage& stage, const device::DeviceLimits& limits,
                                  SessionDevice& device) {
  geometry::Aabb box;
  for (const Vec3& hip_mm : stage.path.hip_mm) box.add(hip_mm);
  PALPATE_ASSIGN(const device::DeviceMap map, device::map_for(box, limits, {}));
  if (!device.is_simulated_hand()) return map;
  trace::ProbePath goal = stage.path;
  for (Vec3& hip_mm : goal.hip_mm) hip_mm = map.device_mm(hip_mm);
  PALPATE_ASSIGN(device::HandScript script, device::HandScript::along(goal));
  device.hold(std::move(script));
  return map;
}

void fill_header(const RecordArguments& a, const device::DeviceLimits& limits, const device::DeviceMap& map,
                 const SessionClock& clock, device::RecordingHeader& header) {
  header.limits = limits;
  header.world_from_device = map.world_from_device;
  header.mapping = "one to one";
  header.rate_hz = a.rate_hz;
  header.scheduling = a.accelerated ? "virtual clock" : "real time; what was granted stands in a note";
  header.clock_start_ns = a.accelerated ? 0 : clock.machine_clock().start_ns();
}

/// Runs and records. Removes the file if no tick ran.
Result<SessionReport> run_recorded(const RecordArguments& a, Session& s, SessionClock& clock,
                                   SessionDevice& device, Context& context) {
  PALPATE_ASSIGN(const device::DeviceLimits limits, device.limits());
  PALPATE_ASSIGN(const device::DeviceMap map, seat_of(s.stage, limits, device));
  SessionSettings settings;
  settings.rate_hz = a.rate_hz;
  settings.seconds = a.seconds;
  settings.free_mm = s.stage.path.hip_mm.front();
  settings.label = "recording";
  // A simulated hand bears the device's full force; a person starts with less.
  if (!device.choice().is_real()) {
    settings.user_limit_n = limits.force_max_n;
    settings.auto_rearm = true;
  }
  device::RendererTap tap(*s.renderer, clock.clock());
  device::TapSource source({&tap}, map.world_from_device);
  fill_header(a, limits, map, clock, s.header);
  s.header.device = device.device().name();
  PALPATE_ASSIGN(std::unique_ptr<device::Recorder> recorder,
                 device::Recorder::create(a.out, s.header, source, recorder_options(a)));
  PALPATE_TRY(recorder->add_renderer(s.recorded));
  Assembly session(settings, clock, device, tap, map);
  session.record(*recorder);
  NoTasks nothing;
  Result<SessionEnd> end = session.run(nothing, context.progress);
  if (!end) {
    recorder.reset();
    std::error_code code;
    std::filesystem::remove(a.out, code);
    return std::move(end).error();
  }
  SessionReport report;
  if (const Status finished = recorder->finish(); !finished) report.lost = finished.error();
  report.counts = recorder->counts();
  report.contact = session.watch().contact();
  report.faults = session.watch().faults();
  report.missed = session.watch().missed();
  report.scheduling = a.accelerated ? "virtual clock" : end->scheduling;
  report.replugged = end->replugged;
  return report;
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
                                              {"missed_periods", report.missed},
                                              {"replugged", report.replugged}}
                           .dump(2));
    return;
  }
  fmt::print(
      "{}: {} ticks of {} on {} ({}), {} in contact, {} faults, {} missed periods, {} lost; {} bytes\n",
      a.out, report.counts.written, s.request.label, s.header.device, report.scheduling, report.contact,
      report.faults, report.missed, report.counts.lost, report.counts.bytes);
}

Result<int> record(const RecordArguments& arguments, const device::Drivers& drivers, Context& context) {
  const render::Registry registry = all_renderers();
  if (arguments.renderer.find(',') != std::string::npos)
    return Error{"record runs one renderer", "`palpate live --record` runs several"};
  RunArguments run;
  run.scene = arguments.scene;
  run.renderers = arguments.renderer;
  run.path = arguments.path;
  run.load = arguments.load;
  run.surface = arguments.surface;
  run.reference = "none";
  PALPATE_TRY(check_recording_file(arguments.out, arguments.force));
  PALPATE_ASSIGN(CheckedRun checked, check_run(run, registry, context.progress));
  PALPATE_ASSIGN(const DeviceChoice choice, choose_device(arguments.device, drivers));
  if (choice.is_real() && arguments.accelerated)
    return Error{"a device runs in real time, not --accelerated", "leave --accelerated out"};
  SessionClock clock(arguments.accelerated);
  // The guard is forked, so it comes before threads and a large scene.
  PALPATE_ASSIGN(SessionDevice device, SessionDevice::make(choice, clock.clock(), 1.0 / arguments.rate_hz));
  device.report_unproven();
  // Generated paths have 1000 samples a second, enough to move until the end.
  constexpr double kSamplesPerS = 1000.0;
  checked.stage.usual_frames = static_cast<int>(std::ceil(arguments.seconds * kSamplesPerS)) + 1;
  PALPATE_ASSIGN(Session session, set_up_session(arguments, checked, registry, context));
  context.working = true;
  PALPATE_ASSIGN(const SessionReport report, run_recorded(arguments, session, clock, device, context));
  context.progress.clear();
  print_report(arguments, session, report);
  if (report.lost) return *report.lost;
  return kExitOk;
}

}  // namespace

Status check_recording_file(const std::string& file, bool replace) {
  const std::filesystem::path path = file;
  std::error_code code;
  if (path.extension() != "." + std::string(device::kRecordingEnding))
    return Error{"a recording's name ends in .palrec", "give the name FILE.palrec", file};
  if (!path.parent_path().empty() && !std::filesystem::is_directory(path.parent_path(), code))
    return Error{"the folder for it is not there", "create the folder first", file};
  if (std::filesystem::exists(path, code) && !replace)
    return Error{"a file of this name is there already, and recordings are not replaced unasked",
                 "give another name, or --force to replace it", file};
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
                                                                  int threads, bool paced,
                                                                  Progress& progress) {
  if (!request.clean.empty())
    return Error{"a renderer that is recorded cannot clean its points first",
                 "clean them with `palpate clean`, and record on the cleaned file", request.label};
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(request.name, request.options));
  renderer = control::wrap(std::move(renderer), scene.control);
  progress.report("preparing " + request.label, -1.0);
  render::PrepareContext prepare{threads, &progress, nullptr, paced};
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
  return run_record_with(arguments, session_drivers(), context);
}

int run_record_with(const RecordArguments& arguments, const device::Drivers& drivers, Context& context) {
  return exit_status(record(arguments, drivers, context), context);
}

}  // namespace palpate::experiments
