// Surfaces known by formula, exact in double. All work at any scale: every tolerance follows from the
// coordinates and the shape's own lengths. Open surfaces (plane, sinusoid, saddle, relief, wedge) are height
// fields that go on by their formula beyond the generated box; below them is inside everywhere.
//
// Makers return null for parameters that make no such shape (non-finite, or not positive where a length is
// needed).
#pragma once

#include <cstdint>
#include <memory>

#include "toolkit/geometry/analytic_surface.h"

namespace palpate::geometry {

/// z = 0 over the square of `extent_mm` about the origin.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_plane(double extent_mm);

/// z = A (cos(2 pi x / L) + cos(2 pi y / L)). Table 7 of the thesis: A = 10, L = 50, extent 100. Slopes along
/// one axis, 2 pi A / L, up to 8.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_sinusoid(double amplitude_mm, double wavelength_mm,
                                                                   double extent_mm);

/// z = c (x^2 - y^2) with c = curvature_per_mm / 2, so that the principal curvatures at the origin are +-
/// curvature.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_saddle(double curvature_per_mm, double extent_mm);

/// A detailed relief of 32 waves of random ways and phases, from the longer side down to `finest_mm`, all
/// equally steep; `slope` is the root of the mean square of its slope, at most 1. Rectangular in plan view.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_relief(double extent_x_mm, double extent_y_mm,
                                                                 double finest_mm, double slope,
                                                                 std::uint64_t seed);

/// Two half-planes that meet along the y axis, z = -|x| / tan(angle / 2): `angle_deg` is the angle of the
/// material, below 180 a ridge (convex), above 180 a valley (concave). Between 10 and 350 degrees.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_wedge(double angle_deg, double extent_mm);

/// Centred at the origin.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_sphere(double radius_mm);

/// A detailed closed surface around the origin: a sphere of `radius_mm` with 24 waves of random ways, from
/// the radius down to `finest_mm` long and equally steep; `slope`, at most 1, is about the root of the mean
/// square of its slope. Exact for places nearer to it than its sharpest bend, finest_mm / (2 pi slope) at the
/// least. Null where the waves would reach half of the radius.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_pebble(double radius_mm, double finest_mm,
                                                                 double slope, std::uint64_t seed);
/// The point of a pebble in that direction from its middle; `pebble` must come from make_pebble().
[[nodiscard]] Vec3 on_pebble(const AnalyticSurface& pebble, const Vec3& direction) noexcept;

/// Around the z axis: the tube of radius `minor_mm` around the circle of radius `major_mm` > minor_mm.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_torus(double major_mm, double minor_mm);

/// The closed box of extent x extent x thickness centred at the origin. at(u, v) runs over its upper face.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_slab(double extent_mm, double thickness_mm);

/// (x / a)^2 + (y / b)^2 + (z / c)^2 = 1 with the semi-axes (a, b, c).
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_ellipsoid(const Vec3& semi_axes_mm);

/// A closed box whose edges and corners are parts of cylinders and spheres of `radius_mm`, at most half of
/// its shortest side. at(u, v) runs over all of it.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_rounded_box(const Vec3& extent_mm,
                                                                      double radius_mm);
/// The point of a rounded box that the place `share` on the surface of the cube [-1, 1]^3 is mapped to: equal
/// ways on a face, and on an edge between two of them, are equal ways on the box. `box` must come from
/// make_rounded_box().
[[nodiscard]] Vec3 on_rounded_box(const AnalyticSurface& box, const Vec3& share) noexcept;
/// Half of the way along the surface from the middle of one face to that of the opposite one, by axis.
[[nodiscard]] Vec3 half_ways_of_rounded_box(const Vec3& extent_mm, double radius_mm) noexcept;

/// From which side an open surface is felt.
enum class Felt { kInside, kOutside };
/// The part of a sphere about the origin within `rim_deg` (1 to 179) of its lowest point: an open sheet, felt
/// from one side. It ends at its rim: a god object whose HIP has slid off the rim sideways is let go, which
/// track() says by a normal that points to the HIP. It has no inside: no distance to it is negative.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_bowl(double radius_mm, double rim_deg, Felt felt);

/// A hollow ball: the sphere of `radius_mm`, and another one `gap_mm` further in that bounds the hollow. Two
/// sheets; the god object stays on that which was entered. at(u, v) runs over the outer one.
[[nodiscard]] std::shared_ptr<const AnalyticSurface> make_shells(double radius_mm, double gap_mm);

}  // namespace palpate::geometry
