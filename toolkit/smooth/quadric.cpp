#include "toolkit/smooth/quadric.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace palpate::render {
namespace {

using Six = Eigen::Matrix<double, 6, 1>;
using SixBySix = Eigen::Matrix<double, 6, 6>;

/// Rounds of reweighting from a plane that is not known, and from one that is.
constexpr int kFirstRounds = 4, kNextRounds = 2;
/// A residual of so many standard deviations gets a quarter of the weight (Geman and McClure 1985).
constexpr double kScaleSigmas = 3.0;
/// The median of |x| of a normal distribution, as a share of its standard deviation.
constexpr double kMedianShare = 0.6745;
/// Fewer points than a quadric has numbers, and two more, determine no error.
constexpr int kFewestPoints = 8;
/// A pivot of less than this share of the largest: the points lie on a line, or a conic.
constexpr double kLeastPivot = 1e-7;
/// Rounding of a fit, as a share of its radius: well above that of sums over a thousand points and of the
/// points' single precision where a model spans some thousand spacings.
constexpr double kRoundingShare = 1e-6;
/// A sheet is looked for through the centre and two of so many points next to it.
constexpr std::size_t kNextPoints = 7;
constexpr double kLeastSine = 0.3;
/// The lesser variance of a sheet's points along it is at least this share of the greater.
constexpr double kSheetRoundness = 0.2;
/// Sheets are told apart where nearly all points are within this many spacings of one of them: the residuals'
/// standard deviation is at most that over 3.3. Wider, and a sheet one spacing off would have a say.
constexpr double kSheetGate = 0.4, kSheetSigma = 0.12;
/// Of a fit to both sheets the residuals are at least so much larger.
constexpr double kApart = 2.0;

/// Square to n.
Vec3 any_tangent(const Vec3& n) {
  const Vec3 axis = std::abs(n.x()) < std::abs(n.y()) ? Vec3::UnitX() : Vec3::UnitY();
  return (axis - n * n.dot(axis)).normalized();
}

/// Of the points within a radius of the ball's centre.
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

/// A ball's points in the quadric's frame, lengths in radii.
struct Local {
  std::vector<double> u, v, w, weight;
  std::vector<double> size;
  void take(const Ball& ball, const Quadric& q) {
    const std::size_t count = ball.away.size();
    u.resize(count);
    v.resize(count);
    w.resize(count);
    weight.resize(count);
    const double per_radius = 1.0 / ball.radius;
    const Vec3 shift = q.at - ball.centre;
    const Vec3 eu = q.u * per_radius, ev = q.v * per_radius, en = q.n * per_radius;
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3 d = ball.away[i] - shift;
      u[i] = d.dot(eu);
      v[i] = d.dot(ev);
      w[i] = d.dot(en);
    }
  }
};

struct Solution {
  Six c = Six::Zero();                                ///< 1, u, v, u^2, uv, v^2
  double value_variance = 0.0, slope_variance = 0.0;  ///< per variance of a point
};

