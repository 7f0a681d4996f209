// A quadric patch: a second-order height over its tangent plane, fitted robustly to the points of a ball.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/vec.h>
#include "toolkit/spline_sdf/morton_points.h"

namespace palpate::spline_sdf {

/// The height along n over (u, v) at `at`: uu a^2 + uv a b + vv b^2. Lengths in mm, curvatures in 1/mm. u, v
/// and n are orthogonal, left-handed after a flip.
struct Quadric {
  Vec3 at = Vec3::Zero();
  Vec3 u = Vec3::UnitX(), v = Vec3::UnitY(), n = Vec3::UnitZ();
  double uu = 0.0, uv = 0.0, vv = 0.0;

  [[nodiscard]] double residual(const Vec3& p) const noexcept {
    const Vec3 d = p - at;
    const double a = d.dot(u), b = d.dot(v);
    return d.dot(n) - (uu * a * a + uv * a * b + vv * b * b);
  }
};

/// The unit normal at a place near the quadric.
[[nodiscard]] inline Vec3 normal_at(const Quadric& q, const Vec3& at) noexcept {
  const Vec3 d = at - q.at;
  const double a = d.dot(q.u), b = d.dot(q.v);
  return (q.n - q.u * (2.0 * q.uu * a + q.uv * b) - q.v * (2.0 * q.vv * b + q.uv * a)).normalized();
}

/// Turns the tangent plane about `at`; curvatures stay.
void set_normal(Quadric& q, const Vec3& n);

/// A fit with standard errors at its centre.
struct QuadricFit {
  Quadric quadric;
  double sigma = 0.0;        ///< of a point about it, mm
  double value_error = 0.0;  ///< mm
  double slope_error = 0.0;
  double seed_weight = 1.0;  ///< robust weight of the point it started from
  int points = 0;            ///< number of its points
};

/// The points of a ball, relative to its centre.
struct Ball {
  Vec3 centre = Vec3::Zero();
  double radius = 0.0;
  std::vector<Vec3> away;
  std::vector<std::uint32_t> place;

  void gather(const MortonPoints& points, const Vec3& at, double r);
  /// Takes the points of a larger ball about the same centre.
  void take_inner(const Ball& wide, double r);
  /// Drops points farther than `gate` off a quadric.
  void keep_near(const Quadric& quadric, double gate);
};

/// Least noise that a fit assumes, mm, and the weighting of points.
struct FitOptions {
  double sigma_floor = 0.0;
  bool robust = true;
  double core = 1.0;  ///< share of the radius for the first plane
  double most = 0.0;  ///< largest noise in units of sigma_floor; 0: unlimited
};

/// The spread of a ball's points, weighted towards its centre.
struct Spread {
  Vec3 normal = Vec3::UnitZ();  ///< direction of least variance
  double roundness = 0.0;       ///< ratio of the two other variances, smaller over larger
};
/// False if all coincide.
[[nodiscard]] bool spread_of(const Ball& ball, Spread& spread);

/// Fits the ball's points. `start`: the initial tangent plane, or null for the direction of least variance.
/// False if they determine no quadric. O(points).
[[nodiscard]] bool fit_quadric(const Ball& ball, const FitOptions& rule, const Quadric* start,
                               QuadricFit& fit);

/// If another sheet in the ball spoils the fit: keeps the points of the sheet through the centre. False, with
/// nothing changed, for one sheet, or noise that spans both. `spacing`: of the points.
[[nodiscard]] bool separate_sheets(Ball& ball, double spacing, double sigma_floor, QuadricFit& fit);

}  // namespace palpate::spline_sdf
