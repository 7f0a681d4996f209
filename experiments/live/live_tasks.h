// What a live session does besides its ticks: renderers made anew while it runs, keys, requests over the
// network, switches by a timer.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "device/live/mixer.h"
#include "device/live/remote_command.h"
#include "device/servo/tick_observer.h"
#include "experiments/live/assembly.h"
#include "experiments/live/changes.h"
#include "experiments/live/live_recording.h"

namespace palpate::experiments {

class SessionLink;  // experiments/window/link.h

/// Asks for the next renderer at fixed times of the session.
class SwitchTimer final : public device::TickObserver {
 public:
  /// `every_s` 0: never.
  SwitchTimer(device::Mixer& mixer, double every_s) : mixer_(mixer), every_s_(every_s) {}
  void took(const device::Tick& tick) noexcept override;

 private:
  device::Mixer& mixer_;
  double every_s_;
  double next_s_ = 0.0;
  bool begun_ = false;
};

/// Where a new renderer begins, and who notes what it does.
struct TaskPlaces {
  Vec3 free_mm = Vec3::Zero();         ///< world: free for every renderer
  LiveRecording* recording = nullptr;  ///< null: none is made
};

/// work() is the worker's, key() the main thread's, act() any thread's. Refers to everything.
class LiveTasks final : public SessionTasks {
 public:
  /// `labels`: of the lanes, in their order.
  LiveTasks(Workshop& workshop, const std::vector<LiveChange>& changes, std::vector<std::string> labels,
            device::Mixer& mixer, const Clock& clock, const TaskPlaces& places)
      : workshop_(workshop),
        changes_(changes),
        labels_(std::move(labels)),
        mixer_(mixer),
        clock_(clock),
        places_(places) {}

  /// Changes that are typed into a window are taken from there; null: there is none. Before the session runs.
  void asked_by(SessionLink* link, std::vector<LiveSetting> settings) {
    link_ = link;
    settings_ = std::move(settings);
  }
  /// In every lane something else stands for the renderer that was asked for: all are made, on `threads`
  /// threads beside the servo's, and made(lane, renderer, seconds) is told of each. Before the session runs.
  using Made = std::function<void(std::size_t lane, const MadeRenderer& made, double at_s)>;
  void replace_stand_ins(int threads, Made made);
  /// Makes what is due, hands it over, and destroys what comes back.
  void work(double now_s) override;
  void key(char pressed) override;
  void ending() noexcept override { ending_.store(true, std::memory_order_release); }
  /// False: it names nothing that is there, or there is nothing to arm.
  bool act(const device::RemoteCommand& command, Assembly& session);
  /// Changes that were not made. Once nothing runs.
  [[nodiscard]] const std::vector<std::string>& failures() const { return failures_; }

 private:
  struct Ending;
  Result<std::unique_ptr<render::HapticRenderer>> make(const LiveChange& change);
  void be_nice() noexcept;
  void take_asked();
  [[nodiscard]] std::optional<LiveChange> due(double now_s);
  bool select(const device::RemoteCommand& command);

  Workshop& workshop_;
  const std::vector<LiveChange>& changes_;
  std::vector<std::string> labels_;
  device::Mixer& mixer_;
  const Clock& clock_;
  TaskPlaces places_;
  std::size_t next_ = 0;
  SessionLink* link_ = nullptr;
  std::vector<LiveSetting> settings_;  // as they are now, by lane
  std::deque<LiveChange> asked_;
  std::vector<bool> stood_in_;  // by lane: by something else until now
  Made made_;
  double now_s_ = 0.0;
  bool nice_ = false;
  std::atomic<bool> ending_{false};
  std::unique_ptr<render::HapticRenderer> pending_;
  std::uint8_t lane_ = 0;
  std::vector<std::string> failures_;
};

}  // namespace palpate::experiments
