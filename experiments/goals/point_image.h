// A software point renderer with depth, for drawing beside a servo loop.
#pragma once

#include <cstdint>
#include <vector>

#include <palpate/cloud.h>

namespace palpate::experiments {

inline constexpr int kImageWidth = 1280, kImageHeight = 720;

struct PointImage {
  std::vector<std::uint8_t> grey;  ///< rows from the top; empty: nothing drawn
  std::vector<float> depth_mm;
};

/// Draws a cloud progressively in random order, so every prefix is an even sample and an early end still
/// shows the whole.
class PointDrawer {
 public:
  /// Copies the points. O(n).
  explicit PointDrawer(const cloud::Cloud& cloud);

  /// Begins a picture with the camera rotated by `turn_rad`.
  void begin(double turn_rad);
  /// Draws the next `count` points; returns the number left.
  std::size_t draw(std::size_t count) noexcept;
  /// Draws a small cross at a model position.
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
  float right_x_ = 1.0f, right_y_ = 0.0f;  // the camera's, in the xy plane
  std::size_t next_ = 0;
};

}  // namespace palpate::experiments
