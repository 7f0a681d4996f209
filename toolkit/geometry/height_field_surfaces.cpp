// Smooth height fields z = f(x, y), tracked by a trust-region Newton method and entered by safe steps: plane,
// sinusoid, saddle, and a relief of equally steep waves, from the longer side down to the finest detail.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include <palpate/analytic_surface.h>
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

/// A height and its derivatives.
struct Jet {
  double f = 0.0, fx = 0.0, fy = 0.0, fxx = 0.0, fxy = 0.0, fyy = 0.0;
};

class HeightFieldSurface : public AnalyticSurface {
 public:
  explicit HeightFieldSurface(double extent_mm) : extent_mm_(extent_mm) {}

  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const noexcept override;
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p_mm) const noexcept override;
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a_mm,
                                                        const Vec3& b_mm) const noexcept override;
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override;

 protected:
  [[nodiscard]] virtual Jet jet(double x, double y) const noexcept = 0;
  /// Bounds over the surface on the second derivative of f along (dx, dy): upper, and negated lower.
  [[nodiscard]] virtual double rise_bound(double dx, double dy) const noexcept = 0;
  [[nodiscard]] virtual double fall_bound(double dx, double dy) const noexcept { return rise_bound(dx, dy); }
  /// Bound on the rounding error of z - f(x, y).
  [[nodiscard]] virtual double rounding_mm(const Vec3& p_mm) const noexcept = 0;
  /// Longest Newton step in plan view, a fraction of the shape's shortest length, so that no step leaves its
  /// valley of the distance. Infinite for a plane.
  [[nodiscard]] virtual double trust_mm() const noexcept = 0;

  [[nodiscard]] SurfacePoint on_surface(double x, double y) const noexcept;
  /// The local minimum of the distance to p, reached from (x, y).
  [[nodiscard]] SurfacePoint descend(double x, double y, const Vec3& p_mm) const noexcept;
  [[nodiscard]] double extent_mm() const noexcept { return extent_mm_; }

 private:
  double extent_mm_;
};

// Newton steps of one track(). With a trust radius of a twenty-fifth of the wavelength they span over ten
// waves.
constexpr int kTrackSteps = 300;
// An eigenvalue below this share of the larger one is noise, and the Hessian is shifted up to it. The square
// root of the unit roundoff balances a step's error against a missed negative curvature.
const double kMinCurvature = std::sqrt(kUnitRoundoff);

/// Half the squared distance from (x, y, f) to p, with gradient and Hessian in (x, y).
struct Local {
  double half_sq = 0.0, gx = 0.0, gy = 0.0, a = 0.0, b = 0.0, c = 0.0;
  [[nodiscard]] double gradient_sq() const noexcept { return gx * gx + gy * gy; }
};

Local local(const Jet& j, double x, double y, const Vec3& p) noexcept {
  const double dx = x - p.x(), dy = y - p.y(), r = j.f - p.z();
  return {0.5 * (dx * dx + dy * dy + r * r), dx + r * j.fx,           dy + r * j.fy,
          1.0 + j.fx * j.fx + r * j.fxx,     j.fx * j.fy + r * j.fxy, 1.0 + j.fy * j.fy + r * j.fyy};
}

struct Step {
  double x = 0.0, y = 0.0;
  bool convex = false;  ///< plain Newton step of a convex neighbourhood
  [[nodiscard]] double length() const noexcept { return std::hypot(x, y); }
};

