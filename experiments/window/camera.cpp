#include "experiments/window/camera.h"

#include <Eigen/Geometry>  // cross products
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace palpate::experiments {
namespace {

/// tan of half the vertical angle of view, 40 degrees.
constexpr double kHalfView = 0.364;
/// Distance at which the whole scene fits, in radii: 1 / sin(20 degrees) is 2.92.
constexpr double kAwayRadii = 2.95;
constexpr double kNearestRadii = 0.02, kFarthestRadii = 50.0;
constexpr double kFirstTurn = -0.6, kFirstTilt = 0.6;
/// Less than a right angle: right and left are undefined from above.
constexpr double kMostTilt = 0.499 * std::numbers::pi;
/// Near plane as a share of the distance, for an eye within the scene.
constexpr double kNearShare = 0.01;

struct NamedUp {
  Up up;
  const char* name;
};
constexpr std::array<NamedUp, kUps.size()> kNamedUps = {{{Up::kZ, "z"},
                                                         {Up::kY, "y"},
                                                         {Up::kX, "x"},
                                                         {Up::kMinusZ, "-z"},
                                                         {Up::kMinusY, "-y"},
                                                         {Up::kMinusX, "-x"}}};

/// Rotates a z-up direction for another up axis. With y up, z points towards a viewer in front, as files with
/// y up expect.
Vec3 with_up(Up up, const Vec3& v) noexcept {
  switch (up) {
    case Up::kZ:
      break;
    case Up::kY:
      return {v.x(), v.z(), -v.y()};
    case Up::kX:
      return {v.z(), v.x(), v.y()};
    case Up::kMinusZ:
      return {v.x(), -v.y(), -v.z()};
    case Up::kMinusY:
      return {v.x(), -v.z(), v.y()};
    case Up::kMinusX:
      return {-v.z(), v.x(), -v.y()};
  }
  return v;
}

std::optional<Pixel> pixel_of_clip(const Eigen::Vector4d& clip, double width_px, double height_px) noexcept {
  if (!(clip.w() > 0.0)) return std::nullopt;
  const Vec3 at = clip.head<3>() / clip.w();
  if (!is_finite(at)) return std::nullopt;
  return Pixel{0.5 * (at.x() + 1.0) * width_px, 0.5 * (1.0 - at.y()) * height_px, 0.5 * (at.z() + 1.0)};
}

}  // namespace

const char* up_name(Up up) noexcept {
  for (const NamedUp& one : kNamedUps)
    if (one.up == up) return one.name;
  return "unknown";
}

std::optional<Up> up_named(std::string_view name) noexcept {
  for (const NamedUp& one : kNamedUps)
    if (name == one.name) return one.up;
  return std::nullopt;
}

Camera Camera::of(const geometry::Aabb& box_mm, Up up) {
  Camera camera;
  camera.up_ = up;
  camera.target_mm_ = box_mm.centre_mm();
  const double radius = 0.5 * box_mm.extent_mm().norm();
  camera.radius_mm_ = radius > 0.0 ? radius : 1.0;
  camera.distance_mm_ = kAwayRadii * camera.radius_mm_;
  camera.turn_rad_ = kFirstTurn;
  camera.tilt_rad_ = kFirstTilt;
  return camera;
}

void Camera::turn(double by_rad, double tilt_rad) noexcept {
  turn_rad_ = std::remainder(turn_rad_ + by_rad, 2.0 * std::numbers::pi);
  tilt_rad_ = std::clamp(tilt_rad_ + tilt_rad, -kMostTilt, kMostTilt);
}

void Camera::zoom(double factor) noexcept {
  distance_mm_ = std::clamp(distance_mm_ / factor, kNearestRadii * radius_mm_, kFarthestRadii * radius_mm_);
}

void Camera::pan(double right_px, double down_px, double height_px) noexcept {
  target_mm_ += (-right_px * right() + down_px * up()) / pixels_per_mm(height_px);
}

Vec3 Camera::forward() const noexcept {
  const double level = std::cos(tilt_rad_);
  return with_up(up_, Vec3{-std::sin(turn_rad_) * level, std::cos(turn_rad_) * level, -std::sin(tilt_rad_)});
}

Vec3 Camera::right() const noexcept {
  return with_up(up_, Vec3{std::cos(turn_rad_), std::sin(turn_rad_), 0.0});
}

Vec3 Camera::up() const noexcept {
  return right().cross(forward());
}

double Camera::pixels_per_mm(double height_px) const noexcept {
  return 0.5 * height_px / (kHalfView * distance_mm_);
}

double Camera::near_mm() const noexcept {
  // A panned target may be off-centre: two radii still hold the scene.
  return std::max(distance_mm_ - 2.0 * radius_mm_, kNearShare * distance_mm_);
}

double Camera::far_mm() const noexcept {
  return distance_mm_ + 2.0 * radius_mm_ + distance_mm_;
}

double Camera::depth_per_mm() const noexcept {
  const double n = near_mm(), f = far_mm();
  return f * n / ((f - n) * distance_mm_ * distance_mm_);
}

Mat4 Camera::clip_from_world(double width_px, double height_px) const noexcept {
  const Vec3 x = right(), y = up(), z = -forward(), eye = eye_mm();
  Mat4 eye_from_world = Mat4::Identity();
  eye_from_world.block<1, 3>(0, 0) = x.transpose();
  eye_from_world.block<1, 3>(1, 0) = y.transpose();
  eye_from_world.block<1, 3>(2, 0) = z.transpose();
  eye_from_world.block<3, 1>(0, 3) = Vec3{-x.dot(eye), -y.dot(eye), -z.dot(eye)};
  const double n = near_mm(), f = far_mm();
  Mat4 clip_from_eye = Mat4::Zero();
  clip_from_eye(0, 0) = height_px / (kHalfView * std::max(1.0, width_px));
  clip_from_eye(1, 1) = 1.0 / kHalfView;
  clip_from_eye(2, 2) = -(f + n) / (f - n);
  clip_from_eye(2, 3) = -2.0 * f * n / (f - n);
  clip_from_eye(3, 2) = -1.0;
  return clip_from_eye * eye_from_world;
}

std::optional<Pixel> project(const Mat4& clip_from_world, const Vec3& world_mm, double width_px,
                             double height_px) noexcept {
  return pixel_of_clip(clip_from_world * world_mm.homogeneous(), width_px, height_px);
}

std::optional<SeenLine> project_line(const Mat4& clip_from_world, const Vec3& a_mm, const Vec3& b_mm,
                                     double width_px, double height_px) noexcept {
  Eigen::Vector4d a = clip_from_world * a_mm.homogeneous(), b = clip_from_world * b_mm.homogeneous();
  // Homogeneous coordinates are linear along the line, even behind the eye. The near plane is z = -w.
  const double before_a = a.z() + a.w(), before_b = b.z() + b.w();
  SeenLine seen;
  seen.cut_a = !(before_a >= 0.0);
  seen.cut_b = !(before_b >= 0.0);
  if (seen.cut_a && seen.cut_b) return std::nullopt;
  if (seen.cut_a || seen.cut_b) {
    const Eigen::Vector4d cut = a + (b - a) * (before_a / (before_a - before_b));
    (seen.cut_a ? a : b) = cut;
  }
  const std::optional<Pixel> at_a = pixel_of_clip(a, width_px, height_px),
                             at_b = pixel_of_clip(b, width_px, height_px);
  if (!at_a || !at_b) return std::nullopt;
  seen.a = *at_a;
  seen.b = *at_b;
  return seen;
}

Vec3 unproject(const Mat4& clip_from_world, const Pixel& pixel, double width_px, double height_px) noexcept {
  const Eigen::Vector4d clip{2.0 * pixel.x / width_px - 1.0, 1.0 - 2.0 * pixel.y / height_px,
                             2.0 * pixel.depth - 1.0, 1.0};
  const Eigen::Vector4d world = clip_from_world.inverse() * clip;
  return world.head<3>() / world.w();
}

}  // namespace palpate::experiments
