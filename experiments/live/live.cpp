#include "experiments/live/live.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include <palpate/result.h>
#include "experiments/driver/suite.h"
#include "experiments/live/hand.h"
#include "experiments/live/recording_session.h"
#include "experiments/live/session.h"
#include "experiments/window/window.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

// Longest stretch of a path kept: it is walked back and forth, and more would only take memory.
constexpr double kLongestPathS = 60.0;
constexpr double kPathHz = 1000.0;  // rate of path generators

void begin_live(const LiveArguments& arguments, const LivePlan& plan, const Stage& stage, Context& context,
                LiveDocument& document) {
  document.head = new_head(context.command_line);
  document.scene = stage.scene_name;
  document.path = stage.path.name;
  document.device = plan.device.name();
  document.hand = plan.device.rig ? arguments.hand : "a person";
  document.grip = plan.device.rig ? arguments.device.grip : "";
  document.rule = arguments.rule;
  document.accelerated = arguments.accelerated;
  document.rate_hz = arguments.rate_hz;
  document.seconds = arguments.seconds;
  document.fade_ms = arguments.fade_ms;
  const surface::Surface& surface = stage.scene.input.models.front().surface;
  document.stiffness_n_per_mm = surface.stiffness_n_per_mm * (1.0 - surface.deformation);
  document.warnings.insert(document.warnings.end(), stage.warnings.begin(), stage.warnings.end());
  document.notes.insert(document.notes.end(), stage.notes.begin(), stage.notes.end());
}

Status check_window(const LiveArguments& arguments) {
  if (!arguments.accelerated) return Done{};
  return Error{"--window and --accelerated exclude each other", "leave one of them out"};
}

/// Shows the stage in the window, if any, before anything is prepared.
void show_stage(const LiveArguments& arguments, const Stage& stage) {
  if (arguments.link == nullptr) return;
  arguments.link->show(std::make_shared<const ShownScene>(
      ShownScene{stage.scene_name, stage.scene.input.models, stage.scene.view_up}));
}

/// Checks for a rate in whole Hz and a writable recording.
Status check_live(const LiveArguments& arguments) {
  if (arguments.rate_hz != std::round(arguments.rate_hz))
    return Error{fmt::format("--rate {} is no whole number", arguments.rate_hz), "give whole Hz"};
  return arguments.record.empty() ? Status(Done{})
                                  : check_recording_file(arguments.record, arguments.replace);
}

/// Reports argument errors before a large model is loaded or a device touched.
Result<DeviceChoice> check_early(const LiveArguments& arguments, const CheckedRun& checked,
                                 const render::Registry& registry, const device::Drivers& drivers) {
  if (!checked.renderers.empty()) {
    PALPATE_ASSIGN(LivePlan plan, plan_live(arguments, checked.renderers, registry, drivers));
    return std::move(plan.device);
  }
  return choose_device(arguments.device, drivers);
}

/// Makes and guards the device without opening it; reports properties unproven on hardware before any force.
Result<SessionDevice> make_device(const DeviceChoice& choice, const LiveArguments& arguments,
                                  const SessionClock& clock, LiveDocument& document) {
  PALPATE_ASSIGN(SessionDevice device, SessionDevice::make(choice, clock.clock(), 1.0 / arguments.rate_hz));
  document.guarded = device.guarded();
  document.unproven = device.unproven();
  device.report_unproven();
  return device;
}

/// Handles a session that ended before it began. Closing the window during preparation is no error: the
/// request is honoured and nothing is left behind.
Result<int> ended_early(const Error& error, const LiveArguments& arguments, Context& context) {
  if (arguments.link == nullptr || !arguments.link->stop_asked()) return error;
  context.progress.clear();
  tell("palpate: ended before it could be touched; nothing was written\n");
  return kExitOk;
}

