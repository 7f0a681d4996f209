// Stock scenes for simulated cameras: sim:NAME[:option=value..]. The scenes stand a metre in front of the
// camera.
//
//   wall          a plane
//   moving-wall   a plane that swings along its normal
//   table         a sphere and a box on a table, seen from the side
//   hand          a sphere that swings over a table
//   step          a step of 40 mm across the middle of the image
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/renderer.h>
#include <palpate/result.h>

namespace palpate::stream {

/// Errors of a simulated camera, as of structured light. 0 switches each off. The axial noise is the
/// DepthCamera's.
struct SensorErrors {
  double lateral_px = 0.0;         ///< standard deviation of where a pixel looks
  double baseline_mm = 0.0;        ///< camera to projector, along x: what it does not light is a hole
  double disparity_step_px = 0.0;  ///< disparities are whole steps; needs a baseline
  double flying = 0.0;             ///< share of pixels at edges that hang between front and back
  double grazing_deg = 0.0;        ///< surfaces seen at a larger angle from their normal are holes
  double dropout = 0.0;            ///< share of the pixels that are holes at random
};

/// Errors of the way from camera to program: shares of the frames.
struct TransportErrors {
  double latency_s = 0.0;
  double jitter_s = 0.0;   ///< standard deviation of the latency
  double late = 0.0;       ///< held up by three periods, those behind it with it
  double repeated = 0.0;   ///< come twice
  double unordered = 0.0;  ///< come after the next one
  double truncated = 0.0;  ///< lose the end of their depths
};

struct SimulatedSensor {
  SensorErrors sensor{};
  TransportErrors transport{};
  double start_s = 0.0;      ///< capture of the first frame
  std::uint64_t frames = 0;  ///< 0: without end
  std::uint64_t seed = 1;
};

/// Every call makes models and motions of its own: one for the camera, one for each renderer.
struct StockScene {
  render::SceneInput scene;  ///< every model has a formula, or faces of its own
  geometry::RigidTransform world_from_camera;
  DepthCamera camera;
  SimulatedSensor simulated;
};

inline constexpr const char* kSimulatedPrefix = "sim:";

[[nodiscard]] std::vector<std::string> stock_scene_names();
/// `spec` is "wall:noise_mm=1", with or without "sim:" before it.
[[nodiscard]] Result<StockScene> stock_scene(const std::string& spec);
/// The same camera before other models: from above at 45 degrees, as far away as the sphere around them fills
/// the image. `spec` is ":width=320:noise_mm=1", or empty.
[[nodiscard]] Result<StockScene> camera_before(render::SceneInput scene, const std::string& spec);

/// Pose of a camera at `eye_mm` that looks at `target_mm`, with `up` upwards in its image.
[[nodiscard]] geometry::RigidTransform look_at(const Vec3& eye_mm, const Vec3& target_mm, const Vec3& up);

}  // namespace palpate::stream
