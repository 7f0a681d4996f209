// Scores of a replay in which depth images replace the surface: what a hand feels of a swap, and how late.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/trace.h>

namespace palpate::metrics {

/// One image given to a renderer, and what came of it.
struct StreamDelivery {
  std::size_t frame = 0;  ///< of the stream
  double captured_s = 0.0;
  double due_s = 0.0;  ///< from here on ticks feel it
  stream::ReceiveReport report;
};

/// Half a minute at 30 Hz.
inline constexpr std::size_t kMostSwapTimes = 1000;

/// Empty where nothing was taken, or no swap met contact.
struct StreamScores {
  std::uint64_t frames = 0;  ///< given: taken, repeated, late, truncated and failed ones
  std::uint64_t taken = 0, repeated = 0, late = 0, truncated = 0, failed = 0;
  std::uint64_t skipped = 0;  ///< not given: newer ones had come while the receiver was busy
  std::uint64_t swaps = 0, stalled_frames = 0;  ///< render::FrameCounters
  /// Time of receive(), by the machine's clock.
  std::optional<double> window_p50_ms, window_p99_ms, whole_p50_ms, whole_p99_ms;
  /// From an image's light to the first tick that feels it.
  std::optional<double> light_to_tick_p50_ms, light_to_tick_p99_ms;
  std::uint64_t swaps_in_contact = 0;
  std::uint64_t releases = 0;  ///< times that contact ended
  /// Excess of the force's change over stiffness times the HIP's way: in the tick of a swap, and per
  /// millisecond in every tick with contact in it or in the one before, so that contact that is lost counts.
  std::optional<double> swap_step_max_n, swap_step_p99_n, rate_max_n_per_ms;
  std::vector<double> swaps_s{};  ///< ticks of the first kMostSwapTimes new surfaces, for pictures
};

/// `deliveries` rise in time; those due after the path are left out. The caller adds what only it knows:
/// skipped, swaps, stalled_frames. O(n log n).
[[nodiscard]] StreamScores score_stream(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                        std::span<const StreamDelivery> deliveries,
                                        double stiffness_n_per_mm);

}  // namespace palpate::metrics
