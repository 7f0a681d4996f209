// Points of the bodies in the stress matrix.
#pragma once

#include <vector>

#include "toolkit/core/vec.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::experiments {

/// `columns` x `rows` points from `corner` on.
[[nodiscard]] std::vector<Vec3> lattice_points(const Vec3& corner, const Vec3& column, const Vec3& row,
                                               int columns, int rows);
/// Spread evenly over a ball by the golden angle.
[[nodiscard]] std::vector<Vec3> ball_points(const Vec3& centre, double radius, int count);
/// A cone around the z axis from its base of this radius at z = 0 to its tip, open below.
[[nodiscard]] std::vector<Vec3> cone_points(double radius, double height, double spacing);
/// A quarter of a ring of this radius in the plane z = 0 from the x axis to the y axis, thinning to a point
/// there.
[[nodiscard]] std::vector<Vec3> horn_points(double bend_radius, double thick_radius, double spacing);

/// A place of a profile that is turned about the z axis, mm.
struct OnProfile {
  double radius_mm, z_mm;
};
/// The profile between these corners, with places no further apart than `step_mm`, turned in `count` steps,
/// outward where it runs up; what is on the axis is one vertex, around which `count` facets meet.
[[nodiscard]] geometry::TriangleMesh turned_mesh(const std::vector<OnProfile>& corners, double step_mm,
                                                 int count);

}  // namespace palpate::experiments
