// A relief of equally steep waves, from the longer side down to the finest detail.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/geometry/height_field_surface.h"

namespace palpate::geometry {
namespace {

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
  [[nodiscard]] double fall_bound(double dx, double dy) const noexcept override { return rise_bound(dx, dy); }
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

std::shared_ptr<const AnalyticSurface> make_relief(double extent_x_mm, double extent_y_mm, double finest_mm,
                                                   double slope, std::uint64_t seed) {
  if (!is_length(extent_x_mm) || !is_length(extent_y_mm) || !is_length(finest_mm) || !is_length(slope) ||
      !(finest_mm < std::max(extent_x_mm, extent_y_mm)) || !(slope <= 1.0))
    return nullptr;
  return std::make_shared<Relief>(extent_x_mm, extent_y_mm, finest_mm, slope, seed);
}

}  // namespace palpate::geometry
