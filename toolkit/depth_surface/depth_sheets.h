// Surfaces in a camera's raster, as frames read them: what the camera sees, and behind it what it saw last.
//
// A pixel holds an inverse depth w. Over the raster w is a quadratic B-spline, so that 1 - z w(u, v) is
// positive in front of a surface, continuous with its slope, and linear in space on every plane, whose
// distance is exact so. A spline's support ends at depth edges: what lies beyond is continued from this side,
// so an edge is no wall and a thin part is as wide as its pixels.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/vec.h>

namespace palpate::depth_surface {

/// tan 80 degrees: a surface steeper towards the line of sight returns next to no light, and neighbours that
/// differ by more than it would show are two surfaces.
inline constexpr double kSteepestSlope = 5.67;
/// Normal noise exceeds this many standard deviations in one of 16,000 pixels, a mis-link every 5 windows.
inline constexpr double kNoiseSigmas = 4.0;

/// 1 - z w near a place is 1 - normal . q in camera coordinates, a plane.
struct DepthPlane {
  Vec3 normal = Vec3::Zero();  ///< away from the camera, not unit
  [[nodiscard]] double field(const Vec3& q) const noexcept { return 1.0 - normal.dot(q); }
};

struct DepthPlace {
  double u = 0.0, v = 0.0;
  double right = 0.0, below = 0.0;  ///< of the nearest pixel
  std::size_t pixel = 0;            ///< that pixel; 0, in the border: outside the image
};

/// One surface, immutable once published.
struct DepthSheets {
  /// Empty pixels around the raster, more than any support's reach.
  static constexpr int kBorder = 8;
  static constexpr int kLayers = 2;
  /// All eight neighbours are of the pixel's sheet.
  static constexpr std::uint8_t kAllLinks = 255;

  int columns = 0, rows = 0;
  std::ptrdiff_t stride = 0;
  double fx = 1.0, fy = 1.0, cx = 0.0, cy = 0.0;
  Mat3 camera_from_local = Mat3::Identity();
  Vec3 offset_mm = Vec3::Zero();
  double noise = 0.0;               ///< standard deviation of w, 1/mm
  std::uint64_t image = 0;          ///< counts the images; 0: none came yet
  std::vector<float> front;         ///< w, 1/mm; 0: no surface
  std::vector<float> rate;          ///< of front where all around moves as one, 1/(mm s); 0: at rest
  std::vector<float> hidden;        ///< of a surface that `front` occludes; 0: none
  std::vector<std::uint8_t> links;  ///< neighbours of front's sheet, bits in the order of neighbour()

  DepthSheets() = default;
  explicit DepthSheets(const stream::DepthCamera& camera)
      : columns(camera.width),
        rows(camera.height),
        stride(camera.width + 2 * kBorder),
        fx(camera.fx_px),
        fy(camera.fy_px),
        cx(camera.cx_px),
        cy(camera.cy_px),
        front(static_cast<std::size_t>(stride * (rows + 2 * kBorder))),
        rate(front.size()),
        hidden(front.size()),
        links(front.size()) {}

  [[nodiscard]] std::size_t index(int u, int v) const noexcept {
    return static_cast<std::size_t>((v + kBorder) * stride + u + kBorder);
  }
  /// Steps to the neighbours: right, left, below, above, then the diagonals.
  [[nodiscard]] std::array<std::ptrdiff_t, 8> neighbours() const noexcept {
    return {1, -1, stride, -stride, stride + 1, stride - 1, 1 - stride, -1 - stride};
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return (front.capacity() + rate.capacity() + hidden.capacity()) * sizeof(float) + links.capacity();
  }

  [[nodiscard]] Vec3 to_camera(const Vec3& p) const noexcept { return camera_from_local * p + offset_mm; }
  [[nodiscard]] Vec3 to_local(const Vec3& q) const noexcept {
    return camera_from_local.transpose() * (q - offset_mm);
  }
  [[nodiscard]] DepthPlace place(const Vec3& q) const noexcept {
    DepthPlace at;
    if (!(q.z() > 0.0)) return at;
    const double inverse = 1.0 / q.z();
    at.u = fx * q.x() * inverse + cx;
    at.v = fy * q.y() * inverse + cy;
    const double u = std::floor(at.u + 0.5), v = std::floor(at.v + 0.5);
    if (u >= 0.0 && v >= 0.0 && u < columns && v < rows)
      at.pixel = index(static_cast<int>(u), static_cast<int>(v));
    at.right = at.u - u;
    at.below = at.v - v;
    return at;
  }

