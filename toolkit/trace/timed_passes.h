// Timed passes of a renderer along a path, with statistics. replay.h defines the kinds.
//
// The caller chooses the contact frames, so that all renderers are timed over the same frames.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include <palpate/clock.h>
#include <palpate/replay.h>
#include <palpate/result.h>

namespace palpate::trace {

/// Consecutive frames of one kind, [begin, end); pass A reads the clock at their ends.
struct FrameSpan {
  std::size_t begin = 0, end = 0;
  bool contact = false;
};
/// The path divided into stretches, in order. `contact`: a byte per frame, 0 or not.
[[nodiscard]] std::vector<FrameSpan> frame_spans_of(std::span<const std::uint8_t> contact);
/// The frames that a trace reports in contact.
[[nodiscard]] std::vector<std::uint8_t> contact_of(std::span<const render::Frame> frames);

struct FrameSpanTime {
  std::int64_t wall_ns = 0;
  std::int64_t cpu_ns = 0;  ///< thread time: less than wall time if something else ran
  PageFaults page_faults;   ///< 0 where all that a frame reads is in memory
};

/// Measurements of one renderer's passes.
struct PassTimes {
  std::vector<FrameSpan> stretches;
  std::vector<std::vector<FrameSpanTime>> by_span;   ///< one list per pass, one entry per stretch
  std::vector<std::vector<std::uint32_t>> by_frame;  ///< one list per pass, ns per frame, clock included
  double clock_overhead_ns = 0.0;
};

/// Times a renderer along a path repeatedly. Every pass must give the answers of `frames`, the untimed pass,
/// bit for bit; else an Error and no times. Keeps references.
class TimedPasses {
 public:
  TimedPasses(render::HapticRenderer& renderer, const ProbePath& path, render::Simulation* simulation,
              std::span<const render::Frame> frames);

  /// Runs untimed for at most `most_s`, to restore caches, branch predictors and clock rate after another
  /// renderer.
  void warm_up(double most_s) noexcept;
  /// One pass A. `times` is as long as `stretches`.
  [[nodiscard]] Status time_spans(std::span<const FrameSpan> stretches, std::span<FrameSpanTime> times);
  /// One pass B. As long as the path; a frame over 4 s counts as 4.29 s.
  [[nodiscard]] Status time_frames(std::span<std::uint32_t> frame_ns);
  /// See ReplayOptions. `contact`: the timed frames.
  [[nodiscard]] Result<PacedStatistics> paced(std::size_t frames, bool evict,
                                              std::span<const std::uint8_t> contact, Progress* progress);

 private:
  render::HapticRenderer& renderer_;
  const ProbePath& path_;
  render::Simulation* simulation_;
  std::span<const render::Frame> frames_;
  std::uint64_t expected_;
};

/// Statistics of contact, free and all frames. Means: per pass, then the median of passes. Percentiles and
/// extremes: over each frame's median of passes, so single disturbances of the machine drop out; the longest
/// reading is kept apart. Intervals: 95 %, bootstrap over episodes (a contact stretch, a free one, or both
/// for all frames) and passes.
struct PassStatistics {
  FrameStatistics contact, free, all;
  std::vector<std::int64_t> frame_ns;  ///< each frame's median over the passes
};
/// `frames`: the answers, for counts of the renderer's contact and bound. At least one pass of each kind.
[[nodiscard]] PassStatistics pass_statistics(const PassTimes& times, std::span<const render::Frame> frames);

}  // namespace palpate::trace
