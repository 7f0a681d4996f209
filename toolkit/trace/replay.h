// Replays a probe path through a prepared renderer: first untimed for the trace, then timed. How frames are
// timed is part of what the numbers mean:
//
//   mean_us      pass A: one clock pair around each uninterrupted run of contact frames (for all frames: one
//   pair around
//                the whole path), so that the clock costs one pair a run, not a pair a frame;
//   min .. max   pass B: a clock pair around every frame, the clock's own cost included and stated
//                (clock_overhead_ns); percentiles by nearest rank;
//   paced        apart: sleeps to each tick before the frame, so caches and clock rates are those of a real
//   servo loop;
//                on request after walking through memory that evicts the caches.
//
// The clock is std::chrono::steady_clock (clock_gettime): reading the time stamp counter with rdtscp saved
// only a quarter of a read (50 against 67 ns in one loop), and would need a frequency and a core that stay.
//
// Every pass must answer what the untimed pass answered, bit for bit; else there is an Error and no number.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

/// A frame that takes longer than this misses the deadline of the classic 1 kHz haptic loop.
inline constexpr std::int64_t kDeadline1KhzNs = 1'000'000;

/// Where the p-th percentile by nearest rank stands among n sorted samples, counted from 0: rank ceil(p / 100
/// * n) counted from 1; p = 0 is the smallest. Always one of the samples, nothing is interpolated. n > 0, 0
/// <= percent <= 100.
[[nodiscard]] std::size_t nearest_rank_index(std::size_t n, double percent) noexcept;

/// The sample there. `sorted` must not be empty.
[[nodiscard]] std::int64_t percentile_nearest_rank(std::span<const std::int64_t> sorted,
                                                   double percent) noexcept;

/// Times of one set of frames. With no frame in the set every time is nothing.
struct FrameStatistics {
  std::uint64_t frames = 0;          ///< frames of the path (or of the paced stretch)
  std::uint64_t contact_frames = 0;  ///< of these, in contact
  std::uint64_t timed_frames = 0;    ///< the frames the times below are about: contact_frames or frames
  std::optional<double> min_us, mean_us, p50_us, p99_us, p999_us, max_us;
  std::uint64_t deadline_misses_1khz = 0;  ///< timed frames longer than 1 ms
  std::uint64_t bound_hits = 0;            ///< timed frames with FrameStatus::kBoundHit
  double clock_overhead_ns = 0.0;  ///< median distance of two clock reads in a row, contained in min .. max
};

/// Times of a paced stretch, over its contact frames.
struct PacedStatistics {
  FrameStatistics frame;  ///< mean_us with the clock's cost: each frame stands alone
  double period_ms = 1.0;
  std::uint64_t first_frame = 0;    ///< where in the path the stretch starts
  std::uint64_t evicted_bytes = 0;  ///< walked through before each frame; 0 = none
  std::uint64_t skipped_ticks = 0;  ///< ticks that passed while something (eviction, the machine) took longer
};

struct ReplayOptions {
  bool timed = true;               ///< false: the untimed pass alone
  std::uint64_t paced_frames = 0;  ///< 0 = no paced pass
  std::uint64_t paced_evicted_frames =
      0;                         ///< of the pass with eviction, which needs some 10 ms a frame; 0 = none
  Progress* progress = nullptr;  ///< may be null
  /// The path is known to start in free space: a renderer in contact there is wrong, and measured like any
  /// other.
  bool start_is_free = false;
};

struct ReplayReport {
  ForceTrace trace;  ///< frame_ns from pass B
  std::string trace_hash;
  render::FrameCounters counters;          ///< of the untimed pass
  std::optional<FrameStatistics> contact;  ///< `frame` of the results
  std::optional<FrameStatistics> all;      ///< `frame_all`
  std::optional<PacedStatistics> paced;
  std::optional<PacedStatistics> paced_evicted;
};

/// One untimed pass: reset at the first sample, then a step at every sample. The first frame's dt is that of
/// the second (1 ms for a single sample). A path without samples, with times that do not increase or that
/// starts inside the model is an Error (file = the path's name, line = that of the sample in a CSV file with
/// a header); the command answers it with exit status 2. With `start_is_free` contact at the first sample is
/// the renderer's fault and goes into the trace.
[[nodiscard]] Result<ForceTrace> replay(render::HapticRenderer& renderer, const ProbePath& path,
                                        bool start_is_free = false);

/// The untimed pass, then what `options` ask for. Memory: the trace and 8 bytes a frame, 64 MB more with
/// eviction.
[[nodiscard]] Result<ReplayReport> measure(render::HapticRenderer& renderer, const ProbePath& path,
                                           const ReplayOptions& options);

/// Median of the distances of consecutive clock reads, ns.
[[nodiscard]] double measure_clock_overhead_ns();

/// Start of the stretch of `frames` consecutive frames with the most contact frames; the first of several. A
/// shorter trace: 0.
[[nodiscard]] std::size_t densest_contact_stretch(const ForceTrace& trace, std::size_t frames);

}  // namespace palpate::trace