  [[nodiscard]] double value(int layer, std::size_t pixel) const noexcept {
    return static_cast<double>(layer == 0 ? front[pixel] : hidden[pixel]);
  }
  /// The largest difference from w that one sheet shows over `pixels`.
  [[nodiscard]] double reach(double w, double pixels) const noexcept {
    return kSteepestSlope * w / fx * pixels + kNoiseSigmas * noise;
  }
  /// The layer that is w within `most`, the nearer to it; -1: none.
  [[nodiscard]] int layer_near(std::size_t pixel, double w, double most) const noexcept {
    int layer = -1;
    for (int k = 0; k < kLayers; ++k) {
      const double there = value(k, pixel), off = std::abs(there - w);
      if (there > 0.0 && off <= most) {
        layer = k;
        most = off;
      }
    }
    return layer;
  }

  /// The sheet of `layer` around a place; its pixel must have one.
  [[nodiscard]] DepthPlane plane(const DepthPlace& at, int layer) const noexcept {
    const std::size_t i = at.pixel;
    std::array<double, 9> s;
    if (layer == 0 && links[i] == kAllLinks) [[likely]] {
      const float* const mid = front.data() + i;
      for (std::ptrdiff_t row = 0; row < 3; ++row)
        for (std::ptrdiff_t column = 0; column < 3; ++column)
          s[static_cast<std::size_t>(3 * row + column)] =
              static_cast<double>(mid[(row - 1) * stride + column - 1]);
    } else {
      s = continued(i, layer);
    }
    const double x = at.right, y = at.below;
    const double xl = 0.5 - x, xr = 0.5 + x, yl = 0.5 - y, yr = 0.5 + y;
    const double bx[3] = {0.5 * xl * xl, 0.75 - x * x, 0.5 * xr * xr},
                 by[3] = {0.5 * yl * yl, 0.75 - y * y, 0.5 * yr * yr};
    double row[3], slope[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const double a = s[3 * k], b = s[3 * k + 1], c = s[3 * k + 2];
      row[k] = bx[0] * a + bx[1] * b + bx[2] * c;
      slope[k] = xl * (b - a) + xr * (c - b);
    }
    const double w = by[0] * row[0] + by[1] * row[1] + by[2] * row[2];
    const double wu = by[0] * slope[0] + by[1] * slope[1] + by[2] * slope[2];
    const double wv = yl * (row[1] - row[0]) + yr * (row[2] - row[1]);
    return {Vec3(fx * wu, fy * wv, w - wu * (at.u - cx) - wv * (at.v - cy))};
  }

 private:
  /// A pixel's 3 x 3 values where neighbours are of other sheets.
  [[nodiscard]] std::array<double, 9> continued(std::size_t i, int layer) const noexcept {
    const auto steps = neighbours();
    const double w = value(layer, i), most = reach(w, 1.0);
    double s[8];
    for (std::size_t k = 0; k < 8; ++k) {
      const std::size_t n = i + static_cast<std::size_t>(steps[k]);
      const bool linked = layer == 0 && (links[i] >> k & 1) != 0;
      const double behind = value(1, n), before = value(0, n);
      s[k] = linked                                                       ? before
             : behind > 0.0 && std::abs(behind - w) <= most               ? behind
             : layer == 1 && before > 0.0 && std::abs(before - w) <= most ? before
                                                                          : 0.0;
    }
    // A missing side is the mirror image of the other one; a missing corner follows from the sides.
    double side[4];
    for (std::size_t k = 0; k < 4; ++k) side[k] = s[k] > 0.0 ? s[k] : s[k ^ 1] > 0.0 ? 2.0 * w - s[k ^ 1] : w;
    const auto corner = [&](std::size_t k, double a, double b) { return s[k] > 0.0 ? s[k] : a + b - w; };
    return {corner(7, side[1], side[3]), side[3], corner(6, side[0], side[3]), side[1], w, side[0],
            corner(5, side[1], side[2]), side[2], corner(4, side[0], side[2])};
  }
};

}  // namespace palpate::depth_surface
