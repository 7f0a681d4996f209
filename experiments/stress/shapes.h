// Points of the stress matrix's bodies.
#pragma once

#include <vector>

#include <palpate/geometry.h>
#include <palpate/vec.h>

namespace palpate::experiments {

[[nodiscard]] std::vector<Vec3> joined_points(std::vector<Vec3> points, const std::vector<Vec3>& more);
/// `columns` x `rows` points starting at `corner`.
[[nodiscard]] std::vector<Vec3> lattice_points(const Vec3& corner, const Vec3& column, const Vec3& row,
                                               int columns, int rows);
/// A square lattice in the plane z = `z`, 2 `half` + 1 points a side, its middle on the z axis.
[[nodiscard]] std::vector<Vec3> flat_lattice(int half, double step, double z = 0.0);
/// Even points on a sphere by the golden angle.
[[nodiscard]] std::vector<Vec3> ball_points(const Vec3& centre, double radius, int count);
/// A cone around the z axis, from its base of this radius at z = 0 to its tip, open below.
[[nodiscard]] std::vector<Vec3> cone_points(double radius, double height, double spacing);
/// A quarter ring of this radius in the plane z = 0, from the x axis to the y axis, where it tapers to a
/// point.
[[nodiscard]] std::vector<Vec3> horn_points(double bend_radius, double thick_radius, double spacing);

/// A profile point for rotation about the z axis, mm.
struct OnProfile {
  double radius_mm, z_mm;
};
/// Rotates the profile, resampled to at most `step_mm`, in `count` steps about the z axis; outward where it
/// runs up. A point on the axis becomes one vertex with `count` facets.
[[nodiscard]] geometry::TriangleMesh turned_mesh(const std::vector<OnProfile>& corners, double step_mm,
                                                 int count);

}  // namespace palpate::experiments
