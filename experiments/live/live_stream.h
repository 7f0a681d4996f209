// A stream of depth images beside a live session: its frames go to the renderers under the hand at the time
// of their arrival. Neither the servo nor the camera waits for it.
#pragma once

#include <atomic>
#include <cstdint>
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
#include "experiments/streams/open_stream.h"
#include "experiments/window/link.h"
#include "toolkit/render/depth_camera.h"
#include "toolkit/stream/depth_codec.h"

namespace palpate::experiments {

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

}  // namespace palpate::experiments
