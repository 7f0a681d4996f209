// Closest points along a path. The second reference, without history: the closest surface point to the HIP;
// where it differs from the god object, the truth depends on the way taken. The smallest distance to models'
// points is here too.
#pragma once

#include <cstddef>
#include <limits>
#include <span>
#include <string>

#include <palpate/accuracy.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/vec.h>

namespace palpate::metrics {

/// God objects within this share of the depth agree: the force differs by a thousandth, a seventieth of what
/// a hand tells apart (7 %).
inline constexpr double kAgreementShare = 1e-3;

/// Frame by frame: contact inside, force = stiffness x (closest point - HIP), limited (0 = none).
/// local_resolution_mm stays 0. A path that starts inside or has no samples is an Error. Two surface queries
/// a frame; never timed.
[[nodiscard]] Result<trace::ReferenceTrace> closest_point_reference(const TruthSurface& truth,
                                                                    const trace::ProbePath& path,
                                                                    double stiffness_n_per_mm,
                                                                    double force_limit_n, Progress& progress);

struct HistoryCounts {
  std::size_t contact = 0;     ///< frames that either calls contact
  std::size_t state = 0;       ///< contact against free: a thin part was crossed, or a sheet held
  std::size_t place = 0;       ///< both in contact, elsewhere
  double share_percent = 0.0;  ///< state and place over `contact`; 0 without contact
};

/// Sets history_decides where the two differ: in contact state (deeper than rounding), or god objects farther
/// apart than kAgreementShare of the depth plus the closest point's uncertainty (root of rounding: distances
/// are flat at their minimum). Sets `compared` and extends `exactness`. Differing lengths are an Error.
/// O(frames).
[[nodiscard]] Result<HistoryCounts> compare_references(trace::ReferenceTrace& reference,
                                                       const trace::ReferenceTrace& second,
                                                       const trace::ProbePath& path);

struct ClosestApproach {
  double distance_mm = std::numeric_limits<double>::infinity();  ///< to the nearest point
  std::size_t sample = 0;                                        ///< of the path
  std::size_t model = 0;
};

/// Over all samples and points, models at their start poses. Exact. O(points log points), then little for a
/// path that passes by, O(samples log points) among the points.
[[nodiscard]] ClosestApproach closest_approach(const trace::ProbePath& path,
                                               std::span<const render::ModelInput> models);

}  // namespace palpate::metrics
