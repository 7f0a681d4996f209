// The window's camera: orbits a target, with one axis up.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include <palpate/geometry.h>
#include <palpate/vec.h>

namespace palpate::experiments {

using Mat4 = Eigen::Matrix4d;

/// A place in the picture: pixels from the left and the top; depth 0 (near) to 1 (far), as in the depth
/// buffer.
struct Pixel {
  double x = 0.0, y = 0.0, depth = 0.0;
};

/// World axis that points up in the picture. The user chooses it: files do not state it and habits differ (y
/// up for scanned objects, z for terrain and buildings).
enum class Up : std::uint8_t { kZ, kY, kX, kMinusZ, kMinusY, kMinusX };
inline constexpr std::array kUps = {Up::kZ, Up::kY, Up::kX, Up::kMinusZ, Up::kMinusY, Up::kMinusX};
[[nodiscard]] const char* up_name(Up up) noexcept;
/// Empty for other names.
[[nodiscard]] std::optional<Up> up_named(std::string_view name) noexcept;

class Camera {
 public:
  /// Sees the whole box, obliquely from above.
  static Camera of(const geometry::Aabb& box_mm, Up up = Up::kZ);

  /// Keeps the side of view relative to the new up axis.
  void set_up(Up up) noexcept { up_ = up; }
  [[nodiscard]] Up up_axis() const noexcept { return up_; }
  void turn(double by_rad, double tilt_rad) noexcept;
  /// Moves nearer for factors above 1.
  void zoom(double factor) noexcept;
  /// Pans by pixels of a picture of this height.
  void pan(double right_px, double down_px, double height_px) noexcept;

  [[nodiscard]] Mat4 clip_from_world(double width_px, double height_px) const noexcept;
  /// Unit vectors, world frame; forward points into the picture.
  [[nodiscard]] Vec3 forward() const noexcept;
  [[nodiscard]] Vec3 right() const noexcept;
  [[nodiscard]] Vec3 up() const noexcept;
  [[nodiscard]] Vec3 eye_mm() const noexcept { return target_mm_ - distance_mm_ * forward(); }
  [[nodiscard]] const Vec3& target_mm() const noexcept { return target_mm_; }
  [[nodiscard]] double distance_mm() const noexcept { return distance_mm_; }
  [[nodiscard]] double radius_mm() const noexcept { return radius_mm_; }
  /// Pixels per mm at the target.
  [[nodiscard]] double pixels_per_mm(double height_px) const noexcept;
  /// Depth-buffer change per mm away from the eye, at the target.
  [[nodiscard]] double depth_per_mm() const noexcept;

  [[nodiscard]] bool operator==(const Camera&) const = default;

 private:
  [[nodiscard]] double near_mm() const noexcept;
  [[nodiscard]] double far_mm() const noexcept;

  Vec3 target_mm_ = Vec3::Zero();
  double radius_mm_ = 1.0;  // the scene's
  double distance_mm_ = 3.0;
  double turn_rad_ = 0.0, tilt_rad_ = 0.0;
  Up up_ = Up::kZ;
};

/// Projects a world position, also outside the picture; empty behind the eye.
[[nodiscard]] std::optional<Pixel> project(const Mat4& clip_from_world, const Vec3& world_mm, double width_px,
                                           double height_px) noexcept;
/// A line's visible part before the near plane.
struct SeenLine {
  Pixel a, b;
  bool cut_a = false, cut_b = false;  ///< this end is cut off by the near plane
};
/// Empty if the whole line is nearer than the near plane. Pixels may lie far outside the picture but are
/// finite.
[[nodiscard]] std::optional<SeenLine> project_line(const Mat4& clip_from_world, const Vec3& a_mm,
                                                   const Vec3& b_mm, double width_px,
                                                   double height_px) noexcept;
/// The world position seen at a pixel.
[[nodiscard]] Vec3 unproject(const Mat4& clip_from_world, const Pixel& pixel, double width_px,
                             double height_px) noexcept;

}  // namespace palpate::experiments
