// Replays a probe path through a prepared renderer: first untimed for the trace, then timed. Kinds of timed
// passes:
//
//   mean_us          pass A: reads the clock at the ends of each stretch of contact or free frames, so it
//                    costs one pair a stretch;
//   min .. max,      pass B: a clock pair around every frame, the clock's cost included and stated
//   mean_clocked_us  (clock_overhead_ns); percentiles by nearest rank. Compare only this mean with them.
//                    The longest frame uses both: a run of n frames in time T has one of at least T / n;
//   paced            a separate pass: sleeps to each tick, so caches and clock rates are those of a real
//                    servo loop; optionally evicts the caches before each frame.
//
// measure() makes one pass of each kind in this process; timed_passes.h makes many.
//
// The clock is std::chrono::steady_clock. Reading the time stamp counter (rdtscp) saves only a quarter of a
// read (50 against 67 ns in a loop) and needs a known frequency and a fixed core.
//
// Every pass must give the untimed pass's answers, bit for bit; else measure() returns an Error and no times.
//
// First:
//   auto replayed = palpate::trace::measure(*renderer, path, {});
//   if (!replayed) return failed(replayed.error());
//   std::printf("%s, mean %g us\n", replayed->trace_hash.c_str(), replayed->contact->mean_us.value_or(0.0));
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/motion.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::trace {

/// Deadlines of the classic 1 kHz haptic loop and of the 5 and 10 kHz that hard surfaces need (Choi and Tan
/// 2004).
inline constexpr std::int64_t kDeadline1KhzNs = 1'000'000, kDeadline5KhzNs = 200'000,
                              kDeadline10KhzNs = 100'000;

/// Times of one set of frames; all empty for an empty set.
struct FrameStatistics {
  std::uint64_t frames = 0;          ///< frames of the path (or of the paced stretch)
  std::uint64_t contact_frames = 0;  ///< of these, in contact according to the renderer
  std::uint64_t timed_frames = 0;    ///< frames that the times below cover: those of the set
  std::optional<double> min_us, mean_us, mean_clocked_us, p50_us, p99_us, p999_us, max_us;
  std::uint64_t deadline_misses_1khz = 0;                             ///< timed frames longer than 1 ms
  std::uint64_t deadline_misses_5khz = 0, deadline_misses_10khz = 0;  ///< longer than 200 and 100 us
  std::uint64_t bound_hits = 0;    ///< timed frames with FrameStatus::kBoundHit
  double clock_overhead_ns = 0.0;  ///< median time between two consecutive clock reads, included in min ..
                                   ///< max
  // Only with many passes (timed_passes.h). With one pass only the longest frame is known.
  std::optional<Interval> mean_interval_us, p50_interval_us, p999_interval_us;
  std::optional<double> cpu_mean_us;             ///< as mean_us, by the thread's CPU clock
  std::optional<double> worst_us;                ///< longest single reading of all passes
  std::uint64_t passes = 0, clocked_passes = 0;  ///< of kind A and of kind B
  std::uint64_t episodes = 0;                    ///< contiguous stretches of the frames
};

/// Times of a paced stretch, over its contact frames.
struct PacedStatistics {
  FrameStatistics frame;  ///< mean_us includes the clock's cost: each frame is timed alone
  double period_ms = 1.0;
  std::uint64_t first_frame = 0;    ///< start of the stretch in the path
  std::uint64_t evicted_bytes = 0;  ///< memory walked through before each frame; 0 = none
  std::uint64_t skipped_ticks = 0;  ///< ticks missed because eviction or the machine took longer
};

/// One clock pair around several frames.
struct RunTime {
  std::int64_t ns = 0;
  std::uint64_t frames = 0;
};
/// Statistics from the times of single frames (pass B) and of runs (pass A; without runs both means are that
/// of the frames). Guarantees min <= mean_clocked <= max, mean <= max and ordered percentiles, whatever the
/// clock read. The caller sets the counts other than timed_frames and the misses.
[[nodiscard]] FrameStatistics frame_statistics(std::vector<std::int64_t> frame_ns,
                                               std::span<const RunTime> runs, double clock_overhead_ns);

struct ReplayOptions {
  bool timed = true;                         ///< false: the untimed pass alone
  std::uint64_t paced_frames = 0;            ///< 0 = no paced pass
  std::uint64_t paced_evicted_frames = 0;    ///< frames of the pass with eviction, some 10 ms each; 0 = none
  Progress* progress = nullptr;              ///< may be null
  render::Simulation* simulation = nullptr;  ///< moves the scene's models, or null
};

struct ReplayReport {
  ForceTrace trace;  ///< frame_ns from pass B
  std::string trace_hash;
  render::FrameCounters counters;          ///< of the untimed pass
  std::optional<FrameStatistics> contact;  ///< frames that the renderer reports in contact
  std::optional<FrameStatistics> free;     ///< the other frames
  std::optional<FrameStatistics> all;
  std::optional<PacedStatistics> paced;
  std::optional<PacedStatistics> paced_evicted;
};

/// An Error for no samples or times that do not increase (file = the path's name, line = the sample's in a
/// CSV file with a header).
[[nodiscard]] Status check_path(const PathView& path);

/// One untimed pass: restarts one step before the first sample's time (the step of the second sample, or 1
/// ms), then steps at every sample. `simulation` may be null; it advances before each frame, outside the
/// timing. Errors as of check_path(). Contact at the first sample is not an Error: only the true surface
/// knows whether a path starts inside (check_path_starts_free), and some renderers feel a surface from afar.
[[nodiscard]] Result<ForceTrace> replay(render::HapticRenderer& renderer, const PathView& path,
                                        render::Simulation* simulation = nullptr);

/// The untimed pass, one timed pass of each kind, and the passes that `options` add. Memory: the trace and 8
/// bytes a frame, 64 MB more with eviction.
[[nodiscard]] Result<ReplayReport> measure(render::HapticRenderer& renderer, const ProbePath& path,
                                           const ReplayOptions& options);

/// Median time between consecutive clock reads, ns.
[[nodiscard]] double measure_clock_overhead_ns();

/// Start of the stretch of `frames` consecutive frames with the most contact frames (`contact` != 0); the
/// first in a tie; 0 for a shorter path.
[[nodiscard]] std::size_t densest_contact_stretch(std::span<const std::uint8_t> contact, std::size_t frames);

}  // namespace palpate::trace
