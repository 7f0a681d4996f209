// Timed passes of a prepared renderer along a path, and what many of them together say. How frames are timed
// is part of what the numbers mean; see replay.h for the two kinds of pass.
//
// The frames that are called contact frames are the caller's choice, so that every renderer is timed over one
// and the same frames, whatever it feels itself.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/trace/replay.h"

namespace palpate::trace {

/// Consecutive frames of one kind, [begin, end): a pass of the first kind reads the clock at their ends.
struct Stretch {
  std::size_t begin = 0, end = 0;
  bool contact = false;
};
/// The whole path in stretches, in order. `contact`: 0 or not, a byte a frame.
[[nodiscard]] std::vector<Stretch> stretches_of(std::span<const std::uint8_t> contact);
/// The frames that a trace itself calls contact.
[[nodiscard]] std::vector<std::uint8_t> contact_of(std::span<const render::Frame> frames);

struct StretchTime {
  std::int64_t wall_ns = 0;
  std::int64_t cpu_ns = 0;  ///< of the thread: less than the wall's where something else ran
};

/// What the passes of one renderer measured.
struct PassTimes {
  std::vector<Stretch> stretches;
  std::vector<std::vector<StretchTime>> by_stretch;  ///< one list a pass, one entry a stretch
  std::vector<std::vector<std::uint32_t>> by_frame;  ///< one list a pass, ns of every frame, clock included
  double clock_overhead_ns = 0.0;
};

/// A renderer along a path, timed as often as asked. Every pass must answer what `frames`, the untimed pass,
/// holds, bit for bit; else there is an Error and no number. Keeps references to all it is given.
class Passes {
 public:
  Passes(render::HapticRenderer& renderer, const ProbePath& path, render::Simulation* simulation,
         std::span<const render::Frame> frames);

  /// Runs along the path untimed for `most_s` at most: caches, branch predictors and clock rates are those of
  /// this renderer again after another one has run.
  void warm_up(double most_s) noexcept;
  /// One pass of the first kind. `times` is as long as `stretches`.
  [[nodiscard]] Status time_stretches(std::span<const Stretch> stretches, std::span<StretchTime> times);
  /// One pass of the second kind. As long as the path; a frame of more than 4 s counts as 4.29 s.
  [[nodiscard]] Status time_frames(std::span<std::uint32_t> frame_ns);
  /// See ReplayOptions. `contact`: the frames that are timed.
  [[nodiscard]] Result<PacedStatistics> paced(std::size_t frames, bool evict,
                                              std::span<const std::uint8_t> contact, Progress* progress);

 private:
  render::HapticRenderer& renderer_;
  const ProbePath& path_;
  render::Simulation* simulation_;
  std::span<const render::Frame> frames_;
  std::uint64_t expected_;
};

/// Contact, free and all frames. Means: of each pass over all its frames, the median of the passes;
/// percentiles and extremes: of every frame's median over the passes, so that what hits a frame once is the
/// machine's and what hits it always is the renderer's; the longest single reading is kept beside them.
/// Intervals: 95 %, bootstrap over episodes (a contact stretch, a free one, or both with each other for all
/// frames) and over passes.
struct PassStatistics {
  FrameStatistics contact, free, all;
  std::vector<std::int64_t> frame_ns;  ///< every frame's median over the passes
};
/// `frames`: the answers, for the counts of the renderer's own contact and of its bound. At least one pass of
/// each kind.
[[nodiscard]] PassStatistics pass_statistics(const PassTimes& times, std::span<const render::Frame> frames);

}  // namespace palpate::trace
