// Moments that a hand feels as plainly wrong: docs/scores.md says what counts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/metrics/accuracy.h"

namespace palpate::metrics {

/// Stretches of frames of one kind.
struct Moments {
  std::uint64_t episodes = 0, frames = 0;
  std::size_t longest_at = 0;  ///< the first frame of the longest
};
struct WrongMoments {
  Moments caught, lost;
  std::uint64_t kicks = 0;
  /// The largest step of force above every step of the truth within kMomentS, N; and its frame.
  double kick_max_n = 0.0;
  std::size_t kick_max_at = 0;
};
/// Lost: deeper than this by the truth, and no force for kMomentS.
inline constexpr double kLostMm = kTenthMm;

/// Over all frames, those in which history decides too. Lengths must agree, and `truth` must have its local
/// resolutions.
[[nodiscard]] WrongMoments wrong_moments(const trace::ProbePath& path,
                                         const std::vector<render::Frame>& frames,
                                         const std::vector<trace::TruthFrame>& truth,
                                         double lost_mm = kLostMm);

}  // namespace palpate::metrics
