// Connects a live session and its window. The session loads, prepares and renders on its own thread; the
// window needs the program's first thread. Neither includes the other's code.
//
// The servo's data comes through the feed, without a lock. Everything else (scene, progress, button requests)
// passes between the session's and the window's threads under a mutex that the servo never takes.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "device/live/switch_rules.h"
#include "device/simulated/hand_script.h"
#include "experiments/window/feed.h"

namespace palpate::experiments {

/// A drawn scene. Shared, immutable.
struct ShownScene {
  std::string name;
  std::vector<render::ModelInput> models;
  std::string up{};  ///< as for up_named(); empty: not stated
};

/// The points of a stream's newest image.
struct ShownImage {
  std::vector<float> places;  ///< three a point, camera frame, in an order whose beginnings are even samples
  geometry::RigidTransform world_from_camera;
};

/// A running session's facts for the window.
struct ShownSession {
  std::string device;
  std::vector<std::string> labels;  ///< the renderers', by lane
  std::string felt_options;         ///< an example of changeable options
  device::DeviceLimits limits;
  double force_limit_n = 0.0;  ///< the governor's
  double rate_hz = 1000.0;
  bool recorded = false;
  /// Renderer in a lane, of the first generation, until its requested one is prepared; empty: none.
  std::string stand_in;
  std::shared_ptr<WindowFeed> feed;
  std::shared_ptr<TripleBuffer<ShownImage>> images{};  ///< replace the first model's points; null: no stream
  std::shared_ptr<device::HandGuide> hand;             ///< null: the mouse is not the hand
};

/// Actions the window may request from its own thread while the session runs. Empty functions: not available.
struct SessionActions {
  std::function<void(const device::SwitchRequest&)> switch_to;
  std::function<void()> rearm;
  std::function<void()> stop;
  std::function<Status(const std::string&)> mark;  ///< adds a remark to the recording
  /// Homing instruction without full stop; empty once homed.
  std::function<std::string()> homing_prompt;
};

class SessionLink {
 public:
  SessionLink() = default;
  SessionLink(const SessionLink&) = delete;
  SessionLink& operator=(const SessionLink&) = delete;

  // For the session's thread.
  /// Lets a window open: all forks are done.
  void device_made() noexcept { ready_.store(true, std::memory_order_release); }
  void show(std::shared_ptr<const ShownScene> scene);
  void progress(std::string_view what, double fraction);
  /// The servo runs from here until ended().
  void running(std::shared_ptr<const ShownSession> session, SessionActions actions);
  /// No action is called after this returns.
  void ended();
  /// Changes of options typed as "label:key=value", in order; each once.
  [[nodiscard]] std::vector<std::string> take_changes();
  void answer(std::string sentence);
  [[nodiscard]] bool stop_asked() const noexcept { return stop_.load(std::memory_order_acquire); }

  // For the window's thread.
  struct View {
    std::shared_ptr<const ShownScene> scene;
    std::shared_ptr<const ShownSession> session;               ///< null: not running
    std::string phase;                                         ///< the preparation's
    double fraction = -1.0;                                    ///< the phase's; below 0: unknown
    std::string answer;                                        ///< to the last request
    double shown_s = -1.0, touchable_s = -1.0, felt_s = -1.0;  ///< since begin(); below 0: not yet
  };
  [[nodiscard]] View view() const;
  void request(const device::SwitchRequest& request);
  void rearm();
  void mark(const std::string& text);
  void change(std::string text);
  /// SessionActions::homing_prompt; also empty without a session.
  [[nodiscard]] std::string homing_prompt() const;
  /// Note the first tick seen and the first contact.
  void touchable();
  void felt();
  [[nodiscard]] bool ready_for_window() const noexcept { return ready_.load(std::memory_order_acquire); }
  /// Ends the session as soon as possible; cancels a preparation.
  void ask_stop();
  /// Resets everything for another session. `from_ns`: time of its request (monotonic_ns).
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

/// Progress in terminal and window; the window can cancel the work.
class LinkedProgress final : public Progress {
 public:
  /// `link` null: terminal only.
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
