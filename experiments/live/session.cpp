#include "experiments/live/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <thread>
#include <utility>

#include <palpate/result.h>
#include "device/live/hand_controls.h"
#include "experiments/live/assembly.h"
#include "experiments/live/changes.h"
#include "experiments/live/hand.h"
#include "experiments/live/live.h"
#include "experiments/run/run.h"
#include "toolkit/core/messages.h"
#include "toolkit/render/prepare.h"

namespace palpate::experiments {
namespace {

// Checks a session's arguments before anything is loaded.

Error unknown_word(const char* what, const std::string& word, const std::vector<std::string>& known) {
  return Error{fmt::format("there is no {} '{}'", what, word),
               did_you_mean(word, known, "choose from " + joined(known))};
}

Result<device::WorkspaceOptions> workspace_of(const std::string& mapping) {
  constexpr NumberRange kFactors{1e-6, 1e6};
  device::WorkspaceOptions options;
  if (mapping == "1:1") return options;
  if (mapping == "fitted") {
    options.fit = device::WorkspaceFit::kFitted;
    return options;
  }
  const Result<double> factor = read_number(mapping, kFactors);
  if (!factor)
    return Error{fmt::format("--mapping {} is neither 1:1 nor fitted nor a factor: {}", shown(mapping),
                             factor.error().what),
                 "give mm of the scene for a mm of the device, such as 2"};
  options.fit = device::WorkspaceFit::kFactor;
  options.factor = *factor;
  return options;
}

/// Checks that the arguments suit real time and a person's hand.
Status keeps_time(const LiveArguments& arguments, const DeviceChoice& device) {
  if (arguments.accelerated && !arguments.listen.empty())
    return Error{"--listen hears in real time, and --accelerated has none", "leave one of them out"};
  if (!device.is_real()) return Done{};
  if (arguments.accelerated)
    return Error{fmt::format("{} runs in real time, not --accelerated", shown(device.name())),
                 "leave --accelerated out"};
  if (arguments.rearm)
    return Error{fmt::format("{} is armed again by a person alone, not by --rearm", shown(device.name())),
                 "leave --rearm out; key r arms again"};
  return Done{};
}

Status check_hand(const LiveArguments& arguments) {
  if (arguments.hand == kMouseHand) {
    if (arguments.link != nullptr) return Done{};
    return Error{"--hand mouse needs a window to move it in", "add --window"};
  }
  if (std::find(live_hands().begin(), live_hands().end(), arguments.hand) == live_hands().end())
    return unknown_word("hand", arguments.hand, live_hands());
  return Done{};
}

}  // namespace

Result<LivePlan> plan_live(const LiveArguments& arguments, const std::vector<RendererRequest>& renderers,
                           const render::Registry& registry, const device::Drivers& drivers) {
  const std::vector<std::string> rules = {"wait", "refuse", "free"};
  LivePlan plan;
  PALPATE_ASSIGN(plan.device, choose_device(arguments.device, drivers));
  PALPATE_TRY(keeps_time(arguments, plan.device));
  if (!arguments.listen.empty()) {
    PALPATE_ASSIGN(plan.listen, parse_listen(arguments.listen));
  }
  PALPATE_ASSIGN(plan.workspace, workspace_of(arguments.mapping));
  const auto rule = std::find(rules.begin(), rules.end(), arguments.rule);
  if (rule == rules.end()) return unknown_word("rule", arguments.rule, rules);
  plan.rule = rule == rules.begin()       ? device::SwitchRule::kContactElseWait
              : rule == rules.begin() + 1 ? device::SwitchRule::kContactElseRefuse
                                          : device::SwitchRule::kFreeSpace;
  PALPATE_TRY(check_hand(arguments));
  if (renderers.size() > device::kMaxLanes)
    return Error{fmt::format("--renderers names {} renderers", renderers.size()),
                 fmt::format("one hand takes at most {}", device::kMaxLanes)};
  for (const RendererRequest& request : renderers) plan.settings.push_back({request});
  PALPATE_ASSIGN(plan.changes, parse_changes(arguments.changes, plan.settings, registry));
  return plan;
}

namespace {

constexpr double kLiveMsPerS = 1e3;

/// Prepares the renderers on one store and notes them in the document. `instead`: each is this one.
Result<std::vector<MadeRenderer>> prepare_all(const LivePlan& plan, Workshop& workshop,
                                              const RendererRequest* instead, Progress& progress,
                                              LiveDocument& document) {
  std::vector<MadeRenderer> all;
  for (const LiveSetting& setting : plan.settings) {
    PALPATE_ASSIGN(MadeRenderer made,
                   make_live(workshop, instead != nullptr ? LiveSetting{*instead} : setting, progress));
    if (instead == nullptr)
      for (const std::string& warning : made.report.warnings)
        document.warnings.push_back(fmt::format("{}: {}", setting.request.label, warning));
    document.renderers.push_back(described(setting, made));
    all.push_back(std::move(made));
  }
  // A cancelled session does not start, even if no preparation gave up in time.
  if (progress.cancelled()) return Error{"it was ended while it was prepared", "begin it again"};
  return all;
}

/// Threads for a preparation beside a running servo, which keeps one core.
int threads_beside(int asked) {
  const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const int free_cores = std::max(1, cores - 1);
  return asked > 0 ? std::min(asked, free_cores) : free_cores;
}

/// Notes when each renderer moved from the stand-in to all points.
class CoarseNotes {
 public:
  CoarseNotes(const LivePlan& plan, const StandIn& stand_in) : plan_(plan), text_(stand_in.text()) {
    whole_.assign(plan.settings.size(), false);
  }
  void made(std::size_t lane, const MadeRenderer& made, double at_s, LiveDocument& document) {
    const std::uint32_t count = document.renderers[lane].made;
    document.renderers[lane] = described(plan_.settings[lane], made);
    document.renderers[lane].made = count;
    whole_[lane] = true;
    document.notes.push_back(fmt::format(
        "{} was prepared on all points from {:.1f} s on; until {:.1f} s {} stood "
        "for it, and its numbers hold both.",
        plan_.settings[lane].request.label, at_s, at_s + made.report.total_ms / kLiveMsPerS, text_));
    for (const std::string& warning : made.report.warnings)
      document.warnings.push_back(fmt::format("{}: {}", plan_.settings[lane].request.label, warning));
  }
  void tell(LiveDocument& document) const {
    for (std::size_t lane = 0; lane < whole_.size(); ++lane)
      if (!whole_[lane])
        document.warnings.push_back(fmt::format(
            "{} was not prepared when the session ended: what was felt in its place was {}. Run it for "
            "longer, or give --stand-in 0.",
            plan_.settings[lane].request.label, text_));
  }

