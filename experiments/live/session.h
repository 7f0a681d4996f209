// One live session: device, hand, renderers, mixer, governor, servo.
#pragma once

#include <array>
#include <atomic>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo.h>
#include "device/live/hand_controls.h"
#include "device/live/mixer.h"
#include "device/live/remote_command.h"
#include "device/record/recorder.h"
#include "device/record/recording_header.h"
#include "device/record/tick_source.h"
#include "experiments/live/assembly.h"
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/live/remote.h"
#include "experiments/live/session_device.h"

namespace palpate::experiments {

/// A session's checked requirements.
struct LivePlan {
  DeviceChoice device;
  device::WorkspaceOptions workspace;
  device::SwitchRule rule = device::SwitchRule::kContactElseWait;
  std::vector<LiveSetting> settings;
  std::vector<LiveChange> changes;
  std::optional<ListenAddress> listen;
  device::RecordingHeader header;  ///< program and scene of a recording, if one is wanted
};
/// Checks all arguments but scene and folder.
[[nodiscard]] Result<LivePlan> plan_live(const LiveArguments& arguments,
                                         const std::vector<RendererRequest>& renderers,
                                         const render::Registry& registry, const device::Drivers& drivers);

/// Prepares, opens the device, runs and fills the document. Starts on a subset of the points if a window
/// waits for a large scene. The caller adds head, scene and the stage's warnings.
[[nodiscard]] Status run_session(const LiveArguments& arguments, const LivePlan& plan, Workshop& workshop,
                                 SessionClock& clock, SessionDevice& device, ProgressBar& progress,
                                 LiveDocument& document);

// What observes its ticks and works besides them: rebuilt renderers, keys, network requests, timed switches.

/// Records every renderer's frames and the mixer's decisions. Unused in sessions without a recording.
/// tracked() is for one thread at a time: first the preparing thread, then the worker. fill() and recorded()
/// are for the servo thread.
class LiveRecording final : public device::TickSource {
 public:
  /// Wraps a renderer for the mixer and records its calls. Its table entry has its label; later ones of the
  /// same label become "label (2)". Errors: the file's, once open.
  [[nodiscard]] Result<std::unique_ptr<render::HapticRenderer>> tracked(
      std::unique_ptr<render::HapticRenderer> renderer, const LiveSetting& setting, bool passivity_apart,
      const Clock& clock);

  /// Creates the file with the renderers tracked so far. Every renderer of the mixer must come from
  /// tracked().
  /// `depth`: a stream's images come too.
  [[nodiscard]] Status open(const std::string& path, bool replace, bool depth, device::RecordingHeader header,
                            const device::Mixer& mixer);
  /// Removes the file of a session without any tick.
  void discard(const std::string& path);
  /// Null before open().
  [[nodiscard]] device::Recorder* recorder() noexcept { return recorder_.get(); }

  void fill(const device::Tick& tick, device::RecordedTick& out) noexcept override;
  void recorded() noexcept override;

 private:
  const device::Mixer* mixer_ = nullptr;
  std::vector<device::RecordedRenderer> table_;
  std::unique_ptr<device::Recorder> recorder_;
};

class SessionLink;  // experiments/window/link.h

/// Requests the next renderer at fixed times of the session.
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

/// Where new renderers start, and their recording.
struct TaskPlaces {
  Vec3 free_mm = Vec3::Zero();         ///< world frame, free for every renderer
  LiveRecording* recording = nullptr;  ///< null: not recorded
};

/// work() runs on the worker, key() on the main thread, act() on any thread. Refers to its arguments.
class LiveTasks final : public SessionTasks {
 public:
  /// `labels`: by lane.
  LiveTasks(Workshop& workshop, const std::vector<LiveChange>& changes, std::vector<std::string> labels,
            device::Mixer& mixer, const Clock& clock, const TaskPlaces& places)
      : workshop_(workshop),
        changes_(changes),
        labels_(std::move(labels)),
        mixer_(mixer),
        clock_(clock),
        places_(places) {}

