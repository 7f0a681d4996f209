// A stream of depth images beside a probe path: kept in memory, and given to one renderer at the times at
// which a hand would have met it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/motion.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/metrics/scores.h"

namespace palpate::experiments {

/// Delay from an image's arrival to ticks that feel it.
struct StreamDelay {
  /// The time of B in one frame's budget of 33 ms that a window of 128 x 128 pixels is allowed: the same for
  /// every renderer, so that a replay is the same every time.
  static constexpr double kUsualMs = 5.0;
  static constexpr double kMostMs = 1e3;
  double ms = kUsualMs;
  /// Each renderer's own times: an image is due its predecessor's window_ms after the renderer was free, and
  /// images that newer ones overtake meanwhile are skipped.
  bool measured = false;
};
/// "measured", or milliseconds; empty: the usual one.
[[nodiscard]] Result<StreamDelay> parse_stream_delay(const std::string& text);

/// The images of a run. Times count from the run's begin.
struct StreamFrames {
  std::string source;  ///< as the user wrote it
  std::string about;   ///< DepthSource::describe()
  stream::DepthCamera camera;
  std::vector<stream::DepthFrame> frames;  ///< in the order of their arrival
  std::vector<std::string> unreadable;     ///< messages
};

/// Gives the frames to a receiver as a replay goes on. In the place of a scene's simulation every pass of a
/// replay meets the same surfaces. Refers to its arguments; the path may grow at its end.
class StreamFeed final : public render::Simulation {
 public:
  StreamFeed(const StreamFrames& stream, stream::DepthReceiver& receiver, const trace::ProbePath& path,
             const StreamDelay& delay);

  /// Forgets every frame.
  void reset() noexcept override;
  /// Gives what is due; the receiver gets the last HIP before.
  void advance(double t_s) noexcept override;
  [[nodiscard]] double next_s() const noexcept override;

  /// Those given since reset(), with the times of this pass.
  [[nodiscard]] std::vector<metrics::StreamDelivery> deliveries() const {
    return {schedule_.begin(), schedule_.begin() + static_cast<std::ptrdiff_t>(given_)};
  }
  [[nodiscard]] std::uint64_t skipped() const noexcept;

 private:
  bool extend() noexcept;

  const StreamFrames& stream_;
  stream::DepthReceiver& receiver_;
  const trace::ProbePath& path_;
  StreamDelay delay_;
  std::vector<metrics::StreamDelivery> schedule_;  // a measured one grows in the first pass
  std::size_t given_ = 0, sample_ = 0;
  double free_s_ = 0.0;  // when the receiver was ready for another frame
};

}  // namespace palpate::experiments
