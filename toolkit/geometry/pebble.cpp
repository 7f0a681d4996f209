// A detailed closed surface: a sphere with waves of many lengths.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::geometry {
namespace {

constexpr std::size_t kWaves = 24;
/// Steps of the god object to the nearest place. Each leaves at most curvature x distance of the error, under
/// a half where used, so 60 steps reach rounding.
constexpr int kSteps = 60;
/// Operations in a value of the radius: 24 waves of about ten each.
constexpr int kOperations = 256;

struct Wave {
  Vec3 way;  ///< times the radius: phase per unit of direction
  double phase = 0.0, height_mm = 0.0;
};

class Pebble final : public AnalyticSurface {
 public:
  Pebble(double radius_mm, double finest_mm, double slope, std::uint64_t seed)
      : radius_(radius_mm), finest_(finest_mm), slope_(slope), seed_(seed) {
    Random random(seed);
    // Lengths in a geometric series from the radius to the finest, equally steep. A squared slope's mean is
    // half its peak squared, and two thirds of it lie along the sphere.
    const double each = slope * std::sqrt(3.0 / kWaves);
    for (std::size_t i = 0; i < kWaves; ++i) {
      const double share = static_cast<double>(i) / (kWaves - 1);
      const double length = radius_mm * std::pow(finest_mm / radius_mm, share);
      const Vec3 way = Vec3(random.normal(), random.normal(), random.normal()).normalized();
      const double per_mm = 2.0 * std::numbers::pi / length;
      waves_[i] = {way * (per_mm * radius_mm), 2.0 * std::numbers::pi * random.uniform(), each / per_mm};
      highest_ += waves_[i].height_mm;
    }
  }

  /// Heights stay below half the radius, so all of the surface is visible from its centre.
  [[nodiscard]] bool is_pebble() const noexcept { return highest_ < 0.5 * radius_; }

  [[nodiscard]] std::string formula() const override {
    return fmt::format("|p| = {} + {} waves down to {} mm, mean slope {}, seed {}", radius_, kWaves, finest_,
                       slope_, seed_);
  }
  [[nodiscard]] Aabb box_mm() const override {
    return {Vec3::Constant(-radius_ - highest_), Vec3::Constant(radius_ + highest_)};
  }
  [[nodiscard]] SurfacePoint closest(const Vec3& p) const noexcept override { return track(above(p), p); }
  [[nodiscard]] double signed_distance_mm(const Vec3& p) const noexcept override {
    const SurfacePoint g = closest(p);
    const double d = (p - g.point_mm).norm();
    return p.norm() < radius_at(direction(p)) ? -d : d;
  }
  [[nodiscard]] SurfacePoint track(const SurfacePoint& from, const Vec3& p) const noexcept override {
    SurfacePoint at = from;
    double left = (p - at.point_mm).squaredNorm();
    for (int step = 0; step < kSteps; ++step) {
      const Vec3 r = p - at.point_mm;
      const Vec3 aside = r - at.normal * at.normal.dot(r);
      // Halves a step that would increase the distance; the direction is downhill.
      bool nearer = false;
      for (double share = 1.0; share > 0.01 && !nearer; share *= 0.5) {
        const SurfacePoint next = above(at.point_mm + share * aside);
        const double d = (p - next.point_mm).squaredNorm();
        if (!(d < left)) continue;
        at = next;
        left = d;
        nearer = true;
      }
      if (!nearer) break;
    }
    return at;
  }
  [[nodiscard]] std::optional<SurfacePoint> first_entry(const Vec3& a,
                                                        const Vec3& b) const noexcept override {
    const Vec3 d = b - a;
    const double low = radius_ - highest_;
    const double rounding = gamma(kOperations) * (a.norm() + b.norm() + radius_);
    const auto along = [&](double t) noexcept {
      const Vec3 p = a + t * d;
      const double size = p.norm();
      const Vec3 n = direction(p);
      const double slope = size > 0.0 ? n.dot(d) - gradient_at(n).dot(d - n * n.dot(d)) / size : 0.0;
      return SegmentSample{size - radius_at(n), slope, rounding};
    };
    // Bounds second derivatives outside the lowest sphere: |p|'' <= d^2 / low, and ((w / low)^2 + 3 w /
    // low^2) d^2 for each wave, w its phase per unit of direction.
    double bend = 1.0 / low;
    for (const Wave& wave : waves_) {
      const double w = wave.way.norm();
      bend += wave.height_mm * (w * w + 3.0 * w) / (low * low);
    }
    const double bound = bend * d.squaredNorm();
    const auto t = first_entry_along(along, bound, bound, 0.0, 1.0);
    if (!t) return std::nullopt;
    return above(a + *t * d);
  }
  [[nodiscard]] SurfacePoint at(double u, double v) const noexcept override {
    return above(unit_sphere_at(u, v));
  }

  /// The surface point in the direction of p from the centre.
  [[nodiscard]] SurfacePoint above(const Vec3& p) const noexcept {
    const Vec3 n = direction(p);
    const double r = radius_at(n);
    const Vec3 g = gradient_at(n);
    const Vec3 tilt = n - (g - n * n.dot(g)) / r;
    return {r * n, tilt.normalized()};
  }

 private:
  static Vec3 direction(const Vec3& p) noexcept {
    const double size = p.norm();
    return size > 0.0 ? Vec3(p / size) : Vec3::UnitZ();
  }
  [[nodiscard]] double radius_at(const Vec3& n) const noexcept {
    double r = radius_;
    for (const Wave& wave : waves_) r += wave.height_mm * std::cos(wave.way.dot(n) + wave.phase);
    return r;
  }
  /// Gradient of the radius over the direction, not projected onto the sphere.
  [[nodiscard]] Vec3 gradient_at(const Vec3& n) const noexcept {
    Vec3 g = Vec3::Zero();
    for (const Wave& wave : waves_) g -= wave.way * (wave.height_mm * std::sin(wave.way.dot(n) + wave.phase));
    return g;
  }

  double radius_, finest_, slope_;
  std::uint64_t seed_;
  double highest_ = 0.0;
  std::array<Wave, kWaves> waves_;
};

}  // namespace

std::shared_ptr<const AnalyticSurface> make_pebble(double radius_mm, double finest_mm, double slope,
                                                   std::uint64_t seed) {
  if (!std::isfinite(radius_mm) || !(finest_mm > 0.0) || !(finest_mm <= radius_mm) || !(slope > 0.0) ||
      !(slope <= 1.0))
    return nullptr;
  auto pebble = std::make_shared<const Pebble>(radius_mm, finest_mm, slope, seed);
  return pebble->is_pebble() ? pebble : nullptr;
}

Vec3 pebble_point(const AnalyticSurface& pebble, const Vec3& direction) noexcept {
  return static_cast<const Pebble&>(pebble).above(direction).point_mm;
}

}  // namespace palpate::geometry