  /// Takes changes typed into this window; null: none. Call before the session runs.
  void asked_by(SessionLink* link, std::vector<LiveSetting> settings) {
    link_ = link;
    settings_ = std::move(settings);
  }
  /// Replaces every lane's stand-in by the requested renderer, built on `threads` threads beside the servo's;
  /// calls made(lane, renderer, seconds) for each. Call before the session runs.
  using Made = std::function<void(std::size_t lane, const MadeRenderer& made, double at_s)>;
  void replace_stand_ins(int threads, Made made);
  /// Called first by every work(). Before the session runs.
  void beside(std::function<void()> also) { beside_ = std::move(also); }
  /// Builds what is due, hands it over and destroys returned renderers.
  void work(double now_s) override;
  void key(char pressed) override;
  void ending() noexcept override { ending_.store(true, std::memory_order_release); }
  /// False if the command names nothing present or there is nothing to arm.
  bool act(const device::RemoteCommand& command, Assembly& session);
  /// Changes that failed. Read after the session.
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
  std::vector<LiveSetting> settings_;  // current, by lane
  std::deque<LiveChange> asked_;
  std::vector<bool> stood_in_;  // by lane: still a stand-in
  Made made_;
  double now_s_ = 0.0;
  bool nice_ = false;
  std::atomic<bool> ending_{false};
  std::unique_ptr<render::HapticRenderer> pending_;
  std::uint8_t lane_ = 0;
  std::function<void()> beside_;
  std::vector<std::string> failures_;
};

// Observes every tick of a live session in fixed memory.

/// Decisions kept; later ones are only counted.
inline constexpr std::size_t kMostDecisions = 20'000;
/// Stretches of the chart: about its width in dots.
inline constexpr std::size_t kLiveSamples = 1'200;

/// For the servo's thread until that ends, then for any. Allocates in its constructor only.
class LiveWatch final : public device::TickObserver {
 public:
  /// `stretch_s`: length of a stretch of the chart. `stiffness_n_per_mm`: the session's largest.
  LiveWatch(const device::Mixer& mixer, std::size_t lanes, double stretch_s, double stiffness_n_per_mm);
  void took(const device::Tick& tick) noexcept override;
  /// Writes into a document whose renderers are in lane order.
  void tell(LiveDocument& document) const;

 private:
  struct Lane {
    device::DurationHistogram step;
    std::uint64_t frames = 0, contact_frames = 0, felt_frames = 0;
    double largest_step_n = 0.0;
    metrics::ForceSteps felt_steps;
    Vec3 last_n = Vec3::Zero();
    std::uint32_t generation = 0, made = 1;
    device::Disqualified disqualified = device::Disqualified::kNo;
    bool known = false;
  };
  void watch_lanes(const device::Tick& tick, const device::MixedFrame& now) noexcept;
  void watch_steps(const device::MixedFrame& now) noexcept;
  void note_decision(const device::Tick& tick, const device::MixedFrame& now) noexcept;
  void sample(const device::Tick& tick, const device::MixedFrame& now) noexcept;

  const device::Mixer& mixer_;
  std::vector<Lane> lanes_;
  double stretch_s_;
  device::MixedFrame before_;
  bool has_before_ = false;
  bool faulted_ = false;
  device::SwitchSource source_ = device::SwitchSource::kProgram;
  double begun_s_ = 0.0;
  bool begun_ = false;
  std::uint64_t ticks_ = 0, faults_ = 0, rearmed_ = 0, half_rate_ = 0;
  std::uint64_t switches_ = 0, fades_ = 0, refused_ = 0, waited_ = 0, decisions_lost_ = 0;
  double largest_step_n_ = 0.0, largest_excess_n_ = 0.0;
  std::array<bool, 32> fault_seen_{};
  std::vector<LiveDecision> decisions_;
  std::vector<LiveSample> samples_;
  std::size_t sample_ = 0, in_sample_ = 0;
};

}  // namespace palpate::experiments
