// Timed passes of a renderer along a path, with statistics. replay.h defines the kinds.
//
// The caller chooses the contact frames, so that all renderers are timed over the same frames.
#pragma once

#include <bit>
#include <cstdint>
#include <ctime>
#include <span>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/motion.h>
#include <palpate/renderer.h>
#include <palpate/replay.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/core/hash.h"

namespace palpate::trace {

// Runs a renderer along a path, and hashes its answers. Digests of every frame serve comparison.

inline constexpr std::int64_t kNsPerS = 1'000'000'000;

/// Processor time of the calling thread: what else runs is not in it.
[[nodiscard]] inline std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * kNsPerS + now.tv_nsec;
}

/// A renderer along a path and its simulation; the models advance first.
class PathRun {
 public:
  PathRun(render::HapticRenderer& renderer, const PathView& path, render::Simulation* simulation)
      : renderer_(renderer), path_(path), simulation_(simulation) {}

  /// Back to one step before the first sample's time.
  void restart() noexcept {
    const double step_s = path_.size() > 1 ? path_.t_s[1] - path_.t_s[0] : kNominalDtS;
    const double start_s = path_.t_s[0] - step_s;
    if (simulation_ != nullptr) {
      simulation_->reset();
      simulation_->advance(start_s);
    }
    renderer_.restart(path_.hip_mm[0], start_s);
  }
  /// Moves the models to sample i. Before each frame, untimed.
  void advance(std::size_t i) noexcept {
    if (simulation_ != nullptr) simulation_->advance(path_.t_s[i]);
  }
  render::Frame step(std::size_t i) noexcept { return renderer_.step(path_.hip_mm[i], path_.t_s[i]); }
  /// The first sample after `i` before which something moves, else the path's end.
  [[nodiscard]] std::size_t static_until(std::size_t i) const noexcept {
    if (simulation_ == nullptr) return path_.size();
    const double next_s = simulation_->next_s();
    std::size_t end = i + 1;
    while (end < path_.size() && path_.t_s[end] < next_s) ++end;
    return end;
  }
  [[nodiscard]] std::size_t size() const noexcept { return path_.size(); }

 private:
  static constexpr double kNominalDtS = 1e-3;  // dt of a path with one sample
  render::HapticRenderer& renderer_;
  PathView path_;
  render::Simulation* simulation_;
};

/// A cheap order-dependent sum of the bits that trace_hash covers. Timed passes use it to prove equal
/// answers, at about 2 ns a frame and without writing a second trace through the caches.
class FrameDigest {
 public:
  void add(const render::Frame& frame) noexcept {
    // Odd constants from fractional square roots of primes (SHA-512's initial words, made odd).
    const std::uint64_t sum =
        bits(frame.force_n.x()) * 0x6A09E667F3BCC909u + bits(frame.force_n.y()) * 0xBB67AE8584CAA73Bu +
        bits(frame.force_n.z()) * 0x3C6EF372FE94F82Bu + bits(frame.god_object_mm.x()) * 0xA54FF53A5F1D36F1u +
        bits(frame.god_object_mm.y()) * 0x510E527FADE682D1u +
        bits(frame.god_object_mm.z()) * 0x9B05688C2B3E6C1Fu + (frame.contact ? 0x1F83D9ABFB41BD6Bu : 0u);
    state_ = std::rotl(state_, 1) + sum;
  }
  [[nodiscard]] std::uint64_t value() const noexcept { return state_; }

 private:
  static std::uint64_t bits(double v) noexcept { return std::bit_cast<std::uint64_t>(v); }
  std::uint64_t state_ = 0;
};

[[nodiscard]] inline std::uint64_t digest_of(std::span<const render::Frame> frames) noexcept {
  FrameDigest digest;
  for (const render::Frame& frame : frames) digest.add(frame);
  return digest.value();
}

/// FNV-1a-64 over contact, force and god object of every added frame; used by trace_hash().
class FrameHash {
 public:
  void add(const render::Frame& frame) noexcept {
    hash_.byte(frame.contact ? 1 : 0);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.force_n[axis]);
    for (int axis = 0; axis < 3; ++axis) hash_.real(frame.god_object_mm[axis]);
  }
  /// Sixteen hexadecimal digits.
  [[nodiscard]] std::string hex() const { return hash_.hex(); }

 private:
  Hash64 hash_;
};

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
