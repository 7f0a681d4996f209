#include "toolkit/surface/texture.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::surface {
namespace {

/// A number in 0 .. 1 that belongs to a corner of the noise's lattice.
double corner_value(std::int64_t x, std::int64_t y, std::int64_t z, std::uint64_t seed) noexcept {
  // Three odd multipliers spread the coordinates, two rounds of shift and multiply mix them (the finaliser of
  // splitmix64, Steele et al. 2014).
  std::uint64_t h = seed + 0x9E3779B97F4A7C15u * static_cast<std::uint64_t>(x) +
                    0xC2B2AE3D27D4EB4Fu * static_cast<std::uint64_t>(y) +
                    0x165667B19E3779F9u * static_cast<std::uint64_t>(z);
  h = (h ^ (h >> 30)) * 0xBF58476D1CE4E5B9u;
  h = (h ^ (h >> 27)) * 0x94D049BB133111EBu;
  h ^= h >> 31;
  return static_cast<double>(h >> 11) * 0x1.0p-53;
}

/// The steepest that the fade 6 t^5 - 15 t^4 + 10 t^3 gets, in the middle.
constexpr double kSteepestFade = 1.875;

struct Fade {
  double value, slope;
};
Fade fade(double t) noexcept {
  return {t * t * t * (t * (6.0 * t - 15.0) + 10.0), 30.0 * t * t * (t - 1.0) * (t - 1.0)};
}

/// Far from the origin the lattice's coordinates would not fit their integers; they wrap long before.
constexpr double kWrap = 1048576.0;  // 2^20 waves
double wrapped(double waves) noexcept {
  return waves - kWrap * std::floor(waves / kWrap);
}

Relief noise(const Texture& t, const Vec3& p) noexcept {
  const double per_mm = 1.0 / t.wavelength_mm;
  std::int64_t cell[3];
  Fade f[3];
  for (int axis = 0; axis < 3; ++axis) {
    const double at = wrapped(p[axis] * per_mm);
    const double low = std::floor(at);
    cell[axis] = static_cast<std::int64_t>(low);
    f[axis] = fade(at - low);
  }
  double value = 0.0;
  Vec3 slope = Vec3::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    double w[3], dw[3];
    std::int64_t at[3];
    for (int axis = 0; axis < 3; ++axis) {
      const bool high = (corner >> axis & 1) != 0;
      at[axis] = (cell[axis] + (high ? 1 : 0)) % static_cast<std::int64_t>(kWrap);
      w[axis] = high ? f[axis].value : 1.0 - f[axis].value;
      dw[axis] = high ? f[axis].slope : -f[axis].slope;
    }
    const double v = corner_value(at[0], at[1], at[2], t.seed);
    value += v * w[0] * w[1] * w[2];
    slope += v * Vec3(dw[0] * w[1] * w[2], w[0] * dw[1] * w[2], w[0] * w[1] * dw[2]);
  }
  return {t.depth_mm * value, slope * (t.depth_mm * per_mm)};
}

Relief grating(const Texture& t, const Vec3& p) noexcept {
  const double waves = 2.0 * std::numbers::pi / t.wavelength_mm;
  const double phase = waves * t.axis.dot(p);
  return {0.5 * t.depth_mm * (1.0 - std::cos(phase)), t.axis * (0.5 * t.depth_mm * waves * std::sin(phase))};
}

struct Pixel {
  double depth, du, dv;  ///< in pixels
};
/// Bilinear between the pixels' middles.
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

/// Laid on along each axis; the squares of the normal's coordinates sum to 1 and blend the three.
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
      return std::numbers::sqrt3 * kSteepestFade * depth_mm / wavelength_mm;
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
