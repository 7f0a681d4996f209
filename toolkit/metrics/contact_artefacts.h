// Moments of contact that feel plainly wrong; defined in docs/reference/scores.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/accuracy.h>

namespace palpate::metrics {

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

}  // namespace palpate::metrics
