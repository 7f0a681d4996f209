#include "experiments/live/window_hooks.h"

#include <fmt/format.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "experiments/window/window.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
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