Result<int> live(const LiveArguments& arguments, const device::Drivers& drivers, Context& context) {
  const render::Registry registry = all_renderers();
  PALPATE_TRY(check_live(arguments));
  RunArguments run = arguments.run;
  run.reference = "none";  // no scoring
  if (!run.stream.empty() && !arguments.changes.empty())
    return Error{"--changes and --stream exclude each other", "leave one of them out"};
  const std::string& hand = arguments.hand;
  if (!run.stream.empty() && (hand == "press" || hand == "slide" || hand == "tap"))
    return Error{
        "--hand " + hand + " needs a place on a surface, and a stream has none before its first image",
        "leave --hand out: the hand explores what it feels"};
  PALPATE_ASSIGN(CheckedRun checked, check_run(run, registry, context.progress));
  PALPATE_ASSIGN(const DeviceChoice choice, check_early(arguments, checked, registry, drivers));
  checked.stage.stream.replayed = false;
  checked.stage.usual_frames =
      static_cast<int>(std::lround(std::min(arguments.seconds, kLongestPathS) * kPathHz));
  Suite suite(context);
  PALPATE_TRY(open_folder(run, "live", checked.stage, suite));
  LiveDocument document;
  SessionClock clock(arguments.accelerated);
  // The guard is forked, so it comes before threads and a large scene.
  PALPATE_ASSIGN(SessionDevice device, make_device(choice, arguments, clock, document));
  if (arguments.link != nullptr) arguments.link->device_made();
  LinkedProgress seen(context.progress, arguments.link);
  const Result<Stage> stage = set_up(checked.stage, all_readers(), seen);
  if (!stage) return ended_early(stage.error(), arguments, context);
  show_stage(arguments, *stage);
  PALPATE_TRY(choose_renderers(!run.stream.empty(), registry, stage->scene.input, checked, document.notes));
  PALPATE_ASSIGN(LivePlan plan, plan_live(arguments, checked.renderers, registry, drivers));
  if (!arguments.record.empty())
    plan.header = recording_header(scene_or_stream(run), checked.stage.scene, stage->scene, run.surface);
  PALPATE_TRY(suite.begin(RunKey().add("live")));
  context.working = false;
  begin_live(arguments, plan, *stage, context, document);
  Workshop workshop{*stage, registry, run.load.threads, !arguments.accelerated};
  if (const Status ran = run_session(arguments, plan, workshop, clock, device, context.progress, document);
      !ran)
    return ended_early(ran.error(), arguments, context);
  context.working = true;
  context.progress.report("drawing the report", -1.0);
  PALPATE_TRY(suite.publish(
      {kLiveFile, to_json(document), live_tables(document), document.warnings, document.fault_names},
      live_page(document, suite.folder()), run.json));
  if (document.stopped_by != 0) return kSignalBase + document.stopped_by;
  return document.faults > document.rearmed ? kExitFellShort : kExitOk;
}

/// Fills in defaults.
LiveArguments with_defaults(LiveArguments arguments) {
  constexpr double kUsualS = 10.0, kLongestS = 86'400.0;
  const std::string& path = arguments.run.path;
  if (arguments.hand.empty())
    arguments.hand = arguments.link != nullptr            ? kMouseHand
                     : path.empty() || is_hand_path(path) ? kExploreHand
                                                          : kFollowHand;
  if (arguments.seconds == 0.0) arguments.seconds = arguments.link != nullptr ? kLongestS : kUsualS;
  return arguments;
}

}  // namespace

int run_live(const LiveArguments& arguments, Context& context) {
  if (!arguments.window) return run_live_with(arguments, session_drivers(), context);
  if (const Status right = check_window(arguments); !right) return fail(right.error(), kExitBadInput);
  return run_live_in_window(arguments, session_drivers(), context);
}

int run_live_with(const LiveArguments& given, const device::Drivers& drivers, Context& context) {
  return exit_status(live(with_defaults(given), drivers, context), context);
}

namespace {

// Period of checks whether the session is ready for a window.
constexpr std::chrono::milliseconds kWindowLook{5};

/// The thread of all sessions under one window. Create it before the window, whose threads have a lower
/// priority than the servo may have.
class SessionRunner {
 public:
  SessionRunner(const device::Drivers& drivers, Context& context)
      : drivers_(drivers), context_(context), thread_([this] { run(); }) {}
  SessionRunner(const SessionRunner&) = delete;
  SessionRunner& operator=(const SessionRunner&) = delete;
  ~SessionRunner() {
    {
      const std::scoped_lock lock(mutex_);
      over_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  void begin(const LiveArguments& arguments) {
    const std::scoped_lock lock(mutex_);
    next_ = arguments;
    busy_ = true;
    changed_.notify_all();
  }
  [[nodiscard]] bool busy() const {
    const std::scoped_lock lock(mutex_);
    return busy_;
  }
  [[nodiscard]] int status() const {
    const std::scoped_lock lock(mutex_);
    return status_;
  }
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !busy_; });
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return over_ || next_.has_value(); });
      if (over_) return;
      const LiveArguments arguments = *std::exchange(next_, std::nullopt);
      lock.unlock();
      const int status = run_live_with(arguments, drivers_, context_);
      lock.lock();
      status_ = status;
      busy_ = false;
      changed_.notify_all();
    }
  }

  const device::Drivers& drivers_;
  Context& context_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<LiveArguments> next_;
  bool busy_ = false, over_ = false;
  int status_ = kExitOk;
  std::thread thread_;
};

/// Logs each waiting time once.
class WaitingTimes {
 public:
  explicit WaitingTimes(Context& context) : context_(context) {}
  void begin() { touchable_ = felt_ = false; }
  void look(const SessionLink::View& view) {
    if (!touchable_ && view.touchable_s >= 0.0)
      announce(fmt::format("seen after {:.2f} s, touchable after {:.2f} s", view.shown_s, view.touchable_s));
    touchable_ = view.touchable_s >= 0.0;
    if (!felt_ && view.felt_s >= 0.0) announce(fmt::format("first touch after {:.2f} s", view.felt_s));
    felt_ = view.felt_s >= 0.0;
  }

