// Statistics of a stream of depth images: rate, holes, depths, and noise against depth.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/progress.h>
#include <palpate/result.h>

namespace palpate::stream {

/// Standard deviations of depths around one depth, in mm; 0: too few were seen.
struct NoiseAtDepth {
  double depth_mm = 0.0;     ///< mean of the bin
  double temporal_mm = 0.0;  ///< from frame to frame, where nothing moved
  double spatial_mm = 0.0;   ///< off the plane through the 5 x 5 pixels around
  std::uint64_t samples = 0;
};

struct StreamStatistics {
  std::uint64_t frames = 0;         ///< that were read
  std::uint64_t frames_in_all = 0;  ///< as the source says; 0: unknown
  std::uint64_t unreadable = 0;     ///< passed over
  std::uint64_t lost = 0;           ///< missing in the numbers
  std::uint64_t out_of_order = 0;   ///< not later than the one before
  std::uint64_t other_size = 0;     ///< fewer or more depths than pixels
  double rate_hz = 0.0;             ///< by the times of capture; 0: one frame
  double rate_jitter_s = 0.0;       ///< standard deviation of the time between two
  double latency_s = 0.0;           ///< mean, capture to arrival
  double latency_jitter_s = 0.0;    ///< standard deviation
  double holes = 0.0;               ///< share of the pixels without a depth
  double most_holes = 0.0;          ///< the same of the worst frame
  double nearest_mm = 0.0;          ///< over all frames
  double farthest_mm = 0.0;
  bool moves = false;               ///< the camera, so that only spatial noise is known
  std::vector<NoiseAtDepth> noise;  ///< by rising depth
  /// Least squares through `noise`, the temporal one where it is known: noise_mm + noise_per_mm z^2.
  double noise_mm = 0.0;
  double noise_per_mm = 0.0;
};

/// Ten seconds at 30 Hz: the mean of a bin's noise is then known to a hundredth.
inline constexpr std::uint64_t kStatisticsFrames = 300;

/// Reads up to `most_frames` from where the source stands.
/// @error no frame could be read, or the progress was stopped.
[[nodiscard]] Result<StreamStatistics> measure_stream(DepthSource& source,
                                                      std::uint64_t most_frames = kStatisticsFrames,
                                                      Progress& progress = no_progress());

}  // namespace palpate::stream
