// The second reference: what a surface says of a HIP that came from nowhere. It holds no state, so whatever
// it answers otherwise than the god object that came along the path depends on the way that was taken.
#pragma once

#include <cstddef>
#include <string>

#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// Two references agree where their god objects differ by no more than this share of the depth: the force
/// then differs by a thousandth, a seventieth of what a hand tells apart (7 %).
inline constexpr double kSameShare = 1e-3;

/// The closest point of the whole surface, frame by frame: contact where the HIP is inside, force = stiffness
/// x (closest point - HIP), limited (0 = none). local_resolution_mm stays 0. A path that starts inside, or
/// has no samples, is an Error. Two questions to the surface a frame; never timed.
[[nodiscard]] Result<trace::ReferenceTrace> closest_reference(const TruthSurface& truth,
                                                              const trace::ProbePath& path,
                                                              double stiffness_n_per_mm, double force_limit_n,
                                                              Progress& progress);

struct HistoryTally {
  std::size_t contact = 0;     ///< frames that either calls contact
  std::size_t state = 0;       ///< one says contact, the other free: a thin part was crossed, or a sheet held
  std::size_t place = 0;       ///< both say contact, elsewhere
  double share_percent = 0.0;  ///< of both, of `contact`; 0 without contact
};

/// Sets history_decides in every frame in which the two answer otherwise: another contact state (deeper than
/// rounding), or god objects farther apart than kSameShare of the depth and what a closest point is known to
/// (the root of rounding: distances are flat at their least). Sets `compared` and adds to `exactness`.
/// Lengths that differ are an Error. O(frames).
[[nodiscard]] Result<HistoryTally> compare_references(trace::ReferenceTrace& reference,
                                                      const trace::ReferenceTrace& second,
                                                      const trace::ProbePath& path);

}  // namespace palpate::metrics
