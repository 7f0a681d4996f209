// A piece of the smooth surface: a height over its own tangent plane, of second order, fitted robustly to the
// points of a ball.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/core/vec.h"
#include "toolkit/smooth/smooth_points.h"

namespace palpate::render {

/// The height n over (u, v) at `at`: uu a^2 + uv a b + vv b^2. Lengths in mm, curvatures in 1/mm.
/// u, v and n are square to each other, and left-handed once a sheet's sides are turned.
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

/// Unit, of a quadric at a place near it.
[[nodiscard]] inline Vec3 normal_at(const Quadric& q, const Vec3& at) noexcept {
  const Vec3 d = at - q.at;
  const double a = d.dot(q.u), b = d.dot(q.v);
  return (q.n - q.u * (2.0 * q.uu * a + q.uv * b) - q.v * (2.0 * q.vv * b + q.uv * a)).normalized();
}

/// Turns the tangent plane about `at`; curvatures stay as they are along it.
void turn_to(Quadric& q, const Vec3& n);

/// How well it is known at its centre, one standard error each.
struct QuadricFit {
  Quadric quadric;
  double sigma = 0.0;        ///< of a point about it, mm
  double value_error = 0.0;  ///< mm
  double slope_error = 0.0;
  double centre_weight = 1.0;  ///< what the robust cost gives the point it began at
  int points = 0;              ///< that it follows
};

/// The points of one ball, relative to its centre.
struct Ball {
  Vec3 centre = Vec3::Zero();
  double radius = 0.0;
  std::vector<Vec3> away;
  std::vector<std::uint32_t> place;

  void gather(const SmoothPoints& points, const Vec3& at, double r);
  /// Those of a larger ball about the same centre.
  void take_inner(const Ball& wide, double r);
  /// Leaves out the points farther than `gate` off a quadric.
  void keep_near(const Quadric& quadric, double gate);
};

/// What a fit is allowed to take for noise at least, mm, and how the points are weighed.
struct FitRule {
  double sigma_floor = 0.0;
  bool robust = true;
  double core = 1.0;  ///< share of the radius that a first plane is taken from
  double most = 0.0;  ///< what it may take for noise at most, in sigma_floor; 0: anything
};

/// How the points of a ball are spread, near its centre most.
struct Spread {
  Vec3 normal = Vec3::UnitZ();  ///< their least direction
  double roundness = 0.0;       ///< of the two others the lesser variance, over the greater
};
/// False where they are all in one place.
[[nodiscard]] bool spread_of(const Ball& ball, Spread& spread);

/// Fits the ball's points. `start`: a tangent plane to begin from, or null, where the points' least direction
/// is taken. False where they determine no quadric. O(points).
[[nodiscard]] bool fit_quadric(const Ball& ball, const FitRule& rule, const Quadric* start, QuadricFit& fit);

/// The sheet through a ball's centre, where another one within the ball makes it no fit: leaves the others'
/// points out of the ball. False, with nothing changed, where there is one sheet, or noise that reaches
/// across. `spacing`: of the points.
[[nodiscard]] bool separate_sheets(Ball& ball, double spacing, double sigma_floor, QuadricFit& fit);

}  // namespace palpate::render
