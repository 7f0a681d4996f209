// Points drawn into a picture with depth, in software: what a program without a second processor does beside
// its servo loop.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::experiments {

inline constexpr int kImageWidth = 1280, kImageHeight = 720;

struct PointImage {
  std::vector<std::uint8_t> grey;  ///< rows from the top; empty: nothing was drawn
  std::vector<float> depth_mm;
};

/// Draws more and more of a cloud: the points stand in random order, so that each beginning of them is an
/// even sample, and a picture that has to end early still shows the whole.
class PointDrawer {
 public:
  /// Copies the points. O(n).
  explicit PointDrawer(const cloud::Cloud& cloud);

  /// Begins a picture from a camera that has gone round by `turn_rad`.
  void begin(double turn_rad);
  /// Draws the next `count` points; how many were left to draw.
  std::size_t draw(std::size_t count) noexcept;
  /// A small cross at a place of the model.
  void mark(const Vec3& at_mm) noexcept;
  [[nodiscard]] const PointImage& image() const noexcept { return image_; }
  [[nodiscard]] std::size_t size() const noexcept { return points_.size(); }

 private:
  struct Point {
    float x, y, z;
  };
  struct Seen {
    int column = -1, row = -1;
    float depth_mm = 0.0f;
  };
  [[nodiscard]] Seen see(float x, float y, float z) const noexcept;

  std::vector<Point> points_;
  PointImage image_;
  Vec3 origin_mm_ = Vec3::Zero();
  float radius_mm_ = 1.0f;
  float right_x_ = 1.0f, right_y_ = 0.0f;  // of the camera, in the plane of x and y
  std::size_t next_ = 0;
};

}  // namespace palpate::experiments
