// Replays a probe path through a prepared renderer: first untimed for the trace, then timed. How frames are
// timed is part of what the numbers mean:
//
//   mean_us          first kind of pass: the clock is read at the ends of each stretch of contact frames and
//                    of free ones, so that it costs one pair a stretch, not a pair a frame;
//   min .. max,      second kind: a clock pair around every frame, the clock's own cost included and stated
//   mean_clocked_us  (clock_overhead_ns); percentiles by nearest rank. This mean may stand beside them, the
//                    other one may not: it lacks the clock's cost and is of other moments. Only the longest
//                    frame is that of both kinds: a run of n frames that took T had one of T / n or more;
//   paced            apart: sleeps to each tick before the frame, so caches and clock rates are those of a
//                    real servo loop; on request after walking through memory that evicts the caches.
//
// measure() makes one pass of each kind, in this process; passes.h makes many.
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

#include "toolkit/core/bootstrap.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/render/motion.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

/// A frame that takes longer than this misses the deadline of the classic 1 kHz haptic loop, and of the 5 and
/// 10 kHz that hard surfaces ask for (Choi and Tan 2004).
inline constexpr std::int64_t kDeadline1KhzNs = 1'000'000, kDeadline5KhzNs = 200'000,
                              kDeadline10KhzNs = 100'000;

/// Times of one set of frames. With no frame in the set every time is nothing.
struct FrameStatistics {
  std::uint64_t frames = 0;          ///< frames of the path (or of the paced stretch)
  std::uint64_t contact_frames = 0;  ///< of these, in contact as the renderer has it
  std::uint64_t timed_frames = 0;    ///< the frames the times below are about: those of the set
  std::optional<double> min_us, mean_us, mean_clocked_us, p50_us, p99_us, p999_us, max_us;
  std::uint64_t deadline_misses_1khz = 0;                             ///< timed frames longer than 1 ms
  std::uint64_t deadline_misses_5khz = 0, deadline_misses_10khz = 0;  ///< longer than 200 and 100 us
  std::uint64_t bound_hits = 0;    ///< timed frames with FrameStatus::kBoundHit
  double clock_overhead_ns = 0.0;  ///< median distance of two clock reads in a row, contained in min .. max
  // Of many passes; see passes.h. One pass has no worst reading apart from its longest frame.
  std::optional<Interval> mean_interval_us, p50_interval_us, p999_interval_us;
  std::optional<double> cpu_mean_us;             ///< as mean_us, by the thread's own clock
  std::optional<double> worst_us;                ///< the longest single reading of all passes
  std::uint64_t passes = 0, clocked_passes = 0;  ///< of the first and of the second kind
  std::uint64_t episodes = 0;                    ///< stretches that the frames stand in
};

/// Times of a paced stretch, over its contact frames.
struct PacedStatistics {
  FrameStatistics frame;  ///< mean_us with the clock's cost: each frame stands alone
  double period_ms = 1.0;
  std::uint64_t first_frame = 0;    ///< where in the path the stretch starts
  std::uint64_t evicted_bytes = 0;  ///< walked through before each frame; 0 = none
  std::uint64_t skipped_ticks = 0;  ///< ticks that passed while something (eviction, the machine) took longer
};

/// One clock pair around several frames.
struct RunTime {
  std::int64_t ns = 0;
  std::uint64_t frames = 0;
};
/// From the times of the frames, one by one (pass B), and of the runs that they stand in (pass A; without
/// runs both means are that of the frames). min <= mean_clocked <= max, percentiles in order, and mean <=
/// max, whatever the clock read. Counts other than timed_frames and the misses are the caller's.
[[nodiscard]] FrameStatistics frame_statistics(std::vector<std::int64_t> frame_ns,
                                               std::span<const RunTime> runs, double clock_overhead_ns);

struct ReplayOptions {
  bool timed = true;               ///< false: the untimed pass alone
  std::uint64_t paced_frames = 0;  ///< 0 = no paced pass
  std::uint64_t paced_evicted_frames =
      0;                         ///< of the pass with eviction, which needs some 10 ms a frame; 0 = none
  Progress* progress = nullptr;  ///< may be null
  render::Simulation* simulation = nullptr;  ///< moves the scene's models, or null
};

struct ReplayReport {
  ForceTrace trace;  ///< frame_ns from pass B
  std::string trace_hash;
  render::FrameCounters counters;          ///< of the untimed pass
  std::optional<FrameStatistics> contact;  ///< frames that the renderer itself calls contact
  std::optional<FrameStatistics> free;     ///< the others
  std::optional<FrameStatistics> all;
  std::optional<PacedStatistics> paced;
  std::optional<PacedStatistics> paced_evicted;
};

/// No samples, or times that do not increase, are an Error (file = the path's name, line = that of the sample
/// in a CSV file with a header).
[[nodiscard]] Status check_path(const ProbePath& path);

/// One untimed pass: restarted at the first sample, one step before its time (as long as the second one, 1 ms
/// for a single sample), then a step at every sample. `simulation` moves the scene's models, or null; it is
/// advanced before each frame, by the replay and outside of what is timed. A path without samples or with
/// times that do not increase is an Error (file = the path's name, line = that of the sample in a CSV file
/// with a header); the command answers it with exit status 2. Contact at the first sample goes into the trace
/// like any other: whether a path starts inside a model only the true surface knows (check_path_starts_free),
/// never a renderer, some of which feel a surface from afar.
[[nodiscard]] Result<ForceTrace> replay(render::HapticRenderer& renderer, const ProbePath& path,
                                        render::Simulation* simulation = nullptr);

/// The untimed pass, then one of each kind and what else `options` ask for. Memory: the trace and 8 bytes a
/// frame, 64 MB more with eviction.
[[nodiscard]] Result<ReplayReport> measure(render::HapticRenderer& renderer, const ProbePath& path,
                                           const ReplayOptions& options);

/// Median of the distances of consecutive clock reads, ns.
[[nodiscard]] double measure_clock_overhead_ns();

/// Start of the stretch of `frames` consecutive frames with the most contact frames (`contact` is not 0); the
/// first of several. A shorter path: 0.
[[nodiscard]] std::size_t densest_contact_stretch(std::span<const std::uint8_t> contact, std::size_t frames);

}  // namespace palpate::trace
