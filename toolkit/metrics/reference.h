// The truth along a path: the constrained god object of a surface known by formula, tracked until it no
// longer moves.
#pragma once

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/neighbourhood/neighbour_table.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// The tracker's own stopping error is some tens of roundings of the coordinates; below this share of them it
/// stands still, and nobody's god object is known better.
inline constexpr double kStillPerSize = 256.0 * kUnitRoundoff;

struct ReferenceOptions {
  int sub_steps = 8;  ///< the HIP's way of one frame is walked in so many pieces
  bool check_halving =
      true;  ///< track again with twice as many pieces and state how far the god object differs
};

/// Follows the god object along `path`: free until a piece of the way enters the surface, then the local
/// minimum of the distance reached along the surface (it never changes sheets), until the HIP is back outside
/// it. Force = stiffness x (god object - HIP), limited to force_limit_n (0 = none). A path that starts inside
/// is an Error with its line. local_resolution_mm stays 0: see fill_local_resolution. `exactness` says what
/// was checked, with numbers. Slow and never timed: O(frames x sub_steps) closest-point searches.
[[nodiscard]] Result<trace::ReferenceTrace> analytic_reference(
    const geometry::AnalyticSurface& surface, const trace::ProbePath& path, double stiffness_n_per_mm,
    double force_limit_n, const geometry::RigidTransform& world_from_model,
    const ReferenceOptions& options = {});

/// Sets local_resolution_mm of every frame: the distance from the cloud point nearest to the true god object
/// (when free: to the nearest surface point, h - d n) to the last of its neighbours in `neighbours` (its
/// eighth, where it has eight). Sizes that differ are an Error. O(points + frames) for clouds of bounded
/// density variation.
[[nodiscard]] Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud,
                                           const neighbourhood::NeighbourTable& neighbours,
                                           const geometry::RigidTransform& world_from_model);

}  // namespace palpate::metrics
