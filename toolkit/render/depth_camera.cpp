#include "toolkit/render/depth_camera.h"

#include <array>

namespace palpate::render {
namespace {

/// Rounds to undo a lens. Each shrinks the error by the lens's slope, about a third in the corners of wide
/// ones, so that thirty reach rounding.
constexpr int kLensRounds = 30;

struct Lens {
  double radial, tangential_x, tangential_y;
};

/// The lens of Brown and Conrady at an undistorted place.
Lens lens_at(const std::array<double, 5>& k, double x, double y) noexcept {
  const double square = x * x + y * y;
  return {1.0 + square * (k[0] + square * (k[1] + square * k[4])),
          2.0 * k[2] * x * y + k[3] * (square + 2.0 * x * x),
          k[2] * (square + 2.0 * y * y) + 2.0 * k[3] * x * y};
}

}  // namespace

PixelRays::PixelRays(const stream::DepthCamera& camera)
    : camera_(camera), x_(camera.pixels()), y_(camera.pixels()) {
  const bool plain = camera.distortion == std::array<double, 5>{};
  for (int row = 0; row < camera.height; ++row)
    for (int column = 0; column < camera.width; ++column) {
      const double distorted_x = (column - camera.cx_px) / camera.fx_px;
      const double distorted_y = (row - camera.cy_px) / camera.fy_px;
      double x = distorted_x, y = distorted_y;
      for (int round = 0; !plain && round < kLensRounds; ++round) {
        const Lens lens = lens_at(camera.distortion, x, y);
        x = (distorted_x - lens.tangential_x) / lens.radial;
        y = (distorted_y - lens.tangential_y) / lens.radial;
      }
      x_[index(column, row)] = x;
      y_[index(column, row)] = y;
    }
}

PixelPlace PixelRays::project(const Vec3& in_camera_mm) const noexcept {
  PixelPlace place;
  if (!(in_camera_mm.z() > 0.0)) return place;
  const double x = in_camera_mm.x() / in_camera_mm.z(), y = in_camera_mm.y() / in_camera_mm.z();
  const Lens lens = lens_at(camera_.distortion, x, y);
  place.column = camera_.fx_px * (x * lens.radial + lens.tangential_x) + camera_.cx_px;
  place.row = camera_.fy_px * (y * lens.radial + lens.tangential_y) + camera_.cy_px;
  place.seen = place.column >= -0.5 && place.column < camera_.width - 0.5 && place.row >= -0.5 &&
               place.row < camera_.height - 0.5;
  return place;
}

PixelWindow PixelRays::around(const Vec3& in_camera_mm, int edge) const noexcept {
  const PixelPlace place = project(in_camera_mm);
  if (!place.seen) return {};
  const int column = static_cast<int>(std::lround(place.column)) - edge / 2;
  const int row = static_cast<int>(std::lround(place.row)) - edge / 2;
  return {std::max(0, column), std::max(0, row), std::min(camera_.width, column + edge),
          std::min(camera_.height, row + edge)};
}

stream::FrameFate FrameGate::judge(const stream::DepthFrame& frame) noexcept {
  const geometry::RigidTransform& pose = frame.world_from_camera;
  if (frame.depth_mm.size() != pixels_ || !std::isfinite(frame.captured_s) ||
      !std::isfinite(frame.arrived_s) || !is_finite(pose.translation_mm) ||
      !pose.rotation.coeffs().allFinite())
    return stream::FrameFate::kTruncated;
  if (any_ && (frame.number == number_ || frame.captured_s == captured_s_))
    return stream::FrameFate::kRepeated;
  if (any_ && (frame.number < number_ || frame.captured_s < captured_s_)) return stream::FrameFate::kLate;
  any_ = true;
  number_ = frame.number;
  captured_s_ = frame.captured_s;
  return stream::FrameFate::kTaken;
}

}  // namespace palpate::render