 private:
  const LivePlan& plan_;
  std::string text_;
  std::vector<bool> whole_;
};

std::vector<std::string> labels_of(const LivePlan& plan) {
  std::vector<std::string> labels;
  for (const LiveSetting& setting : plan.settings) labels.push_back(setting.request.label);
  return labels;
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

void describe_mapping(const geometry::Aabb& box, const device::DeviceMap& map,
                      const device::DeviceLimits& limits, LiveDocument& document) {
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
                                  const SessionClock& clock, const std::string& device) {
  device::RecordingHeader header = plan.header;
  header.device = device;
  header.limits = limits;
  header.world_from_device = map.world_from_device;
  header.scale = map.world_per_device;
  header.mapping = arguments.mapping;
  header.rate_hz = arguments.rate_hz;
  header.scheduling = arguments.accelerated ? "virtual clock" : "real time";
  header.clock_start_ns = arguments.accelerated ? 0 : clock.machine_clock().start_ns();
  return header;
}

/// A data loss is only a warning: the session itself ran.
void end_recording(const std::string& file, device::Recorder& recorder, LiveDocument& document) {
  if (const Status whole = recorder.finish(); !whole) document.warnings.push_back(whole.error().message());
  const device::RecorderCounts counts = recorder.counts();
  document.recording = {file, counts.ticks, counts.written, counts.lost, counts.bytes};
}

/// A hand guided during the session; null members: unguided.
struct LedHand {
  std::shared_ptr<device::HandGuide> by_mouse;
  std::optional<cloud::Cloud> reached;  // what the exploring hand goes by, of a stream
  std::unique_ptr<ExploringHand> exploring;
};

/// A hand over the first model; it may reach others from there. Takes its strokes from a "hand" path.
Result<std::unique_ptr<ExploringHand>> exploring_hand(const LiveArguments& arguments, const Stage& stage,
                                                      const device::DeviceMap& map, SessionDevice& device,
                                                      LedHand& led) {
  const render::ModelInput& model = stage.scene.input.models.front();
  const auto& sampled = stage.scene.sampled_mesh.front();
  paths::PathTarget target;
  target.surface = model.analytic.get();
  target.cloud = model.cloud.get();
  if (stage.stream) {
    // A camera sees more than a device reaches.
    PALPATE_ASSIGN(const device::DeviceLimits limits, device.limits());
    PALPATE_ASSIGN(led.reached, within_reach(*model.cloud, map, limits));
    target.cloud = &*led.reached;
  }
  target.mesh = sampled ? sampled.get() : model.original_mesh.get();
  target.world_from_model = model.world_from_model;
  target.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
  const bool by_path = is_hand_path(stage.path.name);
  PALPATE_ASSIGN(const paths::HandOptions options, paths::parse_hand(by_path ? stage.path.name : kHandPath));
  return ExploringHand::create(target, options, map, device.choice().rig->hand.stiffness_n_per_mm,
                               1.0 / arguments.rate_hz);
}

/// The hand's free position before the first tick. A simulated hand takes hold of the device.
Result<Vec3> place_hand(const LiveArguments& arguments, const Stage& stage, render::HapticRenderer& first,
                        const device::DeviceMap& map, SessionDevice& device, LedHand& led) {
  if (!device.is_simulated_hand()) return stage.path.hip_mm.front();
  if (arguments.hand == kMouseHand) {
    led.by_mouse = std::make_shared<device::HandGuide>(map.device_mm(stage.path.hip_mm.front()));
    device.hold(device::HandScript::guided(kMouseHand, led.by_mouse));
    return stage.path.hip_mm.front();
  }
  if (arguments.hand == kExploreHand) {
    PALPATE_ASSIGN(led.exploring, exploring_hand(arguments, stage, map, device, led));
    device.hold(led.exploring->script());
    return led.exploring->start_mm();
  }
  PALPATE_ASSIGN(device::HandScript script,
                 live_hand(arguments.hand, stage.path, first, map, arguments.seconds));
  const Vec3 free_mm = map.world_mm(script.at(0.0).position_mm);
  device.hold(std::move(script));
  return free_mm;
}

/// Everything between renderers and assembly. Destruction order matters: the renderer ends before the
/// recording.
struct Felt {
  LiveRecording recording;
  std::unique_ptr<render::HapticRenderer> renderer;  // the mixer and its wrappers
  device::Mixer* mixer = nullptr;
};

/// Puts the renderers on one mixer, inside passivity control and moving models.
Status mix_all(std::vector<MadeRenderer> made, const LivePlan& plan, const Workshop& workshop,
               const device::SwitchOptions& switching, const SessionClock& clock, bool recorded, Felt& felt) {
  PALPATE_TRY(device::check(switching));
  auto mixer = std::make_unique<device::Mixer>(switching, clock.clock(), clock.machine_clock());
  felt.mixer = mixer.get();
  for (std::size_t i = 0; i < made.size(); ++i) {
    if (recorded) {
      PALPATE_ASSIGN(made[i].renderer, felt.recording.tracked(std::move(made[i].renderer), plan.settings[i],
                                                              workshop.passivity_apart(), clock.clock()));
    }
    mixer->add(std::move(made[i].renderer));
  }
  control::ControlOptions around_all;
  around_all.passivity = workshop.stage.scene.control.passivity;
  felt.renderer = control::wrap(std::move(mixer), around_all);
  // Wraps the mixer once, so all renderers see the models at the same place.
  if (workshop.stage.scene.input.simulation)
    felt.renderer =
        std::make_unique<MovingScene>(std::move(felt.renderer), *workshop.stage.scene.input.simulation);
  return Done{};
}

SessionSettings settings_of(const LiveArguments& arguments) {
  SessionSettings settings;
  settings.rate_hz = arguments.rate_hz;
  settings.seconds = arguments.seconds;
  settings.auto_rearm = arguments.rearm;
  return settings;
}

/// Runs the session and listens to the network.
Result<SessionEnd> run_heard(const LivePlan& plan, Assembly& session, LiveTasks& tasks, ProgressBar& progress,
                             LiveDocument& document) {
  if (!plan.listen) return session.run(tasks, progress);
  PALPATE_ASSIGN(const std::unique_ptr<RemoteListener> listener,
                 RemoteListener::start(*plan.listen, [&](const device::RemoteCommand& command) {
                   return tasks.act(command, session);
                 }));
  session.announce("listening on " + listener->where());
  Result<SessionEnd> end = session.run(tasks, progress);
  document.remote.where = listener->where();
  document.remote.counts = listener->counts();
  return end;
}

void report_end(const SessionEnd& end, LiveDocument& document) {
  document.loop = end.loop;
  document.lateness = end.lateness;
  document.scheduling = end.scheduling;
  document.steal_percent = end.steal_percent;
  document.watchdog_trips = end.watchdog_trips;
  document.replugged = end.replugged;
  document.marks = end.marks;
  document.notes.insert(document.notes.end(), end.notes.begin(), end.notes.end());
  if (end.faulted) document.notes.emplace_back("The session ended with a fault latched.");
}

/// A mapping, the hand's place and the matching limits.
struct Seat {
  device::DeviceLimits limits;
  device::DeviceMap map;
  double force_limit_n = 0.0;
};
Result<Seat> take_seat(const LiveArguments& arguments, const LivePlan& plan, const Stage& stage,
                       SessionDevice& device, LiveDocument& document) {
  Seat seat;
  const geometry::Aabb box = render::box_of(stage.scene.input.models);
  PALPATE_ASSIGN(seat.limits, device.limits());
  PALPATE_ASSIGN(seat.map, device::map_for(box, seat.limits, plan.workspace));
  describe_mapping(box, seat.map, seat.limits, document);
  // Has the same limits as the servo's governor, which is made after the device opens.
  PALPATE_ASSIGN(
      const device::ForceGovernor governor,
      device::ForceGovernor::create(seat.limits, Assembly::governor_options(settings_of(arguments))));
  seat.force_limit_n = document.force_limit_n = governor.limit_n();
  return seat;
}

ShownSession shown_session(const LivePlan& plan, SessionDevice& device, const Seat& seat,
                           std::shared_ptr<device::HandGuide> guide, const std::optional<StandIn>& stand_in) {
  ShownSession shown;
  shown.device = device.device().name();
  shown.labels = labels_of(plan);
  shown.limits = seat.limits;
  shown.force_limit_n = seat.force_limit_n;
  shown.hand = std::move(guide);
  if (stand_in) shown.stand_in = stand_in->text();
  return shown;
}

/// Replaces stand-ins by the requested renderers during the session.
void replace_coarse(const LivePlan& plan, const Workshop& workshop, const StandIn& stand_in,
                    std::optional<CoarseNotes>& notes, LiveTasks& tasks, LiveDocument& document) {
  notes.emplace(plan, stand_in);
  tasks.replace_stand_ins(threads_beside(workshop.threads),
                          [&](std::size_t lane, const MadeRenderer& one, double at_s) {
                            notes->made(lane, one, at_s, document);
                          });
}

}  // namespace

Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                   SessionClock& clock, SessionDevice& device, ProgressBar& progress,
                   LiveDocument& document) {
  LinkedProgress seen(progress, arguments.link);
  const std::optional<StandIn> stand_in =
      stand_in_for(arguments, plan.settings, workshop.stage.scene.input, workshop.registry);
  Workshop coarse{workshop.stage, workshop.registry, workshop.threads, workshop.paced};
  if (stand_in) coarse.other = &stand_in->input;
  PALPATE_ASSIGN(std::vector<MadeRenderer> made,
                 stand_in ? prepare_all(plan, coarse, &stand_in->request, seen, document)
                          : prepare_all(plan, workshop, nullptr, seen, document));
  PALPATE_ASSIGN(const Seat seat, take_seat(arguments, plan, workshop.stage, device, document));
  SessionSettings settings = settings_of(arguments);
  LedHand led;
  PALPATE_ASSIGN(settings.free_mm,
                 place_hand(arguments, workshop.stage, *made.front().renderer, seat.map, device, led));
  const bool recorded = !arguments.record.empty();
  std::vector<stream::DepthReceiver*> receivers;
  StagedStream* const staged = workshop.stage.stream.get();
  if (staged != nullptr) {
    if (staged->open.is_camera && arguments.accelerated)
      return Error{"a camera's images come in their own time", "leave out --accelerated", staged->open.name};
    PALPATE_ASSIGN(receivers, receivers_of(made));
  }
  Felt felt;
  PALPATE_TRY(mix_all(std::move(made), plan, workshop,
                      switch_options(arguments, plan, seat.limits, seat.map, seat.force_limit_n), clock,
                      recorded, felt));
  Assembly session(settings, clock, device, *felt.renderer, seat.map);
  double stiffness_n_per_mm = document.stiffness_n_per_mm;
  for (const LiveChange& change : plan.changes)
    stiffness_n_per_mm = std::max(stiffness_n_per_mm, change.setting.stiffness_n_per_mm);
  LiveWatch watch(*felt.mixer, plan.settings.size(), arguments.seconds / static_cast<double>(kLiveSamples),
                  stiffness_n_per_mm);
  SwitchTimer timer(*felt.mixer, arguments.switch_every_s);
  device::SwitchButton switch_button(*felt.mixer);
  device::ClutchButton clutch(session.servo(), *felt.mixer);
  for (device::TickObserver* one :
       {static_cast<device::TickObserver*>(&watch), static_cast<device::TickObserver*>(&timer),
        static_cast<device::TickObserver*>(&switch_button), static_cast<device::TickObserver*>(&clutch)})
    session.observe(*one);
  if (led.exploring) session.observe(*led.exploring);
  std::optional<LiveStream> streamed;
  if (staged != nullptr) {
    streamed.emplace(staged->open, std::move(receivers), *felt.mixer, arguments.accelerated,
                     1.0 / arguments.rate_hz);
    session.observe(*streamed);
  }
  LiveTasks tasks(workshop, plan.changes, labels_of(plan), *felt.mixer, clock.clock(),
                  {settings.free_mm, recorded ? &felt.recording : nullptr});
  if (recorded) {
    PALPATE_TRY(felt.recording.open(
        arguments.record, arguments.replace, streamed.has_value(),
        header_of(arguments, plan, seat.limits, seat.map, clock, device.device().name()), *felt.mixer));
    session.record(*felt.recording.recorder());
    if (streamed) PALPATE_TRY(streamed->record(*felt.recording.recorder()));
  }
  // A renderer that replaced another would know nothing of the images before.
  tasks.asked_by(streamed ? nullptr : arguments.link, plan.settings);
  std::optional<CoarseNotes> notes;
  if (stand_in) replace_coarse(plan, workshop, *stand_in, notes, tasks, document);
  ShownSession shown = shown_session(plan, device, seat, led.by_mouse, stand_in);
  if (streamed && arguments.link != nullptr) shown.images = streamed->shown();
  const WindowHooks window(arguments, session, *felt.mixer, device, workshop.stage.scene.input,
                           std::move(shown));
  if (streamed) {
    tasks.beside([&] {
      if (std::string news = streamed->work(); !news.empty()) session.announce(std::move(news));
    });
    streamed->begin();
  }
  EndOnStop on_stop([&] {
    tasks.ending();
    return session.stop_soon();
  });
  const Result<SessionEnd> end = run_heard(plan, session, tasks, progress, document);
  document.stopped_by = on_stop.over();
  if (streamed) {
    streamed->end();
    document.stream = streamed->facts();
  }
  if (!end) {
    if (recorded) felt.recording.discard(arguments.record);
    return end.error();
  }
  while (felt.mixer->take_retired()) {
  }
  document.resident_after_bytes = resident_bytes();
  document.resident_before_bytes = end->settled_bytes;
  report_end(*end, document);
  watch.tell(document);
  if (document.stopped_by != 0)
    document.warnings.insert(document.warnings.begin(),  // told even where there are many
                             fmt::format("The session was stopped by a signal after {:.1f} s.",
                                         static_cast<double>(document.ticks) / document.rate_hz));
  for (std::size_t i = 0; i < document.renderers.size(); ++i) {
    const render::FrameCounters counted = felt.mixer->counters_of(static_cast<std::uint8_t>(i));
    document.renderers[i].late_frames = counted.late_frames;
    document.renderers[i].coarse_frames = counted.coarse_frames;
    document.renderers[i].swaps = counted.swaps;
    document.renderers[i].stalled_frames = counted.stalled_frames;
    for (const std::string& warning : warnings_about_tiles(counted))
      document.warnings.push_back(document.renderers[i].label + ": " + warning);
  }
  if (notes) notes->tell(document);
  if (recorded) end_recording(arguments.record, *felt.recording.recorder(), document);
  for (const std::string& failure : tasks.failures()) document.warnings.push_back(failure);
  return Done{};
}

}  // namespace palpate::experiments
