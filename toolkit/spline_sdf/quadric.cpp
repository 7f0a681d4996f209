#include "toolkit/spline_sdf/quadric.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "toolkit/spline_sdf/fit_moments.h"

namespace palpate::spline_sdf {
namespace {

/// Reweighting rounds from an unknown plane, and from a known one.
constexpr int kFirstRounds = 4, kNextRounds = 2;
/// A residual of this many standard deviations gets a quarter of the weight (Geman and McClure 1985).
constexpr double kScaleSigmas = 3.0;
/// Median of |x| over the standard deviation of a normal distribution.
constexpr double kMedianShare = 0.6745;
/// Fewer points (a quadric's coefficients plus two) determine no error.
constexpr int kMinFitPoints = 8;
/// A pivot below this share of the largest: the points lie on a line or conic.
constexpr double kMinPivot = 1e-7;
/// Rounding of a fit relative to its radius: above that of sums over a thousand points and of
/// single-precision points in a model of some thousand spacings.
constexpr double kRoundingShare = 1e-6;
/// Sheets are sought through the centre and two of this many nearest points.
constexpr std::size_t kNextPoints = 7;
constexpr double kMinSine = 0.3;
/// Least ratio of a sheet's smaller to larger variance along it.
constexpr double kSheetRoundness = 0.2;
/// Sheets are separable if nearly all points are within this many spacings of one: residual deviation at most
/// that over 3.3. With a wider gate a sheet one spacing off would contribute.
constexpr double kSheetGate = 0.4, kSheetSigma = 0.12;
/// A fit to both sheets has residuals larger by at least this factor.
constexpr double kApart = 2.0;

/// A unit vector perpendicular to n.
Vec3 any_tangent(const Vec3& n) {
  const Vec3 axis = std::abs(n.x()) < std::abs(n.y()) ? Vec3::UnitX() : Vec3::UnitY();
  return (axis - n * n.dot(axis)).normalized();
}

/// From the points within a radius of the ball's centre.
bool least_direction_of(const Ball& ball, double radius, Vec3& n) {
  Vec3 mean = Vec3::Zero();
  double count = 0.0;
  const auto each = [&](auto&& visit) {
    for (const Vec3& p : ball.away)
      if (p.squaredNorm() <= radius * radius) visit(p);
  };
  each([&](const Vec3& p) {
    mean += p;
    count += 1.0;
  });
  mean /= count;
  Mat3 spread = Mat3::Zero();
  each([&](const Vec3& p) { spread += (p - mean) * (p - mean).transpose(); });
  Eigen::SelfAdjointEigenSolver<Mat3> solver;
  solver.computeDirect(spread / (ball.radius * ball.radius));
  if (solver.info() != Eigen::Success || !(solver.eigenvalues()[1] > kRoundingShare)) return false;
  n = solver.eigenvectors().col(0).normalized();
  return is_finite(n);
}

FitFrame frame_of(const Ball& ball, const Quadric& q) {
  const double per_radius = 1.0 / ball.radius;
  return {q.at - ball.centre, q.u * per_radius, q.v * per_radius, q.n * per_radius};
}

/// The lower triangle of six normal equations, factored.
using Triangle = std::array<std::array<double, 6>, 6>;

/// Cholesky factorisation of the moment equations. False if they determine no quadric.
bool factor(const FitMoments& sums, Triangle& l) {
  // The moments of each equation up to the diagonal.
  constexpr std::array<std::array<std::uint8_t, 6>, 6> kMoment{
      {{0}, {1, 3}, {2, 4, 5}, {3, 6, 7, 10}, {4, 7, 8, 11, 12}, {5, 8, 9, 12, 13, 14}}};
  const double least_sq = kMinPivot * sums.m[0];
  // Elements wait for roots and quotients; unrolled, other rows proceed meanwhile.
#pragma GCC unroll 6
  for (std::size_t i = 0; i < 6; ++i)
#pragma GCC unroll 6
    for (std::size_t j = 0; j <= i; ++j) {
      double rest = sums.m[kMoment[i][j]];
#pragma GCC unroll 6
      for (std::size_t k = 0; k < j; ++k) rest -= l[i][k] * l[j][k];
      if (j < i) {
        l[i][j] = rest / l[j][j];
        continue;
      }
      if (!(rest > least_sq)) return false;
      l[i][i] = std::sqrt(rest);
    }
  return true;
}

/// Solves the factored equations.
bool solve(const Triangle& l, const std::array<double, 6>& r, FitHeight& c) {
#pragma GCC unroll 6
  for (std::size_t i = 0; i < 6; ++i) {
    double rest = r[i];
#pragma GCC unroll 6
    for (std::size_t k = 0; k < i; ++k) rest -= l[i][k] * c[k];
    c[i] = rest / l[i][i];
  }
  bool finite = true;
#pragma GCC unroll 6
  for (std::size_t i = 6; i-- > 0;) {
    double rest = c[i];
#pragma GCC unroll 6
    for (std::size_t k = i + 1; k < 6; ++k) rest -= l[k][i] * c[k];
    c[i] = rest / l[i][i];
    finite = finite && std::isfinite(c[i]);
  }
  return finite;
}

/// Variance of coefficient i per variance of a point: the inverse's diagonal.
template <std::size_t i>
double variance_of(const Triangle& l) {
  std::array<double, 6> column{};
  double sum = 0.0;
#pragma GCC unroll 6
  for (std::size_t k = i; k < 6; ++k) {
    double rest = k == i ? 1.0 : 0.0;
#pragma GCC unroll 6
    for (std::size_t j = i; j < k; ++j) rest -= l[k][j] * column[j];
    column[k] = rest / l[k][k];
    sum += column[k] * column[k];
  }
  return sum;
}

/// Standard deviation about a height from the median residual, corrected for the fitted coefficients.
double scale_of(FitPoints& points, const FitHeight& c) {
  const std::size_t count = points.size();
  const double middle = points.median_residual(c);
  const double free = static_cast<double>(count) / static_cast<double>(count > 6 ? count - 6 : 1);
  return middle / kMedianShare * std::sqrt(free);
}

}  // namespace

void set_normal(Quadric& q, const Vec3& n) {
  q.n = n;
  Vec3 u = q.u - n * n.dot(q.u);
  const double length = u.norm();
  q.u = length > kRoundingShare ? Vec3(u / length) : any_tangent(n);
  q.v = n.cross(q.u);
}

void Ball::gather(const MortonPoints& points, const Vec3& at, double r) {
  centre = at;
  radius = r;
  const double radius_sq = r * r;
  std::size_t count = 0;
  points.visit_runs_near_ball(at, r, [&](std::uint32_t first, std::uint32_t past) {
    // Writes every point to the next slot and overwrites those outside: the test is unpredictable for
    // branches.
    const std::size_t most = count + (past - first);
    if (away.size() < most) {
      away.resize(std::max(most, 2 * away.size()));
      place.resize(away.size());
    }
    for (std::uint32_t i = first; i < past; ++i) {
      const Vec3 d = points[i] - at;
      away[count] = d;
      place[count] = i;
      count += d.squaredNorm() <= radius_sq ? std::size_t{1} : std::size_t{0};
    }
  });
  away.resize(count);
  place.resize(count);
}

void Ball::take_inner(const Ball& wide, double r) {
  centre = wide.centre;
  radius = r;
  away.resize(wide.away.size());
  place.resize(wide.away.size());
  std::size_t count = 0;
  for (std::size_t i = 0; i < wide.away.size(); ++i) {  // as gather()
    away[count] = wide.away[i];
    place[count] = wide.place[i];
    count += wide.away[i].squaredNorm() <= r * r ? std::size_t{1} : std::size_t{0};
  }
  away.resize(count);
  place.resize(count);
}

bool spread_of(const Ball& ball, Spread& spread) {
  Vec3 mean = Vec3::Zero();
  double weights = 0.0;
  const double per_sq = 1.0 / (ball.radius * ball.radius);
  const auto weight_of = [&](const Vec3& p) { return std::max(1.0 - p.squaredNorm() * per_sq, 0.0); };
  for (const Vec3& p : ball.away) {
    const double weight = weight_of(p);
    mean += weight * p;
    weights += weight;
  }
  if (!(weights > 0.0)) return false;
  mean /= weights;
  Mat3 sum = Mat3::Zero();
  for (const Vec3& p : ball.away) sum += weight_of(p) * per_sq * (p - mean) * (p - mean).transpose();
  Eigen::SelfAdjointEigenSolver<Mat3> solver;
  solver.computeDirect(sum);
  if (solver.info() != Eigen::Success || !(solver.eigenvalues()[2] > 0.0)) return false;
  spread.normal = solver.eigenvectors().col(0).normalized();
  spread.roundness = solver.eigenvalues()[1] / solver.eigenvalues()[2];
  return is_finite(spread.normal);
}

void Ball::keep_near(const Quadric& quadric, double gate) {
  std::size_t kept = 0;
  Quadric from_centre = quadric;
  from_centre.at = quadric.at - centre;
  for (std::size_t i = 0; i < away.size(); ++i) {  // as gather()
    const double off = from_centre.residual(away[i]);
    away[kept] = away[i];
    place[kept] = place[i];
    kept += std::abs(off) <= gate ? std::size_t{1} : std::size_t{0};
  }
  away.resize(kept);
  place.resize(kept);
}

bool fit_quadric(const Ball& ball, const FitOptions& rule, const Quadric* start, QuadricFit& fit) {
  const std::size_t count = ball.away.size();
  if (count < kMinFitPoints || !(ball.radius > 0.0)) return false;
  Quadric q;
  if (start != nullptr) {
    q = *start;
  } else {
    Vec3 n;
    if (!least_direction_of(ball, rule.core * ball.radius, n)) return false;
    q.at = ball.centre;
    set_normal(q, n);
  }
  thread_local FitPoints points;  // scratch; never read across calls
  points.take(ball.away);
  const double floor = std::max(rule.sigma_floor / ball.radius, kRoundingShare);
  double scale = 0.0;  // of the robust cost; 0: plain least squares
  if (rule.robust && start != nullptr) scale = kScaleSigmas * std::max(fit.sigma / ball.radius, floor);
  Triangle l;
  FitMoments sums;
  FitHeight c{0.0, 0.0, 0.0, q.uu * ball.radius, q.uv * ball.radius, q.vv * ball.radius};
  const int rounds = start != nullptr ? kNextRounds : kFirstRounds;
  for (int round = 0; round < rounds; ++round) {
    points.moments(frame_of(ball, q), c, scale > 0.0 ? 1.0 / scale : 0.0, sums);
    if (!factor(sums, l) || !solve(l, sums.r, c)) return false;
    fit.sigma = scale_of(points, c);
    const double known = rule.most > 0.0 ? std::min(fit.sigma, rule.most * floor) : fit.sigma;
    if (rule.robust) scale = kScaleSigmas * std::max(known, floor);
    // Rotates into the fitted tangent plane's frame; heights change to second order.
    const Vec3 n = (q.n - q.u * c[1] - q.v * c[2]).normalized();
    q.at += q.n * (c[0] * ball.radius);
    set_normal(q, n);
    q.uu = c[3] / ball.radius;
    q.uv = c[4] / ball.radius;
    q.vv = c[5] / ball.radius;
    c[0] = c[1] = c[2] = 0.0;
  }
  const double used = scale > 0.0 ? scale : kScaleSigmas * std::max(fit.sigma, floor);
  const double weights = points.weights(frame_of(ball, q), c, 1.0 / used);
  const double x = (q.residual(ball.centre) / ball.radius) / used;
  fit.seed_weight = 1.0 / ((1.0 + x * x) * (1.0 + x * x));
  fit.points = static_cast<int>(weights);
  fit.sigma *= ball.radius;
  const double sigma = std::max(fit.sigma, rule.sigma_floor);
  fit.value_error = sigma * std::sqrt(variance_of<0>(l));
  fit.slope_error = sigma / ball.radius * std::sqrt(0.5 * (variance_of<1>(l) + variance_of<2>(l)));
  fit.quadric = q;
  return is_finite(q.at) && is_finite(q.n);
}

namespace {

/// Weighted number of points on a plane through the ball's centre, nearer ones more.
double points_on(const Ball& ball, const Vec3& n, double gate) {
  const double per_sq = 1.0 / (ball.radius * ball.radius), per_gate = 1.0 / (gate * gate);
  double sum = 0.0;
  for (const Vec3& p : ball.away) {
    const double off = p.dot(n);
    sum += std::max(1.0 - p.squaredNorm() * per_sq, 0.0) * std::max(1.0 - off * off * per_gate, 0.0);
  }
  return sum;
}

/// Of the planes through the centre and two nearby points, the one near to most points.
bool likeliest_plane(const Ball& ball, double gate, Vec3& normal) {
  std::vector<Vec3> next = ball.away;
  const std::size_t count = std::min(next.size(), kNextPoints + 1);
  const auto nearer = [](const Vec3& a, const Vec3& b) {
    const double x = a.squaredNorm(), y = b.squaredNorm();
    return x != y ? x < y : std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::partial_sort(next.begin(), next.begin() + static_cast<std::ptrdiff_t>(count), next.end(), nearer);
  double most = 0.0;
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const Vec3 n = next[i].cross(next[j]);
      const double size = n.norm();
      if (!(size > kMinSine * next[i].norm() * next[j].norm())) continue;
      const double found = points_on(ball, n / size, gate);
      if (!(found > most)) continue;
      most = found;
      normal = n / size;
    }
  return most > 0.0;
}

}  // namespace

bool separate_sheets(Ball& ball, double spacing, double sigma_floor, QuadricFit& fit) {
  if (sigma_floor > kSheetSigma * spacing) return false;
  Quadric plane;
  if (!likeliest_plane(ball, kSheetGate * spacing, plane.n)) return false;
  plane.at = ball.centre;
  set_normal(plane, plane.n);
  Ball one = ball;
  one.keep_near(plane, kSheetGate * spacing);
  if (one.away.size() == ball.away.size()) return false;
  // A scan line with noise gives a perpendicular plane, not a sheet.
  Spread spread;
  if (!spread_of(one, spread) || spread.roundness < kSheetRoundness) return false;
  QuadricFit found;
  if (!fit_quadric(one, {sigma_floor, true}, nullptr, found)) return false;
  if (found.sigma > kSheetSigma * spacing || kApart * found.sigma > fit.sigma) return false;
  fit = found;
  ball = std::move(one);
  return true;
}

}  // namespace palpate::spline_sdf
