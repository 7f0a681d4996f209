// `palpate live`: several renderers under one hand, one felt, switched during contact. Runs on a simulated
// device, in real time or faster, or on any driver's device.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/device/loop_histogram.h>
#include <palpate/device/servo.h>
#include <palpate/triple_buffer.h>
#include "device/live/mixer.h"
#include "device/record/recorder.h"
#include "experiments/driver/study_run.h"
#include "experiments/live/assembly.h"
#include "experiments/live/remote.h"
#include "experiments/report/page.h"
#include "experiments/streams/open_stream.h"
#include "experiments/window/link.h"
#include "toolkit/metrics/force_steps.h"
#include "toolkit/render/depth_camera.h"
#include "toolkit/stream/depth_codec.h"

namespace palpate::experiments {

// A stream of depth images beside a live session: its frames go to the renderers under the hand at the time
// of their arrival. Neither the servo nor the camera waits for it.

/// Facts of a session's stream; no source: none. Fates are those of the renderer that was felt.
struct LiveStreamFacts {
  std::string source, about;
  std::uint64_t frames = 0;  ///< given to the felt renderer
  std::uint64_t taken = 0, repeated = 0, late = 0, truncated = 0, failed = 0;
  std::uint64_t skipped = 0;  ///< not given: over a period late when their turn came
  std::uint64_t unreadable = 0;
  std::uint64_t unrecorded = 0;  ///< could not be encoded
  std::uint64_t silences = 0;    ///< times that nothing came for kSilentPeriods
  bool ended = false;            ///< the source had no more
  /// Percentiles at most 1/32 too high, as device::DurationHistogram counts them.
  std::optional<double> window_p50_ms, window_p99_ms, whole_p50_ms, whole_p99_ms;
  /// From an image's light until the surface around the HIP could be felt.
  std::optional<double> light_to_touch_p50_ms, light_to_touch_p99_ms;
};

/// Without an image for so many periods a camera counts as silent.
inline constexpr double kSilentPeriods = 3.0;

/// Where the hand is, for the window of an image that is made touchable first.
struct StreamedHand {
  Vec3 hip_mm = Vec3::Zero();
  std::size_t lane = 0;  ///< of the felt renderer
};

class LiveStream final : public device::TickObserver {
 public:
  /// `receivers`: by lane. Real time: begin() starts a thread. On a virtual clock work() gives between two
  /// ticks what the next of them, `period_s` later, shall feel.
  LiveStream(OpenStream& open, std::vector<stream::DepthReceiver*> receivers, const device::Mixer& mixer,
             bool accelerated, double period_s);
  ~LiveStream() override;
  LiveStream(const LiveStream&) = delete;
  LiveStream& operator=(const LiveStream&) = delete;

  /// Records camera and frames. Before the session runs.
  [[nodiscard]] Status record(device::Recorder& recorder);
  /// The images for a window. Before the session runs.
  [[nodiscard]] std::shared_ptr<TripleBuffer<ShownImage>> shown();
  void begin();
  /// No receiver is called after it returns.
  void end();

  /// Servo thread.
  void took(const device::Tick& tick) noexcept override;
  /// The session's worker. News of the stream, if any.
  [[nodiscard]] std::string work();
  /// After end().
  [[nodiscard]] LiveStreamFacts facts() const;

 private:
  void run();
  void pump(double until_s);
  [[nodiscard]] bool read_next();
  void give();
  void show();
  [[nodiscard]] double now_s() const;

