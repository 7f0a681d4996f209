// Parts of scores: inputs, wrong moments, swaps of streams, CSV.
//
// Inputs stand under short names. Moments are those of contact that feels plainly wrong, and pop-throughs of
// a god object (defined in docs/reference/scores.md). Stream scores are of a replay in which depth images
// replace the surface: how large the step of a swap is, and how late. Per-frame scores are written as CSV,
// with the surface's values needed to score again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/depth_stream.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "toolkit/core/files.h"
#include "toolkit/core/tolerances.h"

namespace palpate::metrics {

/// The tracker's stopping error is some tens of coordinate roundings; below this share of the coordinates it
/// is at rest.
inline constexpr double kConvergedPerSize = 256.0 * kUnitRoundoff;

inline constexpr double kToPercent = 100.0;
/// `whole` > 0.
[[nodiscard]] inline double percent_of(std::uint64_t part, std::uint64_t whole) noexcept {
  return kToPercent * static_cast<double>(part) / static_cast<double>(whole);
}

[[nodiscard]] inline bool felt(const Vec3& force_n) noexcept {
  return force_n != Vec3::Zero();
}

struct ScoreInput {
  const trace::ProbePath& path;
  const std::vector<render::Frame>& frames;
  const std::vector<trace::TruthFrame>& truth;
  const AccuracyOptions& options;

  [[nodiscard]] const Vec3& rendered(std::size_t i) const { return frames[i].force_n; }
  [[nodiscard]] const Vec3& wanted(std::size_t i) const { return truth[i].frame.force_n; }
  /// True if the frame's truth does not depend on history.
  [[nodiscard]] bool decided(std::size_t i) const { return !truth[i].history_decides; }
  [[nodiscard]] bool decided_step(std::size_t i) const { return decided(i) && decided(i - 1); }
  [[nodiscard]] bool in_true_contact(std::size_t i) const { return decided(i) && felt(wanted(i)); }
  [[nodiscard]] bool in_either_contact(std::size_t i) const {
    return decided(i) && (felt(rendered(i)) || felt(wanted(i)));
  }
  [[nodiscard]] double travel_mm(std::size_t i) const { return (path.hip_mm[i] - path.hip_mm[i - 1]).norm(); }
  /// True if the truth jumps into sample i.
  [[nodiscard]] bool true_edge(std::size_t i, double floor_n) const {
    return (wanted(i) - wanted(i - 1)).norm() > options.stiffness_n_per_mm * travel_mm(i) + floor_n;
  }
  [[nodiscard]] double jump_error_n(std::size_t i) const {
    return (rendered(i) - rendered(i - 1) - wanted(i) + wanted(i - 1)).norm();
  }
};

/// Each frame's episode: the stretch of G that it is in or follows; the first one before that. One episode if
/// G is empty.
struct Episodes {
  std::vector<std::uint32_t> of_frame;
  std::size_t count = 0;       ///< at least 1; for the bounds
  std::size_t in_contact = 0;  ///< stretches of G
};
[[nodiscard]] Episodes episodes_of(const std::vector<trace::TruthFrame>& truth);

/// Checks equal lengths and finite numbers; Errors name the path.
[[nodiscard]] Status check_lengths(const trace::ProbePath& path, std::size_t frames, std::string_view what);
[[nodiscard]] Status check_finite(const trace::ProbePath& path, const std::vector<render::Frame>& frames,
                                  std::string_view what);

/// Friction per frame (see TruthSamples) and its scores.
[[nodiscard]] std::vector<double> friction_ratios(const trace::ForceTrace& trace, const TruthSurface& truth);
void score_friction(const ScoreInput& in, const TruthSamples& answers, Accuracy& a);

/// Caught, lost, kicks and the largest force (see Accuracy).
void score_artefacts(const ScoreInput& in, Accuracy& a);

/// Lag, ripple, relief and the headline (see Accuracy).
void score_perception(const ScoreInput& in, const Episodes& episodes, Accuracy& a);

/// A row per frame: `t_s,missed,false`; with forces compared
/// `force_error_n,excess_jump_n,god_object_error_mm`; with a true surface `god_object_distance_mm`, with
/// friction `friction_ratio`, with local resolutions `pop_throughs`. Fewest digits that read back to the same
/// bits. Differing lengths are an Error.
[[nodiscard]] Status write_scores_csv(const trace::ProbePath& path, const AccuracyFrames& frames,
                                      const std::string& file);

/// Reads write_scores_csv's output for this path; rows and times must agree.
[[nodiscard]] Result<AccuracyFrames> read_scores_csv(const trace::ProbePath& path, const std::string& file,
                                                     std::uint64_t max_bytes = kMemoryLimitBytes);

/// Stretches of frames of one kind.
struct Moments {
  std::uint64_t episodes = 0, frames = 0;
  std::size_t longest_at = 0;  ///< start of the longest
};
struct ContactArtefacts {
  Moments caught, lost;
  std::uint64_t kicks = 0;
  /// Largest excess of a force step over all true steps within kMinArtefactS, N, and its frame.
  double kick_max_n = 0.0;
  std::size_t kick_max_at = 0;
};
/// Lost: deeper than this by the truth, without force for kMinArtefactS.
inline constexpr double kLostMm = kContactToleranceMm;

/// Over all frames, including those that depend on history. Lengths must agree, and `truth` needs local
/// resolutions.
[[nodiscard]] ContactArtefacts find_artefacts(const trace::ProbePath& path,
                                              const std::vector<render::Frame>& frames,
                                              const std::vector<trace::TruthFrame>& truth,
                                              double lost_mm = kLostMm);

/// Events per frame (at most two); consecutive frames of one state count once. Lengths must agree. At most
/// 130 distance queries a frame. Sheets thinner than two local resolutions are only caught by the facing-away
/// rule.
[[nodiscard]] std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path,
                                                          const trace::ForceTrace& trace,
                                                          const trace::ReferenceTrace& reference,
                                                          const TruthSurface& truth);

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
