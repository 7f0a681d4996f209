// Analytic surfaces, exact in double precision at any scale: tolerances derive from coordinates and the
// shape's lengths. Open surfaces (plane, sinusoid, saddle, relief, wedge) are height fields that continue
// beyond the generated box; everything below them is inside.
//
// The functions return null for invalid parameters (non-finite, or not positive where a length is needed).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>

#include <palpate/analytic_surface.h>

namespace palpate::geometry {

/// The place (u, v) in [0, 1]^2 of the unit sphere. Equal areas: z is linear in v.
[[nodiscard]] inline Vec3 unit_sphere_at(double u, double v) noexcept {
  const double z = 1.0 - 2.0 * v, angle = 2.0 * std::numbers::pi * u,
               ring = std::sqrt(std::max(0.0, 1.0 - z * z));
  return {ring * std::cos(angle), ring * std::sin(angle), z};
}

/// z = 0 over the square of `extent_mm` about the origin.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_plane(double extent_mm);

/// z = A (cos(2 pi x / L) + cos(2 pi y / L)). Table 7 of the thesis: A = 10, L = 50, extent 100. Slope along
/// an axis, 2 pi A / L: up to 8.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_sinusoid(double amplitude_mm, double wavelength_mm,
                                                                   double extent_mm);

/// z = c (x^2 - y^2) with c = curvature_per_mm / 2; the principal curvatures at the origin are +-
/// curvature_per_mm.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_saddle(double curvature_per_mm, double extent_mm);

/// A relief of 32 equally steep waves of random directions and phases, with lengths from the longer side down
/// to `finest_mm`. `slope`, at most 1, is its root-mean-square slope. Rectangular in plan view.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_relief(double extent_x_mm, double extent_y_mm,
                                                                 double finest_mm, double slope,
                                                                 std::uint64_t seed);

/// Two half-planes that meet along the y axis: z = -|x| / tan(angle / 2). `angle_deg`, 10 to 350, is the
/// material's angle: a ridge below 180, a valley above.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_wedge(double angle_deg, double extent_mm);

/// Centred at the origin.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_sphere(double radius_mm);

/// A closed surface: a sphere of `radius_mm` with 24 equally steep waves of random directions, from the
/// radius down to `finest_mm` long. `slope`, at most 1, approximates the root-mean-square slope. Exact for
/// places nearer than its smallest radius of curvature, at least finest_mm / (2 pi slope). Null where the
/// waves would reach half the radius.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_pebble(double radius_mm, double finest_mm,
                                                                 double slope, std::uint64_t seed);
/// The point of a pebble in a direction from its centre; `pebble` must come from make_pebble().
[[nodiscard]] Vec3 pebble_point(const AnalyticSurface& pebble, const Vec3& direction) noexcept;

/// Around the z axis: a tube of radius `minor_mm` around the circle of radius `major_mm` > minor_mm.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_torus(double major_mm, double minor_mm);

/// The closed box of extent x extent x thickness centred at the origin. at(u, v) covers its upper face.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_slab(double extent_mm, double thickness_mm);

/// (x / a)^2 + (y / b)^2 + (z / c)^2 = 1 with the semi-axes (a, b, c).
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_ellipsoid(const Vec3& semi_axes_mm);

/// A closed box whose edges and corners are cylinders and spheres of `radius_mm`, at most half its shortest
/// side. at(u, v) covers all of it.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_rounded_box(const Vec3& extent_mm,
                                                                      double radius_mm);
/// Maps the place `share` on the cube [-1, 1]^3 to the rounded box, with equal arc lengths along a face and
/// along an edge. `box` must come from make_rounded_box().
[[nodiscard]] Vec3 rounded_box_point(const AnalyticSurface& box, const Vec3& share) noexcept;
/// Per axis: half the arc length from the centre of a face to that of the opposite one.
[[nodiscard]] Vec3 rounded_box_half_arcs(const Vec3& extent_mm, double radius_mm) noexcept;

/// The side from which an open surface is felt.
enum class Felt { kInside, kOutside };
/// The part of a sphere about the origin within `rim_deg` (1 to 179) of its lowest point: an open sheet felt
/// from one side, without an inside (no distance is negative). A god object whose HIP slides off the rim is
/// released; track() shows this by a normal that points to the HIP.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_bowl(double radius_mm, double rim_deg, Felt felt);

/// A hollow ball: the sphere of `radius_mm` and an inner one `gap_mm` below it. The god object stays on the
/// sheet that was entered. at(u, v) covers the outer one.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_shells(double radius_mm, double gap_mm);

// The first sign change of a smooth function along a segment, found without stepping over one.
//
// A function g with g'' >= -m cannot reach zero from t before the smallest root of g(t) + g'(t) s - m s^2 /
// 2. Steps to that root are safe; they converge quadratically at a transverse crossing (one-sided Newton) and
// by halving at a tangent one. No thin part is tunnelled, however long the segment.

/// Most steps of a search. A safe step is at least a fixed part of the surface's shortest wave, so this
/// covers hundreds of waves; a longer search ends without an answer.
inline constexpr int kEntrySteps = 4096;

/// Value, derivative along t, and rounding bound of the value.
struct SegmentSample {
  double value = 0.0;
  double slope = 0.0;
  double rounding = 0.0;
};

/// The largest s with value + slope * s - m s^2 / 2 > 0 on (0, s); infinite if always positive. value >= 0.
[[nodiscard]] inline double root_free_step(double value, double slope, double m) noexcept {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const double discriminant = slope * slope + 2.0 * m * value;
  if (slope < 0.0) return discriminant < 0.0 ? kNever : 2.0 * value / (std::sqrt(discriminant) - slope);
  return m > 0.0 ? (slope + std::sqrt(discriminant)) / m : kNever;
}

/// The smallest t in [from, to] where sign * g falls through zero; steps counts down from kEntrySteps. A
/// start within rounding of zero is not yet through; a touch within rounding is.
template <class Along>
[[nodiscard]] std::optional<double> first_falling_root(const Along& along, double sign, double m, double from,
                                                       double to, int& steps) noexcept {
  double t = from;
  while (t <= to && steps-- > 0) {
    const SegmentSample g = along(t);
    const double value = sign * g.value, slope = sign * g.slope;
    if (value <= g.rounding && slope < 0.0) return t;
    // At least the rounding bound, so every step advances, also past a zero that rises again.
    t += std::max(root_free_step(std::max(value, g.rounding), slope, m),
                  std::numeric_limits<double>::epsilon());
  }
  return std::nullopt;
}

/// The smallest t in [from, to] where g goes from outside (g >= 0 within rounding) to inside. -drop <= g'' <=
/// rise.
template <class Along>
[[nodiscard]] std::optional<double> first_entry_along(const Along& along, double drop, double rise,
                                                      double from, double to) noexcept {
  int steps = kEntrySteps;
  const SegmentSample start = along(from);
  double t = from;
  if (start.value < -start.rounding) {  // starts inside: must come out first
    const std::optional<double> exit = first_falling_root(along, -1.0, rise, from, to, steps);
    if (!exit) return std::nullopt;
    t = *exit;
  }
  return first_falling_root(along, 1.0, drop, t, to, steps);
}

}  // namespace palpate::geometry
