// Plane, sinusoid and saddle.
#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/height_field_surface.h"

namespace palpate::geometry {
namespace {

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
  [[nodiscard]] double fall_bound(double, double) const noexcept override { return 0.0; }
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
  [[nodiscard]] double fall_bound(double dx, double dy) const noexcept override { return rise_bound(dx, dy); }
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

}  // namespace

std::shared_ptr<const AnalyticSurface> make_plane(double extent_mm) {
  if (!is_length(extent_mm)) return nullptr;
  return std::make_shared<Plane>(extent_mm);
}

// The steepest slope along an axis for which kStarts suffice.
static constexpr double kSteepest = 8.0;

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

}  // namespace palpate::geometry
