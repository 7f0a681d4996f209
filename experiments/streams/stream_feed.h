// A stream of depth images beside a probe path: kept in memory, and given to one renderer at the times at
// which a hand would have met it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/motion.h>
#include <palpate/options.h>
#include <palpate/renderer.h>
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

// A hand in front of a depth camera: presses, slides and lifts on whatever comes, and gives way to it.

inline constexpr const char* kPressAndSlide = "press-and-slide";

/// The view that the hand works in.
struct HandView {
  geometry::RigidTransform world_from_camera;
  double nearest_mm = 0.0, median_mm = 0.0, farthest_mm = 0.0;  ///< depths of the middle of the image
  double half_width_mm = 0.0, half_height_mm = 0.0;             ///< of the view at the median depth
};
/// Of the first image. An Error where its middle is empty.
[[nodiscard]] Result<HandView> view_of(const stream::DepthFrame& frame, const stream::DepthCamera& camera);

/// "press-and-slide[:frames=N:fastest=SHARE]", completed. Errors: unknown or invalid options.
[[nodiscard]] Result<NamedOptions> parse_press_and_slide(const std::string& text);

/// Appends HIP positions at 1 kHz to `path`, one after the other, as `felt` answers to each: the force at a
/// HIP and a time, which rises from 0. It begins in front of everything in the middle of the image.
/// The hand yields like a damper, v = (its force + the felt one) / b, and slides along a Lissajous curve over
/// the middle half of the view, at most `fastest` median depths a second (0.5 m/s at 1 m).
using FeltForce = std::function<Vec3(const Vec3& hip_mm, double t_s)>;
void press_and_slide(const HandView& view, double stiffness_n_per_mm, const NamedOptions& options,
                     const FeltForce& felt, trace::ProbePath& path);

}  // namespace palpate::experiments
