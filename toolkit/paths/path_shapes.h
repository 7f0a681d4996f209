// Timing, surface curves and strokes for path generators. Internal to paths.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/paths.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/core/random.h"
#include "toolkit/paths/visible_surface.h"

namespace palpate::paths {

/// Paths cover the middle 80 % of the surface's parameters.
inline constexpr double kParameterHalfSpan = 0.4;
/// Speed limit of the HIP relative to surface point plus offset: not reached on smooth surfaces; at an edge
/// it turns the normal's jump into a fast motion.
inline constexpr double kMaxHipSpeedRatio = 4.0;
/// Slides continue past the surface's end by this share of its parameters.
inline constexpr double kSlideOvershoot = 0.1;

/// One frame's motion of the HIP where it is no sinusoid.
struct FrameStep {
  double offset_mm = 0.0;  ///< off the surface at the end of the frame
  double step_mm = 0.0;    ///< along the surface after it
};

/// Options of all generators, validated.
struct PathTiming {
  std::size_t frames = 0;
  double rate_hz = 0.0, speed_mm_s = 0.0, depth_mm = 0.0, clearance_mm = 0.0, period_frames = 0.0;
  std::uint64_t seed = 0;
  std::vector<FrameStep> frame_steps{};  ///< one a frame; empty: constant speed with a sinusoidal offset
  [[nodiscard]] double step_mm() const { return speed_mm_s / rate_hz; }
  [[nodiscard]] double step_mm(std::size_t k) const {
    return frame_steps.empty() ? step_mm() : frame_steps[k].step_mm;
  }
  /// Of the surface point, over all frames.
  [[nodiscard]] double path_length_mm() const {
    if (frame_steps.empty()) return step_mm() * static_cast<double>(frames);
    double way = 0.0;
    for (const FrameStep& pace : frame_steps) way += pace.step_mm;
    return way;
  }
  /// From the clearance outside to the depth inside and back, once a period.
  [[nodiscard]] double offset_mm(std::size_t k) const {
    if (!frame_steps.empty()) return frame_steps[k].offset_mm;
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / period_frames;
    return 0.5 * (depth_mm + clearance_mm) * std::cos(turn) - 0.5 * (depth_mm - clearance_mm);
  }
  [[nodiscard]] double fastest_offset_mm() const {
    return 0.5 * (depth_mm + clearance_mm) * 2.0 * std::numbers::pi / period_frames;
  }
  /// Largest motion of the HIP in a frame.
  [[nodiscard]] double farthest_mm() const {
    return kMaxHipSpeedRatio * (step_mm() + (frame_steps.empty() ? fastest_offset_mm() : 0.0));
  }
};

struct SurfaceParameters {
  double u = 0.0, v = 0.0;
};
/// A curve over the surface's parameters.
using Curve = std::function<SurfaceParameters(double tau)>;
[[nodiscard]] Curve weave_curve(std::uint64_t seed);
/// Parallel lines joined at their ends; a unit of tau is a line, or a step to the next.
[[nodiscard]] Curve raster_curve(double lines);
/// From the rim to the middle and back; a unit of tau is a turn.
[[nodiscard]] Curve spiral_curve(double turns);

/// First guess for advance(), small enough to skip no turn.
inline constexpr double kFirstGuess = 1e-6;
/// The next tau at which `point` is `step` away from its current value, searched from `guess` on; negative if
/// none.
[[nodiscard]] double advance(const std::function<Vec3(double)>& point, double tau, double step, double guess);

/// `wish`, or the farthest place towards it from `last` that one frame allows.
[[nodiscard]] Vec3 limit_step(const Vec3& last, const Vec3& wish, double farthest_mm);

/// In and out along the normal.
[[nodiscard]] std::vector<Vec3> tap(const geometry::SurfacePoint& at, const PathTiming& timing);
/// To the depth along the normal within half a period, then still except for tremor.
[[nodiscard]] std::vector<Vec3> hold(const geometry::SurfacePoint& at, double tremor_mm,
                                     const PathTiming& timing);
/// Round at constant speed: down at the first place, along the lower row, up at the last, back along the
/// upper row. Rows of equal length, at least two places.
[[nodiscard]] Result<std::vector<Vec3>> slide(const std::vector<Vec3>& lower, const std::vector<Vec3>& upper,
                                              const PathTiming& timing);

/// The Error of follow() and slide() for an impossible speed.
[[nodiscard]] Error step_does_not_fit();

struct StrokeOptions {
  double slowest_mm_s = 0.0, fastest_mm_s = 0.0;
  double impacts = 0.0;  ///< share of strokes that hit at the fastest speed
};

/// One step per frame of `timing`. Each stroke has its own speed (log-uniform) and leaves by 1 to 1.5 times
/// clearance_mm. Free motion is at the fastest speed, and slow strokes are shallow enough to end within
/// period_frames. An impact goes straight to depth_mm at the fastest speed from full height; every other one
/// bounces at once.
[[nodiscard]] std::vector<FrameStep> strokes(const PathTiming& timing, const StrokeOptions& options);

// Paths over a model without a formula: along its visible surface, and exploring its points
// (palpate/paths.h). Internal to paths.

/// The HIP along the curve, relative to the cloud's origin: constant speed along the surface, offset along
/// the normal. Towards each end of the surface (border, hole, step to another sheet) it rises at 45 degrees
/// to the clearance, crosses to where the surface continues above everything visible, and descends.
[[nodiscard]] Result<std::vector<Vec3>> follow(const VisibleSurface& seen, const Curve& curve,
                                               const PathTiming& timing);

/// The surface at (u, v), or at the nearest lattice place that shows some.
struct VisiblePoint {
  geometry::SurfacePoint surface;
  double u = 0.0, v = 0.0;
};
[[nodiscard]] Result<VisiblePoint> nearest_visible(const VisibleSurface& seen, double u, double v);

/// From a place along u at one depth to the end of the surface, beyond it while nothing is in the way, and
/// back above.
[[nodiscard]] Result<std::vector<Vec3>> slide_over(const VisibleSurface& seen, const VisiblePoint& start,
                                                   const PathTiming& timing);

/// The start of a path over points, relative to the cloud's origin: the outermost surface place in a
/// direction that is certainly outside (up for height fields, the open side of an open mesh, random for
/// closed ones), and a HIP above it clear of all points.
struct PathStart {
  Vec3 on_surface, normal, outward, hip;
};
[[nodiscard]] Result<PathStart> find_start_outside(const PathTarget& target, const FitSearch& fitting,
                                                   double clearance_mm, Random& random);

/// HIP positions in the model frame.
/// A point walks over the cloud along a slowly turning heading. After each step it is projected to the plane
/// fitted to the points around (smooth weights), keeping the normal's side; where points end it turns. The
/// HIP is offset along the normal between clearance and -depth, at most at fastest_mm_s.
[[nodiscard]] Result<std::vector<Vec3>> explore(const PathTarget& target, const PathTiming& timing,
                                                double slowest_mm_s, double fastest_mm_s);

}  // namespace palpate::paths