bool solve(const Local& p, Solution& out) {
  // Moments u^i v^j up to the fourth order, and with w up to the second.
  std::array<double, 15> m{};
  std::array<double, 6> r{};
  for (std::size_t i = 0; i < p.u.size(); ++i) {
    const double a = p.u[i], b = p.v[i], k = p.weight[i];
    const double aa = a * a, ab = a * b, bb = b * b;
    const double kaa = k * aa, kab = k * ab, kbb = k * bb, kw = k * p.w[i];
    m[0] += k;
    m[1] += k * a;
    m[2] += k * b;
    m[3] += kaa;
    m[4] += kab;
    m[5] += kbb;
    m[6] += kaa * a;
    m[7] += kaa * b;
    m[8] += kbb * a;
    m[9] += kbb * b;
    m[10] += kaa * aa;
    m[11] += kaa * ab;
    m[12] += kaa * bb;
    m[13] += kbb * ab;
    m[14] += kbb * bb;
    r[0] += kw;
    r[1] += kw * a;
    r[2] += kw * b;
    r[3] += kw * aa;
    r[4] += kw * ab;
    r[5] += kw * bb;
  }
  SixBySix n;
  n << m[0], m[1], m[2], m[3], m[4], m[5],    //
      m[1], m[3], m[4], m[6], m[7], m[8],     //
      m[2], m[4], m[5], m[7], m[8], m[9],     //
      m[3], m[6], m[7], m[10], m[11], m[12],  //
      m[4], m[7], m[8], m[11], m[12], m[13],  //
      m[5], m[8], m[9], m[12], m[13], m[14];
  const Eigen::LLT<SixBySix> factor(n);
  if (factor.info() != Eigen::Success) return false;
  const auto diagonal = factor.matrixLLT().diagonal();
  if (!(diagonal.minCoeff() * diagonal.minCoeff() > kLeastPivot * m[0])) return false;
  out.c = factor.solve(Six(r.data()));
  Eigen::Matrix<double, 6, 3> unit = Eigen::Matrix<double, 6, 3>::Zero();
  unit(0, 0) = unit(1, 1) = unit(2, 2) = 1.0;
  const Eigen::Matrix<double, 6, 3> inverse = factor.solve(unit);
  out.value_variance = inverse(0, 0);
  out.slope_variance = 0.5 * (inverse(1, 1) + inverse(2, 2));
  return out.c.allFinite();
}

double height(const Six& c, double a, double b) {
  return c[0] + a * (c[1] + c[3] * a + c[4] * b) + b * (c[2] + c[5] * b);
}

/// The standard deviation about a solution by the median residual, allowing for the numbers fitted.
double scale_of(Local& p, const Six& c) {
  const std::size_t count = p.u.size();
  p.size.resize(count);
  for (std::size_t i = 0; i < count; ++i) p.size[i] = std::abs(p.w[i] - height(c, p.u[i], p.v[i]));
  const auto middle = p.size.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(p.size.begin(), middle, p.size.end());
  const double free = static_cast<double>(count) / static_cast<double>(count > 6 ? count - 6 : 1);
  return *middle / kMedianShare * std::sqrt(free);
}

double kernel(double a, double b) {
  return std::max(1.0 - a * a - b * b, 0.0);
}

}  // namespace

void turn_to(Quadric& q, const Vec3& n) {
  q.n = n;
  Vec3 u = q.u - n * n.dot(q.u);
  const double length = u.norm();
  q.u = length > kRoundingShare ? Vec3(u / length) : any_tangent(n);
  q.v = n.cross(q.u);
}

void Ball::gather(const SmoothPoints& points, const Vec3& at, double r) {
  centre = at;
  radius = r;
  away.clear();
  place.clear();
  points.in_ball(at, r, [&](std::uint32_t i, const Vec3& d, double) {
    away.push_back(d);
    place.push_back(i);
  });
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
  for (std::size_t i = 0; i < away.size(); ++i) {
    if (std::abs(quadric.residual(centre + away[i])) > gate) continue;
    away[kept] = away[i];
    place[kept++] = place[i];
  }
  away.resize(kept);
  place.resize(kept);
}

