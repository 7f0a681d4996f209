// Pixels and rays of a depth camera: the lens of Brown and Conrady, forwards in closed form and backwards by
// iteration. Writers and readers of images share it.
#pragma once

#include <Eigen/Core>

#include <palpate/depth_stream.h>
#include <palpate/vec.h>

namespace palpate::stream {

/// Image coordinates of a point whose z is 1, behind the lens.
[[nodiscard]] inline Eigen::Vector2d distorted(const DepthCamera& camera, double x, double y) noexcept {
  const auto& [k1, k2, p1, p2, k3] = camera.distortion;
  const double r2 = x * x + y * y, radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
  return {x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
          y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y};
}

/// Pixel that sees `p`, a point in the camera's frame with z above 0.
[[nodiscard]] inline Eigen::Vector2d pixel_of(const DepthCamera& camera, const Vec3& p) noexcept {
  const Eigen::Vector2d at = distorted(camera, p.x() / p.z(), p.y() / p.z());
  return {camera.fx_px * at.x() + camera.cx_px, camera.fy_px * at.y() + camera.cy_px};
}

/// Steps back through the lens: each divides the error by five for a lens that bends a ray by a fifth, so
/// that a pixel's share of 1e-10 is left.
inline constexpr int kLensSteps = 16;

/// Ray of a pixel in the camera's frame, with z = 1: times a depth it is the point.
[[nodiscard]] inline Vec3 ray_of(const DepthCamera& camera, double u_px, double v_px) noexcept {
  const Eigen::Vector2d seen((u_px - camera.cx_px) / camera.fx_px, (v_px - camera.cy_px) / camera.fy_px);
  Eigen::Vector2d at = seen;
  if (camera.distortion != decltype(camera.distortion){})
    for (int step = 0; step < kLensSteps; ++step) at += seen - distorted(camera, at.x(), at.y());
  return {at.x(), at.y(), 1.0};
}

}  // namespace palpate::stream