/// Newton step with the Hessian shifted until positive; along the most negative curvature where the gradient
/// vanishes (a crest exactly above p).
Step newton_step(const Local& at, double reach, double gradient_rounding) noexcept {
  const double mean = 0.5 * (at.a + at.c), half_gap = std::hypot(0.5 * (at.a - at.c), at.b);
  const double least = mean - half_gap, most = std::max(std::abs(mean + half_gap), std::abs(least));
  const bool convex = least > kMinCurvature * most;
  if (!convex && least < 0.0 && at.gradient_sq() <= gradient_rounding * gradient_rounding &&
      std::isfinite(reach)) {
    // Eigenvector of `least`: the longer row of (H - least I) gives it. Its sign is fixed.
    double ex = at.b, ey = least - at.a;
    if (std::abs(at.a - least) < std::abs(at.c - least)) ex = least - at.c, ey = at.b;
    const double size = std::hypot(ex, ey);
    return size > 0.0 ? Step{reach * ex / size, reach * ey / size, false} : Step{reach, 0.0, false};
  }
  const double shift = convex ? 0.0 : kMinCurvature * most - least;
  const double a = at.a + shift, c = at.c + shift;
  const double det = a * c - at.b * at.b;
  return {-(c * at.gx - at.b * at.gy) / det, -(a * at.gy - at.b * at.gx) / det, convex};
}

SurfacePoint HeightFieldSurface::on_surface(double x, double y) const noexcept {
  const Jet j = jet(x, y);
  return {{x, y, j.f}, Vec3(-j.fx, -j.fy, 1.0).normalized()};
}

SurfacePoint HeightFieldSurface::descend(double x, double y, const Vec3& p) const noexcept {
  double reach = trust_mm();
  Local here = local(jet(x, y), x, y, p);
  for (int i = 0; i < kTrackSteps; ++i) {
    const double position_rounding =
        kUnitRoundoff * (std::abs(x) + std::abs(y) + std::abs(p.x()) + std::abs(p.y()));
    const double gradient_rounding = gamma(8) * (std::abs(x) + std::abs(y) + std::sqrt(here.half_sq));
    Step step = newton_step(here, reach, gradient_rounding);
    double length = step.length();
    if (!(length > position_rounding)) break;
    if (length > reach) {
      step.x *= reach / length;
      step.y *= reach / length;
      length = reach;
    }
    const double next_x = x + step.x, next_y = y + step.y;
    const Local there = local(jet(next_x, next_y), next_x, next_y, p);
    // Near the minimum the gradient still resolves a step where the distance does not.
    const bool better = there.half_sq < here.half_sq ||
                        (step.convex && there.gradient_sq() < here.gradient_sq() && length < reach);
    if (better) {
      x = next_x;
      y = next_y;
      here = there;
      reach = std::min(trust_mm(), 2.0 * reach);
    } else {
      reach = 0.5 * length;
      if (!(reach > position_rounding)) break;
    }
  }
  return on_surface(x, y);
}

SurfacePoint HeightFieldSurface::track(const SurfacePoint& from, const Vec3& p_mm) const noexcept {
  return descend(from.point_mm.x(), from.point_mm.y(), p_mm);
}

double HeightFieldSurface::signed_distance_mm(const Vec3& p_mm) const noexcept {
  const double distance = (closest(p_mm).point_mm - p_mm).norm();
  return p_mm.z() < jet(p_mm.x(), p_mm.y()).f ? -distance : distance;
}

std::optional<SurfacePoint> HeightFieldSurface::first_entry(const Vec3& a, const Vec3& b) const noexcept {
  const Vec3 d = b - a;
  // The point at parameter t carries the rounding of a + t d and of the height.
  const double rounding = rounding_mm(a.cwiseAbs().cwiseMax(b.cwiseAbs()));
  const auto along = [&](double t) noexcept {
    const Vec3 p = a + t * d;
    const Jet j = jet(p.x(), p.y());
    return SegmentSample{p.z() - j.f, d.z() - j.fx * d.x() - j.fy * d.y(), rounding};
  };
  const std::optional<double> t =
      first_entry_along(along, rise_bound(d.x(), d.y()), fall_bound(d.x(), d.y()), 0.0, 1.0);
  if (!t) return std::nullopt;
  const Vec3 p = a + *t * d;
  return on_surface(p.x(), p.y());
}

SurfacePoint HeightFieldSurface::at(double u, double v) const noexcept {
  return on_surface((u - 0.5) * extent_mm_, (v - 0.5) * extent_mm_);
}

