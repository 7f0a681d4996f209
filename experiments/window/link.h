// Between a live session and the window over it. The session runs on a thread of its own, loads, prepares and
// feels; the window runs on the program's first thread, as window systems ask for. Neither knows the other's
// code: they meet here.
//
// What the servo says comes through the feed, without a lock. Everything else (scene, progress, wishes of
// buttons) is between the session's own thread and the window's, under a mutex that the servo never sees.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "device/interface/device.h"
#include "device/live/switch_request.h"
#include "device/servo/device_map.h"
#include "device/simulated/hand_guide.h"
#include "experiments/window/feed.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::experiments {

/// A scene to be drawn. Shared, immutable.
struct ShownScene {
  std::string name;
  std::vector<render::ModelInput> models;
  std::string up{};  ///< as up_named() takes it; empty: nobody has said
};

/// A session that is running, as far as a window asks.
struct ShownSession {
  std::string device;
  std::vector<std::string> labels;  ///< of the renderers, by lane
  std::string felt_options;         ///< an example of what may be changed
  device::DeviceLimits limits;
  double force_limit_n = 0.0;  ///< of the governor
  double rate_hz = 1000.0;
  bool recorded = false;
  /// What stands in a lane for the renderer of its label until that one is prepared; empty: nothing. It is
  /// told by its generation, the first.
  std::string stand_in;
  std::shared_ptr<WindowFeed> feed;
  std::shared_ptr<device::HandGuide> hand;  ///< null: the mouse is not the hand
};

/// What the window may ask of the session; each may be called from the window's thread while the session
/// runs. Empty ones: the session cannot do it.
struct SessionActions {
  std::function<void(const device::SwitchRequest&)> switch_to;
  std::function<void()> rearm;
  std::function<void()> stop;
  std::function<Status(const std::string&)> mark;  ///< a remark into the recording
  /// What a person has to do until the device knows its zero, a sentence without its full stop; empty: it
  /// does.
  std::function<std::string()> homing_prompt;
};

class SessionLink {
 public:
  SessionLink() = default;
  SessionLink(const SessionLink&) = delete;
  SessionLink& operator=(const SessionLink&) = delete;

  // The session's thread.
  /// From here on a window may open: nothing is forked any more.
  void device_made() noexcept { ready_.store(true, std::memory_order_release); }
  void show(std::shared_ptr<const ShownScene> scene);
  void progress(std::string_view what, double fraction);
  /// From here on the servo runs; until ended().
  void running(std::shared_ptr<const ShownSession> session, SessionActions actions);
  /// No action is called any more when it returns.
  void ended();
  /// What was typed as changes of options, "label:key=value", in order; each once.
  [[nodiscard]] std::vector<std::string> take_changes();
  void answer(std::string sentence);
  [[nodiscard]] bool stop_asked() const noexcept { return stop_.load(std::memory_order_acquire); }

  // The window's thread.
  struct View {
    std::shared_ptr<const ShownScene> scene;
    std::shared_ptr<const ShownSession> session;               ///< null: not running
    std::string phase;                                         ///< of preparation
    double fraction = -1.0;                                    ///< of the phase; below 0: not known
    std::string answer;                                        ///< to the last wish
    double shown_s = -1.0, touchable_s = -1.0, felt_s = -1.0;  ///< since begin(); below 0: not yet
  };
  [[nodiscard]] View view() const;
  void request(const device::SwitchRequest& request);
  void rearm();
  void mark(const std::string& text);
  void change(std::string text);
  /// SessionActions::homing_prompt; empty too where nothing runs.
  [[nodiscard]] std::string homing_prompt() const;
  /// The first tick was seen, the first contact.
  void touchable();
  void felt();
  [[nodiscard]] bool ready_for_window() const noexcept { return ready_.load(std::memory_order_acquire); }
  /// The session ends as soon as it can; a preparation gives up.
  void ask_stop();
  /// Before another session: forgets everything. `from_ns`: when it was asked for (monotonic_ns).
  void begin(std::int64_t from_ns);
  static constexpr std::uint32_t kFirstGeneration = 1;

 private:
  [[nodiscard]] double since_begin_s() const;

  mutable std::mutex mutex_;
  View view_;
  SessionActions actions_;
  std::vector<std::string> changes_;
  std::int64_t begun_ns_ = monotonic_ns();
  std::atomic<bool> stop_{false}, ready_{false};
};

/// Shows progress in two places; who waits at the window can end the work.
class LinkedProgress final : public Progress {
 public:
  /// `link` null: in one.
  LinkedProgress(Progress& terminal, SessionLink* link) : terminal_(terminal), link_(link) {}
  void report(std::string_view what, double fraction) override {
    terminal_.report(what, fraction);
    if (link_ != nullptr) link_->progress(what, fraction);
  }
  [[nodiscard]] bool cancelled() const override {
    return terminal_.cancelled() || (link_ != nullptr && link_->stop_asked());
  }

 private:
  Progress& terminal_;
  SessionLink* link_;
};

}  // namespace palpate::experiments