 private:
  void announce(const std::string& what) {
    context_.progress.clear();
    tell("palpate: {}\n", what);
  }
  Context& context_;
  bool touchable_ = false, felt_ = false;
};

/// An unused name, live-001.palrec and so on, in the working directory.
std::string free_recording() {
  std::string name;
  for (int number = 1; name.empty() || std::filesystem::exists(name); ++number)
    name = fmt::format("live-{:03}.palrec", number);
  return name;
}

/// Sets up the next session if the window asks for one; else returns false.
bool asks_for_another(Window& window, LiveArguments& arguments) {
  const std::string dropped = window.take_dropped();
  const bool record = window.take_record();
  if (!dropped.empty()) {
    arguments.run.scene = dropped;
    // Settings for the previous scene do not apply.
    arguments.run.path.clear();
    arguments.run.out.clear();
    arguments.record.clear();
    arguments.changes.clear();
    return true;
  }
  if (record) arguments.record = arguments.record.empty() ? free_recording() : std::string();
  return record;
}

/// Runs until the window closes (true) or the session ends by itself.
bool run_one(Window& window, SessionLink& link, SessionRunner& runner, LiveArguments& arguments,
             WaitingTimes& times, const std::function<void(Window&)>& each_picture) {
  for (;;) {
    if (!window.frame()) {
      link.ask_stop();
      return true;
    }
    if (each_picture) each_picture(window);
    times.look(link.view());
    if (asks_for_another(window, arguments)) {
      link.ask_stop();
      return false;
    }
    // A scan that did not open leaves its error in the window.
    if (!runner.busy() && runner.status() != kExitBadInput) return true;
    if (!runner.busy())
      link.progress("The scene cannot be opened: the terminal says why. Drop another one.", -1.0);
  }
}

}  // namespace

WindowHooks::WindowHooks(const LiveArguments& arguments, Assembly& session, device::Mixer& mixer,
                         const SessionDevice& device, const render::SceneInput& scene, ShownSession shown)
    : link_(arguments.link) {
  if (link_ == nullptr) return;
  std::vector<std::shared_ptr<render::MovingModel>> moving;
  for (const render::ModelInput& model : scene.models)
    if (model.motion) moving.push_back(model.motion);
  feed_ = std::make_shared<WindowFeed>(session.servo(), mixer, std::move(moving));
  session.observe(*feed_);
  shown.feed = feed_;
  shown.rate_hz = arguments.rate_hz;
  shown.recorded = !arguments.record.empty();
  shown.felt_options = shown.labels.empty() ? "" : shown.labels.front() + ":stiffness=0.8";
  SessionActions actions;
  actions.switch_to = [&mixer](const device::SwitchRequest& request) { mixer.request(request); };
  actions.rearm = [&session] { (void)session.request_rearm(); };
  actions.stop = [&session] { session.request_stop(); };
  actions.homing_prompt = [&device] { return device.homing_prompt(); };
  if (shown.recorded)
    actions.mark = [&session](const std::string& text) {
      session.mark(text);
      return Status(Done{});
    };
  link_->running(std::make_shared<const ShownSession>(std::move(shown)), std::move(actions));
}

WindowHooks::~WindowHooks() {
  if (link_ != nullptr) link_->ended();
}

int run_live_in_window(const LiveArguments& given, const device::Drivers& drivers, Context& context,
                       const std::function<void(Window&)>& each_picture) {
  SessionLink link;
  const std::optional<Up> up = up_named(given.up);
  if (!up && !given.up.empty())
    return fail(Error{fmt::format("--up {} is no axis", given.up), "give z, y, x, -z, -y or -x"},
                kExitBadInput, &context.progress);
  WindowOptions options;
  options.up = up;
  LiveArguments arguments = given;
  arguments.link = &link;
  int status = kExitOk;
  {
    SessionRunner runner(drivers, context);
    runner.begin(arguments);
    // Device guards fork before the window makes threads, and argument errors need no window.
    while (runner.busy() && !link.ready_for_window()) std::this_thread::sleep_for(kWindowLook);
    Result<std::unique_ptr<Window>> window =
        runner.busy() ? Window::open(link, options) : Result<std::unique_ptr<Window>>(nullptr);
    if (!window) {
      link.ask_stop();
      runner.wait();
      return fail(window.error(), kExitBadInput, &context.progress);
    }
    WaitingTimes times(context);
    bool closed = *window == nullptr;
    while (!closed) {
      closed = run_one(**window, link, runner, arguments, times, each_picture);
      runner.wait();
      if (closed) break;
      (*window)->forget();
      link.begin(monotonic_ns());
      times.begin();
      runner.begin(arguments);
    }
    runner.wait();
    times.look(link.view());
    status = runner.status();
  }
  return status;
}

}  // namespace palpate::experiments
