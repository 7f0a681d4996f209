#include <palpate/surface.h>

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "toolkit/core/hash.h"

namespace palpate::surface {
namespace {

/// The noise sums plane waves along the six axes of an icosahedron. The squared cosines of any line with them
/// sum to 2, so every line sees the same mean shortening.
constexpr int kWaves = 6;
using WaveDirections = std::array<Vec3, kWaves>;

/// Rotated by a quaternion of square roots of primes, so no wave is perpendicular to a model axis or plane
/// and no two look alike along one.
WaveDirections wave_directions() noexcept {
  const double golden = 0.5 * (1.0 + std::sqrt(5.0));
  const Vec3 corner(0.0, 1.0, golden);
  Eigen::Quaterniond turn(std::sqrt(2.0), std::sqrt(3.0), std::sqrt(5.0), std::sqrt(7.0));
  turn.normalize();
  WaveDirections directions;
  std::size_t next = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      Vec3 d;
      for (int i = 0; i < 3; ++i) d[(axis + i) % 3] = corner[i];
      if (side == 1) d[(axis + 1) % 3] = -d[(axis + 1) % 3];
      directions[next++] = turn * d.normalized();
    }
  return directions;
}
const WaveDirections kWaveDirections = wave_directions();

/// Waves per mm along each direction. A line sees a third of their square, and crossings of a sum of waves
/// occur at the root of the mean square (Rice 1944).
double waves_per_mm(const Texture& t) noexcept {
  return std::numbers::sqrt3 / t.wavelength_mm;
}

/// One period of a wave that rises from 0 at x = 0 to 1 at x = -1 and 1: the function of Wyvill, McPheeters
/// and Wyvill (1986). Within 0.002 of a cosine; its slope is exact, so it is a potential.
struct Wave {
  double value, slope;
};
Wave wave(double x) noexcept {
  const double square = x * x;
  return {square * (22.0 + square * (-17.0 + 4.0 * square)) / 9.0,
          x * (44.0 + square * (-68.0 + 24.0 * square)) / 9.0};
}
/// The steepest slope, at x^2 = 0.2535, where 120 x^4 - 204 x^2 + 44 = 0.
constexpr double kSteepestWave = 1.5835;

/// Phase of each wave: ten bits of the mixed seed.
constexpr int kPhaseBits = 10;

/// Distance to the nearest integer; 0 where doubles have no fractions. Adding 2^52 rounds to integers like
/// std::round (except halves) without a call.
double off_whole(double x) noexcept {
  constexpr double kWhole = 0x1.8p52;
  return std::abs(x) < 0x1p51 ? x - ((x + kWhole) - kWhole) : 0.0;
}

Relief noise(const Texture& t, const Vec3& p) noexcept {
  const double per_mm = waves_per_mm(t);
  const Vec3 at = per_mm * p;
  std::uint64_t bits = mixed64(t.seed + kGolden64);
  double value = 0.0;
  Vec3 slope = Vec3::Zero();
  for (const Vec3& direction : kWaveDirections) {
    const double phase = static_cast<double>(bits & ((1u << kPhaseBits) - 1)) / (1u << kPhaseBits);
    bits >>= kPhaseBits;
    const Wave here = wave(2.0 * off_whole(direction.dot(at) + phase));
    value += here.value;
    slope += here.slope * direction;
  }
  return {t.depth_mm / kWaves * value, (2.0 * per_mm * t.depth_mm / kWaves) * slope};
}

/// The sum when all waves are steepest at once with the worst signs.
double steepest_noise(const Texture& t) noexcept {
  double most_sq = 0.0;
  for (unsigned sides = 0; sides < 1u << kWaves; ++sides) {
    Vec3 sum = Vec3::Zero();
    for (unsigned i = 0; i < kWaves; ++i)
      sum += (sides >> i & 1u) != 0 ? kWaveDirections[i] : Vec3(-kWaveDirections[i]);
    most_sq = std::max(most_sq, sum.squaredNorm());
  }
  return 2.0 * waves_per_mm(t) * t.depth_mm / kWaves * kSteepestWave * std::sqrt(most_sq);
}

Relief grating(const Texture& t, const Vec3& p) noexcept {
  const double waves = 2.0 * std::numbers::pi / t.wavelength_mm;
  const double phase = waves * t.axis.dot(p);
  return {0.5 * t.depth_mm * (1.0 - std::cos(phase)), t.axis * (0.5 * t.depth_mm * waves * std::sin(phase))};
}

struct Pixel {
  double depth, du, dv;  ///< in pixels
};
/// Bilinear between pixel centres.
Pixel pixel(const TextureImage& image, double u, double v) noexcept {
  const double columns = image.columns, rows = image.rows;
  u -= columns * std::floor(u / columns);
  v -= rows * std::floor(v / rows);
  const auto u0 = std::min(static_cast<std::uint32_t>(u), image.columns - 1);
  const auto v0 = std::min(static_cast<std::uint32_t>(v), image.rows - 1);
  const std::uint32_t u1 = u0 + 1 == image.columns ? 0 : u0 + 1, v1 = v0 + 1 == image.rows ? 0 : v0 + 1;
  const double a = u - u0, b = v - v0;
  const auto carved = [&](std::uint32_t x, std::uint32_t y) {
    return 1.0 - image.height[std::size_t{y} * image.columns + x] * (1.0 / 65535.0);
  };
  const double d00 = carved(u0, v0), d10 = carved(u1, v0), d01 = carved(u0, v1), d11 = carved(u1, v1);
  return {(1.0 - b) * ((1.0 - a) * d00 + a * d10) + b * ((1.0 - a) * d01 + a * d11),
          (1.0 - b) * (d10 - d00) + b * (d11 - d01), (1.0 - a) * (d01 - d00) + a * (d11 - d10)};
}

/// Triplanar image: the squared normal components sum to 1 and blend the three projections.
Relief picture(const Texture& t, const Vec3& p, const Vec3& normal) noexcept {
  const double per_mm = t.image->columns / t.wavelength_mm;
  Relief sum;
  for (int axis = 0; axis < 3; ++axis) {
    const double weight = normal[axis] * normal[axis];
    if (!(weight > 0.0)) continue;
    const int u = (axis + 1) % 3, v = (axis + 2) % 3;
    const Pixel here = pixel(*t.image, p[u] * per_mm, p[v] * per_mm);
    sum.depth_mm += weight * t.depth_mm * here.depth;
    sum.slope[u] += weight * t.depth_mm * per_mm * here.du;
    sum.slope[v] += weight * t.depth_mm * per_mm * here.dv;
  }
  return sum;
}

}  // namespace