bool fit_quadric(const Ball& ball, const FitRule& rule, const Quadric* start, QuadricFit& fit) {
  const std::size_t count = ball.away.size();
  if (count < kFewestPoints || !(ball.radius > 0.0)) return false;
  Quadric q;
  if (start != nullptr) {
    q = *start;
  } else {
    Vec3 n;
    if (!least_direction_of(ball, rule.core * ball.radius, n)) return false;
    q.at = ball.centre;
    turn_to(q, n);
  }
  thread_local Local p;  // scratch; what a call leaves is never read by the next
  const double floor = std::max(rule.sigma_floor / ball.radius, kRoundingShare);
  double scale = 0.0;  // of the robust cost; 0: plain least squares
  Solution s;
  const int rounds = start != nullptr ? kNextRounds : kFirstRounds;
  for (int round = 0; round < rounds; ++round) {
    p.take(ball, q);
    for (std::size_t i = 0; i < count; ++i) {
      double weight = kernel(p.u[i], p.v[i]);
      if (scale > 0.0) {
        const double x = (p.w[i] - height(s.c, p.u[i], p.v[i])) / scale;
        const double y = 1.0 / (1.0 + x * x);
        weight *= y * y;
      } else if (rule.robust && start != nullptr) {
        const double x = (p.w[i] - ball.radius * (q.uu * p.u[i] * p.u[i] + q.uv * p.u[i] * p.v[i] +
                                                  q.vv * p.v[i] * p.v[i])) /
                         (kScaleSigmas * std::max(fit.sigma / ball.radius, floor));
        const double y = 1.0 / (1.0 + x * x);
        weight *= y * y;
      }
      p.weight[i] = weight;
    }
    if (!solve(p, s)) return false;
    fit.sigma = scale_of(p, s.c);
    const double known = rule.most > 0.0 ? std::min(fit.sigma, rule.most * floor) : fit.sigma;
    if (rule.robust) scale = kScaleSigmas * std::max(known, floor);
    // Into the frame of the tangent plane found; heights change by second order of the turn.
    const Vec3 n = (q.n - q.u * s.c[1] - q.v * s.c[2]).normalized();
    q.at += q.n * (s.c[0] * ball.radius);
    turn_to(q, n);
    q.uu = s.c[3] / ball.radius;
    q.uv = s.c[4] / ball.radius;
    q.vv = s.c[5] / ball.radius;
    s.c[0] = s.c[1] = s.c[2] = 0.0;
    if (scale > 0.0 && round + 1 == rounds) break;
  }
  double weights = 0.0;
  p.take(ball, q);
  const double used = scale > 0.0 ? scale : kScaleSigmas * std::max(fit.sigma, floor);
  for (std::size_t i = 0; i < count; ++i) {
    const double x = (p.w[i] - height(s.c, p.u[i], p.v[i])) / used;
    weights += 1.0 / ((1.0 + x * x) * (1.0 + x * x));
  }
  const double x = (q.residual(ball.centre) / ball.radius) / used;
  fit.centre_weight = 1.0 / ((1.0 + x * x) * (1.0 + x * x));
  fit.points = static_cast<int>(weights);
  fit.sigma *= ball.radius;
  const double sigma = std::max(fit.sigma, rule.sigma_floor);
  fit.value_error = sigma * std::sqrt(s.value_variance);
  fit.slope_error = sigma / ball.radius * std::sqrt(s.slope_variance);
  fit.quadric = q;
  return is_finite(q.at) && is_finite(q.n);
}

namespace {

/// How many points of a ball lie on a plane through its centre, nearer ones counted more.
double points_on(const Ball& ball, const Vec3& n, double gate) {
  const double per_sq = 1.0 / (ball.radius * ball.radius), per_gate = 1.0 / (gate * gate);
  double sum = 0.0;
  for (const Vec3& p : ball.away) {
    const double off = p.dot(n);
    sum += std::max(1.0 - p.squaredNorm() * per_sq, 0.0) * std::max(1.0 - off * off * per_gate, 0.0);
  }
  return sum;
}

/// Of the planes through the centre and two points next to it the one that most points are near to.
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
      if (!(size > kLeastSine * next[i].norm() * next[j].norm())) continue;
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
  turn_to(plane, plane.n);
  Ball one = ball;
  one.keep_near(plane, kSheetGate * spacing);
  if (one.away.size() == ball.away.size()) return false;
  // A scan line and its noise make a plane on edge, and no sheet.
  Spread spread;
  if (!spread_of(one, spread) || spread.roundness < kSheetRoundness) return false;
  QuadricFit found;
  if (!fit_quadric(one, {sigma_floor, true}, nullptr, found)) return false;
  if (found.sigma > kSheetSigma * spacing || kApart * found.sigma > fit.sigma) return false;
  fit = found;
  ball = std::move(one);
  return true;
}

}  // namespace palpate::render
