// Where the window looks from: round about a target, with one of the axes up.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "toolkit/core/vec.h"
#include "toolkit/geometry/aabb.h"

namespace palpate::experiments {

using Mat4 = Eigen::Matrix4d;

/// A place in the picture: pixels from the left and from the top; depth 0 (near) to 1 (far), as a depth
/// buffer has it.
struct Pixel {
  double x = 0.0, y = 0.0, depth = 0.0;
};

/// The axis of the world that points up in the picture. Files do not say it, and their habits differ (scans
/// of objects have y up, terrain and buildings z), so it is nobody's guess but the user's choice.
enum class Up : std::uint8_t { kZ, kY, kX, kMinusZ, kMinusY, kMinusX };
inline constexpr std::array kUps = {Up::kZ, Up::kY, Up::kX, Up::kMinusZ, Up::kMinusY, Up::kMinusX};
/// "z", "-y", ..
[[nodiscard]] const char* up_name(Up up) noexcept;
/// Nothing where it is no such name.
[[nodiscard]] std::optional<Up> up_named(std::string_view name) noexcept;

class Camera {
 public:
  /// Sees the whole box, from above at an angle.
  static Camera of(const geometry::Aabb& box_mm, Up up = Up::kZ);

  /// From the same side of the new up.
  void set_up(Up up) noexcept { up_ = up; }
  [[nodiscard]] Up up_axis() const noexcept { return up_; }
  void turn(double by_rad, double tilt_rad) noexcept;
  /// Above 1: nearer.
  void zoom(double factor) noexcept;
  /// By pixels of a picture of this height.
  void pan(double right_px, double down_px, double height_px) noexcept;

  [[nodiscard]] Mat4 clip_from_world(double width_px, double height_px) const noexcept;
  /// Unit, world: into the picture, right, up.
  [[nodiscard]] Vec3 forward() const noexcept;
  [[nodiscard]] Vec3 right() const noexcept;
  [[nodiscard]] Vec3 up() const noexcept;
  [[nodiscard]] Vec3 eye_mm() const noexcept { return target_mm_ - distance_mm_ * forward(); }
  [[nodiscard]] const Vec3& target_mm() const noexcept { return target_mm_; }
  [[nodiscard]] double distance_mm() const noexcept { return distance_mm_; }
  [[nodiscard]] double radius_mm() const noexcept { return radius_mm_; }
  /// Of a length at the target: how many pixels.
  [[nodiscard]] double pixels_per_mm(double height_px) const noexcept;
  /// How far the depth buffer's value moves with a mm away from the eye, at the target.
  [[nodiscard]] double depth_per_mm() const noexcept;

  [[nodiscard]] bool operator==(const Camera&) const = default;

 private:
  [[nodiscard]] double near_mm() const noexcept;
  [[nodiscard]] double far_mm() const noexcept;

  Vec3 target_mm_ = Vec3::Zero();
  double radius_mm_ = 1.0;  // of the scene
  double distance_mm_ = 3.0;
  double turn_rad_ = 0.0, tilt_rad_ = 0.0;
  Up up_ = Up::kZ;
};

/// Where a place of the world is seen; nothing behind the eye. Outside the picture too.
[[nodiscard]] std::optional<Pixel> project(const Mat4& clip_from_world, const Vec3& world_mm, double width_px,
                                           double height_px) noexcept;
/// Where a line of the world is seen: what of it is before the near plane, and which ends that cuts off.
struct SeenLine {
  Pixel a, b;
  bool cut_a = false, cut_b = false;  ///< this end is nearer than the near plane, or behind the eye
};
/// Nothing where all of it is nearer than the near plane. Pixels may lie far outside the picture, and are
/// finite.
[[nodiscard]] std::optional<SeenLine> project_line(const Mat4& clip_from_world, const Vec3& a_mm,
                                                   const Vec3& b_mm, double width_px,
                                                   double height_px) noexcept;
/// The place of the world that is seen there.
[[nodiscard]] Vec3 unproject(const Mat4& clip_from_world, const Pixel& pixel, double width_px,
                             double height_px) noexcept;

}  // namespace palpate::experiments