class Plane final : public HeightFieldSurface {
 public:
  using HeightFieldSurface::HeightFieldSurface;
  [[nodiscard]] std::string formula() const override { return "z = 0"; }
  [[nodiscard]] Aabb box_mm() const override {
    const double h = 0.5 * extent_mm();
    return {{-h, -h, 0.0}, {h, h, 0.0}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override {
    return {{p.x(), p.y(), 0.0}, Vec3::UnitZ()};
  }

 protected:
  [[nodiscard]] Jet jet(double, double) const noexcept override { return {}; }
  [[nodiscard]] double rise_bound(double, double) const noexcept override { return 0.0; }
  [[nodiscard]] double rounding_mm(const Vec3& p) const noexcept override {
    return gamma(2) * std::abs(p.z());
  }
  [[nodiscard]] double trust_mm() const noexcept override { return std::numeric_limits<double>::infinity(); }
};

class Sinusoid final : public HeightFieldSurface {
 public:
  Sinusoid(double amplitude_mm, double wavelength_mm, double extent_mm)
      : HeightFieldSurface(extent_mm),
        amplitude_(amplitude_mm),
        wavelength_(wavelength_mm),
        w_(2.0 * std::numbers::pi / wavelength_mm) {}

  [[nodiscard]] std::string formula() const override {
    return fmt::format("z = {0} (cos(2 pi x / {1}) + cos(2 pi y / {1}))", amplitude_, wavelength_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double h = 0.5 * extent_mm();
    const double lowest = extent_mm() >= wavelength_ ? -1.0 : std::cos(w_ * h);
    return {{-h, -h, 2.0 * amplitude_ * lowest}, {h, h, 2.0 * amplitude_}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override;

 protected:
  [[nodiscard]] Jet jet(double x, double y) const noexcept override {
    const double cx = amplitude_ * std::cos(w_ * x), cy = amplitude_ * std::cos(w_ * y);
    return {cx + cy,
            -amplitude_ * w_ * std::sin(w_ * x),
            -amplitude_ * w_ * std::sin(w_ * y),
            -w_ * w_ * cx,
            0.0,
            -w_ * w_ * cy};
  }
  [[nodiscard]] double rise_bound(double dx, double dy) const noexcept override {
    return amplitude_ * w_ * w_ * (dx * dx + dy * dy);
  }
  [[nodiscard]] double rounding_mm(const Vec3& p) const noexcept override {
    const double slope = amplitude_ * w_;
    return gamma(8) * (std::abs(p.z()) + 2.0 * amplitude_ + slope * (std::abs(p.x()) + std::abs(p.y())));
  }
  [[nodiscard]] double trust_mm() const noexcept override {
    return 1.0 / (4.0 * w_ * std::max(1.0, amplitude_ * w_));
  }

 private:
  double amplitude_, wavelength_, w_;
};

// Start points per side of the square that closest() searches. The steepest sinusoid has slope 8, whose
// distance field varies over an eighth of the wave; 33 starts over 1.5 waves are 21 a wave.
constexpr int kStarts = 33;
// The steepest slope along an axis for which kStarts suffice.
constexpr double kSteepest = 8.0;
// Half the square's side in waves. The nearest crest and trough in plan view lie within 1 / sqrt(2) wave, and
// between them the surface takes every height, so the closest point is no farther in plan view. One start is
// added on every side.
constexpr double kSearchWaves = 0.75;

SurfacePoint Sinusoid::closest(const Vec3& p) const noexcept {
  double heights[2][kStarts];
  double squared[2][kStarts];
  const double step = 2.0 * kSearchWaves * wavelength_ / (kStarts - 1);
  for (int i = 0; i < kStarts; ++i) {
    const double offset = (i - kStarts / 2) * step;
    squared[0][i] = squared[1][i] = offset * offset;
    heights[0][i] = amplitude_ * std::cos(w_ * (p.x() + offset));
    heights[1][i] = amplitude_ * std::cos(w_ * (p.y() + offset));
  }
  double distance_sq[kStarts][kStarts];
  for (int i = 0; i < kStarts; ++i)
    for (int j = 0; j < kStarts; ++j) {
      const double r = heights[0][i] + heights[1][j] - p.z();
      distance_sq[i][j] = squared[0][i] + squared[1][j] + r * r;
    }
  SurfacePoint best;
  double best_sq = std::numeric_limits<double>::infinity();
  for (int i = 1; i + 1 < kStarts; ++i)
    for (int j = 1; j + 1 < kStarts; ++j) {
      const double here = distance_sq[i][j];
      if (here > distance_sq[i - 1][j] || here > distance_sq[i + 1][j] || here > distance_sq[i][j - 1] ||
          here > distance_sq[i][j + 1])
        continue;  // not a local minimum among its neighbours
      const double x = p.x() + (i - kStarts / 2) * step, y = p.y() + (j - kStarts / 2) * step;
      const SurfacePoint found = descend(x, y, p);
      const double found_sq = (found.point_mm - p).squaredNorm();
      if (found_sq < best_sq) {
        best = found;
        best_sq = found_sq;
      }
    }
  return best;
}

class Saddle final : public HeightFieldSurface {
 public:
  Saddle(double curvature_per_mm, double extent_mm)
      : HeightFieldSurface(extent_mm), c_(0.5 * curvature_per_mm) {}

  [[nodiscard]] std::string formula() const override { return fmt::format("z = {} (x^2 - y^2)", c_); }
  [[nodiscard]] Aabb box_mm() const override {
    const double h = 0.5 * extent_mm();
    return {{-h, -h, -c_ * h * h}, {h, h, c_ * h * h}};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override;

 protected:
  [[nodiscard]] Jet jet(double x, double y) const noexcept override {
    return {c_ * (x * x - y * y), 2.0 * c_ * x, -2.0 * c_ * y, 2.0 * c_, 0.0, -2.0 * c_};
  }
  [[nodiscard]] double rise_bound(double dx, double dy) const noexcept override {
    return 2.0 * c_ * (dx * dx - dy * dy);
  }
  [[nodiscard]] double fall_bound(double dx, double dy) const noexcept override {
    return -rise_bound(dx, dy);
  }
  [[nodiscard]] double rounding_mm(const Vec3& p) const noexcept override {
    return gamma(8) * (std::abs(p.z()) + 4.0 * c_ * (p.x() * p.x() + p.y() * p.y()));
  }
  [[nodiscard]] double trust_mm() const noexcept override { return 1.0 / (8.0 * c_); }

 private:
  double c_;
};

// Halvings that exhaust a double's precision.
constexpr int kHalvings = 64;

// The closest point minimises a quadratic under one quadratic equation, whose Lagrangian is convex at the
// global minimum (More 1993, theorem 3.2). With the height error r = f - z as multiplier, x = px / (1 + 2cr),
// y = py / (1 - 2cr) and |2cr| <= 1. The height error falls strictly with r, so bisection finds it.
SurfacePoint Saddle::closest(const Vec3& p) const noexcept {
  const auto x_at = [&](double r) { return p.x() == 0.0 ? 0.0 : p.x() / (1.0 + 2.0 * c_ * r); };
  const auto y_at = [&](double r) { return p.y() == 0.0 ? 0.0 : p.y() / (1.0 - 2.0 * c_ * r); };
  double low = -0.5 / c_, high = 0.5 / c_;
  for (int i = 0; i < kHalvings; ++i) {
    const double r = 0.5 * (low + high);
    const double x = x_at(r), y = y_at(r);
    (c_ * (x * x - y * y) - p.z() - r > 0.0 ? low : high) = r;
  }
  const double r = 0.5 * (low + high);
  double x = x_at(r), y = y_at(r);
  // In the planes of symmetry the multiplier may stop at its bound; the height then fixes the free
  // coordinate.
  if (p.x() == 0.0) x = std::sqrt(std::max(0.0, (p.z() + r) / c_ + y * y));
  if (p.y() == 0.0 && p.x() != 0.0) y = std::sqrt(std::max(0.0, x * x - (p.z() + r) / c_));
  if (p.x() == 0.0 && p.y() == 0.0) {
    y = 0.0;
    if (p.z() + r < 0.0) {
      x = 0.0;
      y = std::sqrt(-(p.z() + r) / c_);
    }
  }
  return descend(x, y, p);
}

constexpr double kTurn = 2.0 * std::numbers::pi;
/// About four waves an octave from 200 mm to 1 mm.
constexpr int kReliefWaves = 32;
/// Most start points per side of closest(), which bounds its time; they may then be over a quarter of the
/// shortest wave apart.
constexpr int kMaxStarts = 33;
constexpr double kStartsPerWave = 4.0;

struct PlaneWave {
  double amplitude, wx, wy, phase;
};

class Relief final : public HeightFieldSurface {
 public:
  Relief(double extent_x_mm, double extent_y_mm, double finest_mm, double slope, std::uint64_t seed)
      : HeightFieldSurface(extent_x_mm),
        extent_y_mm_(extent_y_mm),
        finest_mm_(finest_mm),
        slope_(slope),
        seed_(seed) {
    Random random(seed);
    const double longest = std::max(extent_x_mm, extent_y_mm);
    // The mean square of a wave's slope along its direction is half its peak squared.
    const double steepest = slope * std::sqrt(2.0 / kReliefWaves);
    for (int i = 0; i < kReliefWaves; ++i) {
      const double length = longest * std::pow(finest_mm / longest, i / (kReliefWaves - 1.0));
      const double w = kTurn / length, way = random.uniform(0.0, kTurn);
      waves_.push_back({steepest / w, w * std::cos(way), w * std::sin(way), random.uniform(0.0, kTurn)});
      height_ += steepest / w;
      slope_sum_ += steepest;
    }
  }

  [[nodiscard]] std::string formula() const override {
    return fmt::format("z = sum of {} waves from {:.6g} to {:.6g} mm, mean slope {:.4g}, seed {}",
                       kReliefWaves, std::max(extent_mm(), extent_y_mm_), finest_mm_, slope_, seed_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    const double x = 0.5 * extent_mm(), y = 0.5 * extent_y_mm_;
    return {{-x, -y, -height_}, {x, y, height_}};
  }
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    return on_surface((u - 0.5) * extent_mm(), (v - 0.5) * extent_y_mm_);
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override;

 protected:
  [[nodiscard]] Jet jet(double x, double y) const noexcept override {
    Jet j;
    for (const PlaneWave& w : waves_) {
      const double angle = w.wx * x + w.wy * y + w.phase;
      const double c = w.amplitude * std::cos(angle), s = w.amplitude * std::sin(angle);
      j.f += c;
      j.fx -= w.wx * s;
      j.fy -= w.wy * s;
      j.fxx -= w.wx * w.wx * c;
      j.fxy -= w.wx * w.wy * c;
      j.fyy -= w.wy * w.wy * c;
    }
    return j;
  }
  [[nodiscard]] double height(double x, double y) const noexcept {
    double z = 0.0;
    for (const PlaneWave& w : waves_) z += w.amplitude * std::cos(w.wx * x + w.wy * y + w.phase);
    return z;
  }
  [[nodiscard]] double rise_bound(double dx, double dy) const noexcept override {
    double sum = 0.0;
    for (const PlaneWave& w : waves_) {
      const double along = w.wx * dx + w.wy * dy;
      sum += w.amplitude * along * along;
    }
    return sum;
  }
  [[nodiscard]] double rounding_mm(const Vec3& p) const noexcept override {
    return gamma(kReliefWaves + 8) *
           (std::abs(p.z()) + height_ + slope_sum_ * (std::abs(p.x()) + std::abs(p.y())));
  }
  [[nodiscard]] double trust_mm() const noexcept override {
    return finest_mm_ / (4.0 * kTurn * std::max(1.0, slope_sum_));
  }

 private:
  double extent_y_mm_, finest_mm_, slope_;
  std::uint64_t seed_;
  std::vector<PlaneWave> waves_;
  double height_ = 0.0;     ///< bound on |f|
  double slope_sum_ = 0.0;  ///< bound on the slope
};

// The point directly above or below bounds the distance, hence the search in plan view. Start points a
// quarter of the shortest wave apart that are local minima lead to the minima.
SurfacePoint Relief::closest(const Vec3& p) const noexcept {
  const double radius = std::abs(p.z() - jet(p.x(), p.y()).f);
  SurfacePoint best = descend(p.x(), p.y(), p);
  double best_sq = (best.point_mm - p).squaredNorm();
  const double wanted = std::ceil(radius * kStartsPerWave / finest_mm_);
  const int half = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(kMaxStarts / 2)));
  const double step = radius / half;
  double square[kMaxStarts][kMaxStarts];
  for (int i = -half; i <= half; ++i)
    for (int k = -half; k <= half; ++k) {
      const double x = i * step, y = k * step, z = height(p.x() + x, p.y() + y) - p.z();
      square[i + half][k + half] = x * x + y * y + z * z;
    }
  const auto is_least = [&](int i, int k) {
    for (int di = -1; di <= 1; ++di)
      for (int dk = -1; dk <= 1; ++dk) {
        const int ni = i + di, nk = k + dk;
        if (ni < 0 || nk < 0 || ni > 2 * half || nk > 2 * half) continue;
        if (square[ni][nk] < square[i][k]) return false;
      }
    return true;
  };
  for (int i = 0; i <= 2 * half; ++i)
    for (int k = 0; k <= 2 * half; ++k) {
      // Between start points the surface is nearer by less than a step along its slope.
      const double reach = std::sqrt(best_sq) + step * (1.0 + slope_sum_);
      if (!(square[i][k] < reach * reach) || !is_least(i, k)) continue;
      const SurfacePoint found = descend(p.x() + (i - half) * step, p.y() + (k - half) * step, p);
      const double found_sq = (found.point_mm - p).squaredNorm();
      if (found_sq < best_sq) {
        best = found;
        best_sq = found_sq;
      }
    }
  return best;
}

}  // namespace

std::shared_ptr<const AnalyticSurface> make_plane(double extent_mm) {
  if (!is_length(extent_mm)) return nullptr;
  return std::make_shared<Plane>(extent_mm);
}

std::shared_ptr<const AnalyticSurface> make_sinusoid(double amplitude_mm, double wavelength_mm,
                                                     double extent_mm) {
  if (!is_length(amplitude_mm) || !is_length(wavelength_mm) || !is_length(extent_mm)) return nullptr;
  if (!(2.0 * std::numbers::pi * amplitude_mm / wavelength_mm <= kSteepest)) return nullptr;
  return std::make_shared<Sinusoid>(amplitude_mm, wavelength_mm, extent_mm);
}

std::shared_ptr<const AnalyticSurface> make_saddle(double curvature_per_mm, double extent_mm) {
  if (!is_length(curvature_per_mm) || !is_length(extent_mm)) return nullptr;
  return std::make_shared<Saddle>(curvature_per_mm, extent_mm);
}

std::shared_ptr<const AnalyticSurface> make_relief(double extent_x_mm, double extent_y_mm, double finest_mm,
                                                   double slope, std::uint64_t seed) {
  if (!is_length(extent_x_mm) || !is_length(extent_y_mm) || !is_length(finest_mm) || !is_length(slope) ||
      !(finest_mm < std::max(extent_x_mm, extent_y_mm)) || !(slope <= 1.0))
    return nullptr;
  return std::make_shared<Relief>(extent_x_mm, extent_y_mm, finest_mm, slope, seed);
}

}  // namespace palpate::geometry
