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

namespace palpate::render {

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