double Texture::steepest() const noexcept {
  switch (kind) {
    case TextureKind::kNone:
      return 0.0;
    case TextureKind::kGrating:
      return std::numbers::pi * depth_mm / wavelength_mm;
    case TextureKind::kNoise:
      return steepest_noise(*this);
    case TextureKind::kImage:
      break;
  }
  double most = 0.0;
  for (std::uint32_t y = 0; y < image->rows; ++y)
    for (std::uint32_t x = 0; x < image->columns; ++x) {
      const auto at = [&](std::uint32_t i, std::uint32_t j) {
        return static_cast<double>(
            image->height[std::size_t{j % image->rows} * image->columns + i % image->columns]);
      };
      most = std::max(most, std::hypot(at(x + 1, y) - at(x, y), at(x, y + 1) - at(x, y)));
    }
  return most / 65535.0 * depth_mm * image->columns / wavelength_mm;
}

Relief Texture::at(const Vec3& place_mm, const Vec3& normal) const noexcept {
  switch (kind) {
    case TextureKind::kNone:
      return {};
    case TextureKind::kGrating:
      return grating(*this, place_mm);
    case TextureKind::kNoise:
      return noise(*this, place_mm);
    case TextureKind::kImage:
      return picture(*this, place_mm, normal);
  }
  return {};
}

}  // namespace palpate::surface
