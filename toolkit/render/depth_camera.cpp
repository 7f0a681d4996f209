#include "toolkit/render/depth_camera.h"

namespace palpate::render {

PixelRays::PixelRays(const stream::DepthCamera& camera)
    : camera_(camera), x_(camera.pixels()), y_(camera.pixels()) {
  for (int row = 0; row < camera.height; ++row)
    for (int column = 0; column < camera.width; ++column) {
      const Vec3 ray = ray_of(camera, column, row);
      x_[index(column, row)] = ray.x();
      y_[index(column, row)] = ray.y();
    }
}

PixelPlace PixelRays::project(const Vec3& in_camera_mm) const noexcept {
  PixelPlace place;
  if (!(in_camera_mm.z() > 0.0)) return place;
  const Eigen::Vector2d pixel = pixel_of(camera_, in_camera_mm);
  place.column = pixel.x();
  place.row = pixel.y();
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

namespace {

/// Poses are written with four digits or more. A turn that also scales would make another surface of the
/// image than the one that is felt.
constexpr double kTurnSlack = 1e-2;

bool is_pose(const geometry::RigidTransform& pose) noexcept {
  return is_finite(pose.translation_mm) && std::abs(pose.rotation.norm() - 1.0) < kTurnSlack;
}

}  // namespace

stream::FrameFate FrameGate::judge(const stream::DepthFrame& frame) noexcept {
  if (frame.depth_mm.size() != pixels_ || !std::isfinite(frame.captured_s) ||
      !std::isfinite(frame.arrived_s) || !is_pose(frame.world_from_camera))
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
