// Connects a live session and its window. The session loads, prepares and renders on its own thread; the
// window needs the program's first thread. Neither includes the other's code.
//
// The servo's data comes through the feed, without a lock. Everything else (scene, progress, button requests)
// passes between the session's and the window's threads under a mutex that the servo never takes.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/servo.h>
#include <palpate/motion.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/triple_buffer.h>
#include "device/live/mixer.h"
#include "device/live/switch_rules.h"
#include "device/simulated/hand_script.h"
#include "toolkit/deformation/deformer.h"

namespace palpate::experiments {

// The window's view of a running servo: the whole newest tick, and a few numbers of every tick.

/// Models whose motion is shown; further ones stay drawn at their start.
inline constexpr std::size_t kMostShownMotions = 16;

/// A tick with its data.
struct WatchedTick {
  std::uint64_t ticks = 0;  ///< since the session began, this one included; 0: none yet
  device::Tick tick;
  device::MixedFrame mixed;
  device::DeviceMap map;
  /// Moving models, in the order given to the feed.
  std::array<geometry::RigidTransform, kMostShownMotions> world_from_model;
};

/// A question for the present positions of a deformable model's points, answered by the servo's next tick.
struct PointQuestion {
  /// Takes some 10 us of one tick a picture: reading a point is a look-up.
  static constexpr std::size_t kMost = 256;
  std::uint32_t model = 0, count = 0;
  std::array<std::uint32_t, kMost> point{};  ///< indices in the model's cloud
};
struct PointAnswer {
  PointQuestion of;
  /// Relative to the cloud's origin.
  std::array<Vec3f, PointQuestion::kMost> place_mm{};
  bool known = false;  ///< false: the felt renderer has no deformable points
};

/// A tick's plotted numbers.
struct TickSample {
  double t_s = 0.0;
  float sent_n = 0.0f;   ///< magnitude
  float step_us = 0.0f;  ///< all renderers together
  bool contact = false;
  bool fault = false;
};

/// A lock-free ring of fixed size that passes samples between two threads in order. Samples that do not fit
/// are lost and counted.
class SampleRing {
 public:
  /// 16 s at 1 kHz.
  static constexpr std::size_t kSize = std::size_t{1} << 14;

  /// For the writer. Wait-free, no allocation.
  void push(const TickSample& sample) noexcept;
  /// For the reader: appends all samples present. Returns their number.
  std::size_t drain(std::vector<TickSample>& into);
  /// Any thread.
  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_.load(std::memory_order_relaxed); }

 private:
  std::array<TickSample, kSize> ring_{};
  std::atomic<std::uint64_t> written_{0}, read_{0}, lost_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

/// An observer of ticks for one reader. The servo's side copies some 3 KB a tick, looks up at most
/// PointQuestion::kMost points, and never waits. Refers to servo and mixer, which must live while took() is
/// called.
class WindowFeed final : public device::TickObserver {
 public:
  /// Follows at most kMostShownMotions of `moving`, read in the servo's thread only.
  WindowFeed(const device::Servo& servo, const device::Mixer& mixer,
             std::vector<std::shared_ptr<render::MovingModel>> moving);
  void took(const device::Tick& tick) noexcept override;

  /// The reader's thread. True if a newer tick has arrived.
  bool acquire() noexcept { return newest_.acquire(); }
  [[nodiscard]] const WatchedTick& newest() const noexcept { return newest_.front(); }
  [[nodiscard]] SampleRing& samples() noexcept { return samples_; }
  /// The reader's thread: a newer question replaces an older one.
  void ask(const PointQuestion& question) { questions_.publish(question); }
  /// The reader's thread: a new answer, or null.
  [[nodiscard]] const PointAnswer* answer() noexcept {
    return answers_.acquire() ? &answers_.front() : nullptr;
  }
  /// Magnitude of the last force sent, N; for any thread.
  [[nodiscard]] const std::atomic<float>& force_n() const noexcept { return force_n_; }
  /// Ticks taken, independent of the reader; for any thread.
  [[nodiscard]] std::uint64_t ticks() const noexcept { return ticks_.load(std::memory_order_acquire); }

 private:
  const device::Servo& servo_;
  const device::Mixer& mixer_;
  std::vector<std::shared_ptr<render::MovingModel>> moving_;
  void answer_question() noexcept;

  TripleBuffer<WatchedTick> newest_;
  TripleBuffer<PointQuestion> questions_;
  TripleBuffer<PointAnswer> answers_;
  const render::HapticRenderer* asked_ = nullptr;    // the felt one, as last seen
  const deformation::Editable* editable_ = nullptr;  // the same, if deformable
  SampleRing samples_;
  std::atomic<std::uint64_t> ticks_{0};
  std::atomic<float> force_n_{0.0f};
};

// A session's last seconds, for plots.

/// Frame-time bins by powers of the square root of 2 from 0.25 us; the last holds everything above 8 ms.
struct FrameTimeHistogram {
  static constexpr std::size_t kBins = 32;
  static constexpr double kFirstUs = 0.25;
  std::array<std::uint64_t, kBins> count{};

  void add(double us) noexcept;
  [[nodiscard]] static double low_us(std::size_t bin) noexcept;
  [[nodiscard]] std::uint64_t most() const noexcept;
};

/// Appends drained samples and drops those older than kSeconds. One thread.
class History {
 public:
  static constexpr double kSeconds = 10.0;

  void clear();
  void take(SampleRing& ring);
  [[nodiscard]] const std::deque<TickSample>& samples() const noexcept { return samples_; }
  [[nodiscard]] const FrameTimeHistogram& frame_times() const noexcept { return frame_times_; }
  /// Largest and mean frame time; 0 if empty.
  [[nodiscard]] double worst_step_us() const noexcept;
  [[nodiscard]] double mean_step_us() const noexcept;
  /// Per plot column the largest value in it; negative if none.
  template <class Of>
  [[nodiscard]] std::vector<float> columns(std::size_t count, Of&& of) const {
    std::vector<float> most(count, -1.0f);
    if (samples_.empty() || count == 0) return most;
    const double from_s = samples_.back().t_s - kSeconds;
    for (const TickSample& one : samples_) {
      const auto at = static_cast<std::size_t>((one.t_s - from_s) / kSeconds * static_cast<double>(count));
      float& into = most[at < count ? at : count - 1];
      const float value = of(one);
      if (value > into) into = value;
    }
    return most;
  }

 private:
  std::deque<TickSample> samples_;
  std::vector<TickSample> fresh_;
  FrameTimeHistogram frame_times_;
};

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
