// Moments of contact that feel plainly wrong, and pop-throughs of a god object; defined in
// docs/reference/scores.md and at Accuracy::pop_throughs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/reference.h>
#include <palpate/trace.h>

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

/// Events per frame (at most two); consecutive frames of one state count once. Lengths must agree. At most
/// 130 distance queries a frame. Sheets thinner than two local resolutions are only caught by the facing-away
/// rule.
[[nodiscard]] std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path,
                                                          const trace::ForceTrace& trace,
                                                          const trace::ReferenceTrace& reference,
                                                          const TruthSurface& truth);

}  // namespace palpate::metrics
