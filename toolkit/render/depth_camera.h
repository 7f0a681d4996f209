// Pixels, frames and windows of a depth camera. They give positions in space, the frames of use, and the part
// of an image that is needed first. Shared by every renderer that takes depth images.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/vec.h>
#include <Eigen/Core>

namespace palpate::render {

// The lens of Brown and Conrady, forwards in closed form and backwards by iteration. Writers and readers of
// images share it.

/// Image coordinates of a point whose z is 1, behind the lens.
[[nodiscard]] inline Eigen::Vector2d distorted(const stream::DepthCamera& camera, double x,
                                               double y) noexcept {
  const auto& [k1, k2, p1, p2, k3] = camera.distortion;
  const double r2 = x * x + y * y, radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
          y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y};
}

/// Pixel that sees `p`, a point in the camera's frame with z above 0.
[[nodiscard]] inline Eigen::Vector2d pixel_of(const stream::DepthCamera& camera, const Vec3& p) noexcept {
  const Eigen::Vector2d at = distorted(camera, p.x() / p.z(), p.y() / p.z());
  return {camera.fx_px * at.x() + camera.cx_px, camera.fy_px * at.y() + camera.cy_px};
}

/// Steps back through the lens: each divides the error by five for a lens that bends a ray by a fifth, so
/// that a pixel's share of 1e-10 is left.
inline constexpr int kLensSteps = 16;

/// Ray of a pixel in the camera's frame, with z = 1: times a depth it is the point.
[[nodiscard]] inline Vec3 ray_of(const stream::DepthCamera& camera, double u_px, double v_px) noexcept {
  const Eigen::Vector2d seen((u_px - camera.cx_px) / camera.fx_px, (v_px - camera.cy_px) / camera.fy_px);
  Eigen::Vector2d at = seen;
  if (camera.distortion != decltype(camera.distortion){})
    for (int step = 0; step < kLensSteps; ++step) at += seen - distorted(camera, at.x(), at.y());
  return {at.x(), at.y(), 1.0};
}

/// Pixels first column to last, rows likewise; `last` is not part of it.
struct PixelWindow {
  int first_column = 0, first_row = 0, last_column = 0, last_row = 0;

  [[nodiscard]] bool empty() const noexcept { return last_column <= first_column || last_row <= first_row; }
  [[nodiscard]] int columns() const noexcept { return last_column - first_column; }
  [[nodiscard]] int rows() const noexcept { return last_row - first_row; }
  [[nodiscard]] bool holds(const PixelWindow& other) const noexcept {
    return first_column <= other.first_column && first_row <= other.first_row &&
           last_column >= other.last_column && last_row >= other.last_row;
  }
};

/// Where a point in space falls on the image.
struct PixelPlace {
  double column = 0.0, row = 0.0;
  bool seen = false;  ///< in front of the camera and inside the image
};

/// The camera with its lens undone: a table of each pixel's direction. Immutable; thread-safe to read.
class PixelRays {
 public:
  /// O(pixels).
  explicit PixelRays(const stream::DepthCamera& camera);

  [[nodiscard]] const stream::DepthCamera& camera() const noexcept { return camera_; }
  [[nodiscard]] PixelWindow whole() const noexcept { return {0, 0, camera_.width, camera_.height}; }
  [[nodiscard]] std::size_t index(int column, int row) const noexcept {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(camera_.width) +
           static_cast<std::size_t>(column);
  }
  /// The point at depth 1 that the pixel sees, camera axes.
  [[nodiscard]] Vec3 ray(std::size_t pixel) const noexcept { return {x_[pixel], y_[pixel], 1.0}; }
  [[nodiscard]] PixelPlace project(const Vec3& in_camera_mm) const noexcept;
  /// Up to `edge` pixels each way around the place of a point; empty if the camera does not see it.
  [[nodiscard]] PixelWindow around(const Vec3& in_camera_mm, int edge) const noexcept;
  [[nodiscard]] std::size_t bytes() const noexcept {
    return (x_.capacity() + y_.capacity()) * sizeof(double);
  }

 private:
  stream::DepthCamera camera_;
  std::vector<double> x_, y_;  ///< by pixel
};

/// Nearer than a micrometre nothing is seen; and squares of inverse depths stay numbers.
inline constexpr float kLeastDepthMm = 1e-3F;
/// True for a depth that was measured.
[[nodiscard]] inline bool is_measured(float depth_mm) noexcept {
  return depth_mm >= kLeastDepthMm && std::isfinite(depth_mm);
}

/// Says of each frame whether it is of use, by those before it. For one thread.
class FrameGate {
 public:
  explicit FrameGate(std::size_t pixels) noexcept : pixels_(pixels) {}
  void forget() noexcept { any_ = false; }
  /// Only a taken frame is remembered.
  [[nodiscard]] stream::FrameFate judge(const stream::DepthFrame& frame) noexcept;

 private:
  std::size_t pixels_;
  bool any_ = false;
  std::uint64_t number_ = 0;
  double captured_s_ = 0.0;
};

}  // namespace palpate::render
