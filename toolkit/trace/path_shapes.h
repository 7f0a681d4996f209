// What path generators share: the timing, curves over a surface's parameters, and strokes at one place or
// along a row of places. Internal to trace.
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/analytic_surface.h"

namespace palpate::trace {

/// Paths run over the middle 80 % of the surface's parameters.
inline constexpr double kHalfSpan = 0.4;
/// The HIP may move at most this many times as fast as surface point and offset together: never reached on
/// smooth surfaces, on an edge, where the normal jumps, it turns the jump into a quick stroke.
inline constexpr double kFastestHip = 4.0;
/// Slides go on past the end of the surface by this part of its parameters.
inline constexpr double kBeyond = 0.1;

/// What the HIP does in one frame, where that is no wave in time.
struct Pace {
  double offset_mm = 0.0;  ///< off the surface at the end of the frame
  double step_mm = 0.0;    ///< along the surface after it
};

/// Options of all generators, validated.
struct Timing {
  std::size_t frames = 0;
  double rate_hz = 0.0, speed_mm_s = 0.0, depth_mm = 0.0, clearance_mm = 0.0, period_frames = 0.0;
  std::uint64_t seed = 0;
  std::vector<Pace> paces{};  ///< one a frame; empty: constant speed, a wave up and down
  [[nodiscard]] double step_mm() const { return speed_mm_s / rate_hz; }
  [[nodiscard]] double step_mm(std::size_t k) const { return paces.empty() ? step_mm() : paces[k].step_mm; }
  /// Of the surface point, in all frames.
  [[nodiscard]] double way_mm() const {
    if (paces.empty()) return step_mm() * static_cast<double>(frames);
    double way = 0.0;
    for (const Pace& pace : paces) way += pace.step_mm;
    return way;
  }
  /// From the clearance outside to the depth inside and back, once a period (design section 4).
  [[nodiscard]] double offset_mm(std::size_t k) const {
    if (!paces.empty()) return paces[k].offset_mm;
    const double turn = 2.0 * std::numbers::pi * static_cast<double>(k) / period_frames;
    return 0.5 * (depth_mm + clearance_mm) * std::cos(turn) - 0.5 * (depth_mm - clearance_mm);
  }
  [[nodiscard]] double fastest_offset_mm() const {
    return 0.5 * (depth_mm + clearance_mm) * 2.0 * std::numbers::pi / period_frames;
  }
  /// No HIP moves farther in one frame.
  [[nodiscard]] double farthest_mm() const {
    return kFastestHip * (step_mm() + (paces.empty() ? fastest_offset_mm() : 0.0));
  }
};

struct Parameters {
  double u = 0.0, v = 0.0;
};
/// A curve over the surface's parameters.
using Curve = std::function<Parameters(double tau)>;
[[nodiscard]] Curve weave_curve(std::uint64_t seed);
/// Parallel lines joined at their ends; one unit of tau is one line, or one step to the next.
[[nodiscard]] Curve raster_curve(double lines);
/// In from the rim to the middle and out again; one unit of tau is one turn.
[[nodiscard]] Curve spiral_curve(double turns);

/// A first guess for advance(): so small a part of the curve's parameter that no turn is skipped.
inline constexpr double kFirstGuess = 1e-6;
/// The next tau at which `point` is `step` away from where it is now, searched from `guess` ahead; negative
/// where there is none.
[[nodiscard]] double advance(const std::function<Vec3(double)>& point, double tau, double step, double guess);

/// `wish`, or as far towards it from `last` as the HIP may move in one frame.
[[nodiscard]] Vec3 held_back(const Vec3& last, const Vec3& wish, double farthest_mm);

/// In and out along the normal.
[[nodiscard]] std::vector<Vec3> tap(const geometry::SurfacePoint& at, const Timing& timing);
/// Along the normal to the depth within half a period, then still but for the tremor.
[[nodiscard]] std::vector<Vec3> hold(const geometry::SurfacePoint& at, double tremor_mm,
                                     const Timing& timing);
/// Round and round at constant speed: down at the first place, along the lower row, up at the last place,
/// back along the upper row. Both rows as long, at least two places.
[[nodiscard]] Result<std::vector<Vec3>> slide(const std::vector<Vec3>& lower, const std::vector<Vec3>& upper,
                                              const Timing& timing);

/// What follow() and slide() say of a speed that no path can have.
[[nodiscard]] Error step_does_not_fit();

}  // namespace palpate::trace