  OpenStream& open_;
  std::vector<stream::DepthReceiver*> receivers_;
  const device::Mixer& mixer_;
  bool accelerated_;
  double period_s_;
  TripleBuffer<StreamedHand> hand_;
  std::atomic<std::int64_t> tick_ns_{0};  // of the machine's clock, at the newest tick
  std::atomic<double> tick_s_{0.0};
  std::atomic<bool> begun_{false}, ending_{false}, ended_{false};
  std::atomic<double> given_s_{0.0};
  // Used by who gives frames.
  bool has_next_ = false, first_ = true;
  std::string why_ended_;  // before ended_ is set
  double base_s_ = 0.0;    // of the session, at the stream's 0
  stream::DepthFrame frame_;
  device::Recorder* recorder_ = nullptr;
  std::unique_ptr<stream::DepthCodec> codec_;
  std::shared_ptr<TripleBuffer<ShownImage>> shown_;
  std::optional<render::PixelRays> rays_;    // of what is shown
  std::vector<std::uint32_t> shown_pixels_;  // in the order in which they are shown
  LiveStreamFacts facts_;
  device::DurationHistogram window_, whole_, light_;
  // Used by the worker.
  bool silent_ = false, end_reported_ = false;
  std::uint64_t silences_ = 0;
  std::thread thread_;
};

class SessionLink;  // experiments/window/link.h

inline constexpr const char* kLiveFile = "live.json";
/// Increases when a key is redefined or removed.
inline constexpr const char* kLiveSchema = "palpate-live/1";

struct LiveArguments {
  RunArguments run;  ///< scene, renderers, path, folder, model, surface, json
  DeviceArguments device;
  std::string hand;  ///< empty: "mouse" in a window; "follow" if a path other than "hand" is named; else
                     ///< "explore"
  std::string mapping = "1:1", rule = "wait", changes, record;
  std::string listen;    ///< PORT or ADDRESS:PORT; empty: do not listen
  double seconds = 0.0;  ///< 0: ten, or until the window closes
  double switch_every_s = 0.0, rate_hz = 1000.0, fade_ms = 150.0;
  double stand_in = 60'000.0;  ///< points rendered while a large scene is prepared; 0: none
  std::string up;              ///< the window's up axis; empty: the scene's, else z
  bool window = false, accelerated = false, rearm = false;
  bool replace = false;         ///< overwrites an existing recording
  SessionLink* link = nullptr;  ///< link of the window, which outlives the session; null: no window
};

/// A decision of the mixer worth reporting.
struct LiveDecision {
  double t_s = 0.0;
  device::SwitchSource source = device::SwitchSource::kProgram;
  device::MixDecision decision = device::MixDecision::kNone;
  device::SwitchReason reason = device::SwitchReason::kNone;
  std::uint8_t from = 0, to = 0;  ///< lanes; equal if no other is involved
  double before_n = 0.0;          ///< force sent
  double difference_n = 0.0;      ///< between the two
};

/// Facts of one renderer over the session.
struct LiveRenderer {
  std::string label, name;
  std::vector<std::pair<std::string, std::string>> options;  ///< as resolved at the end
  double prepare_ms = 0.0;
  std::uint64_t bytes = 0, shared_bytes = 0;
  std::uint64_t frames = 0, contact_frames = 0, felt_frames = 0;
  std::uint64_t late_frames = 0, coarse_frames = 0;  ///< of a prepared file: render::FrameCounters
  std::uint64_t swaps = 0, stalled_frames = 0;       ///< of a stream: the same
  device::DurationStatistics step;
  double largest_step_n = 0.0;     ///< of its own force between frames, felt or not
  metrics::ForceSteps felt_steps;  ///< of its own force while felt
  std::uint32_t made = 1;          ///< 1 plus the parameter changes taken over
  std::string disqualified;
};

/// Means over a stretch of the session, for the chart.
struct LiveSample {
  double t_s = 0.0;
  double out_n = 0.0;
  std::vector<double> each_n;
};

/// Facts of the recording; no file: not recorded.
struct LiveRecorded {
  std::string file;
  std::uint64_t ticks = 0, written = 0, lost = 0, bytes = 0;
};

/// Facts of network commands; no address: did not listen.
struct LiveRemote {
  std::string where;
  RemoteCounts counts;
};

struct LiveDocument {
  metrics::DocumentHead head;
  std::string scene, device, hand, grip, path, rule, scheduling;
  bool accelerated = false;
  double rate_hz = 1000.0, seconds = 0.0, fade_ms = 0.0;
  double world_per_device = 1.0, stiffness_n_per_mm = 0.0, felt_stiffness_n_per_mm = 0.0;
  double force_limit_n = 0.0;  ///< the governor's
  device::LoopStatistics loop;
  std::vector<device::DurationBin> lateness;
  std::uint64_t ticks = 0, faults = 0, rearmed = 0, half_rate_ticks = 0;
  std::uint64_t switches = 0, fades = 0, refused = 0, waited = 0;
  double largest_step_n = 0.0;    ///< of the force sent
  double largest_excess_n = 0.0;  ///< largest excess of a switch's force step above its bound
  double steal_percent = 0.0;
  std::uint64_t resident_before_bytes = 0, resident_after_bytes = 0;
  std::uint64_t decisions_lost = 0;
  LiveRecorded recording;
  std::uint64_t watchdog_trips = 0;   ///< real time only
  std::uint64_t replugged = 0;        ///< times the device was lost and came back
  bool guarded = false;               ///< by a separate process
  std::vector<std::string> unproven;  ///< device properties unproven on hardware
  LiveRemote remote;
  LiveStreamFacts stream;
  std::vector<SessionMark> marks;
  std::vector<std::string> fault_names;
  std::vector<LiveDecision> decisions;
  std::vector<LiveRenderer> renderers;
  std::vector<LiveSample> samples;
  std::vector<std::string> warnings, notes;
  int stopped_by = 0;  ///< the signal that ended it; 0: none. Not in the file
};

[[nodiscard]] std::string to_json(const LiveDocument& document);
[[nodiscard]] std::vector<Table> live_tables(const LiveDocument& document);
/// Draws the figures into the folder.
[[nodiscard]] Page live_page(const LiveDocument& document, const OutputFolder& folder);

/// Returns the exit status: 1 if the session ended with a latched fault, 128 + signal if one ended it.
int run_live(const LiveArguments& arguments, Context& context);
/// The same with these drivers.
int run_live_with(const LiveArguments& arguments, const device::Drivers& drivers, Context& context);

// Connects a session to the window over it.

class Window;  // experiments/window/window.h

/// Shows a running session in a window while it lives; does nothing without a link. Create before the session
/// runs. Refers to session and mixer.
class WindowHooks {
 public:
  /// The device supplies homing instructions.
  WindowHooks(const LiveArguments& arguments, Assembly& session, device::Mixer& mixer,
              const SessionDevice& device, const render::SceneInput& scene, ShownSession shown);
  ~WindowHooks();
  WindowHooks(const WindowHooks&) = delete;
  WindowHooks& operator=(const WindowHooks&) = delete;

 private:
  SessionLink* link_;
  std::shared_ptr<WindowFeed> feed_;
};

/// `palpate live --window`: runs the window on this thread and sessions on another, one for each scan dropped
/// on the window. Returns the last session's exit status. `each_picture` runs on this thread after each
/// picture, for automation.
int run_live_in_window(const LiveArguments& arguments, const device::Drivers& drivers, Context& context,
                       const std::function<void(Window&)>& each_picture = {});

}  // namespace palpate::experiments
