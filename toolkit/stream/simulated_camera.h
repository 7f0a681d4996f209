// A simulated depth camera over scenes that are known exactly.
//
// A SimulatedScene answers rays into models that are known by formula or by faces, at any time. The camera
// has the errors of a real one, all from one seed. Frames come as fast as they are asked for; their times say
// when they would have come.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/stream/stock_scene.h"

namespace palpate::stream {

/// First thing that a ray meets.
struct SceneHit {
  double along = 0.0;           ///< multiples of the ray's direction
  Vec3 normal = Vec3::UnitZ();  ///< world, unit, back along the ray
};

class SimulatedScene {
 public:
  /// Takes over the scene's motions: they have one reader, so that renderers need a SceneInput of their own.
  /// An Error where a model has neither formula nor faces. O(faces log faces).
  [[nodiscard]] static Result<std::unique_ptr<SimulatedScene>> make(render::SceneInput scene);

  /// Moves the models to where they are at `t_s`, also back. No ray may be under way.
  void go_to(double t_s) noexcept;

  /// First surface that the ray enters from outside, or nothing within the scene. An open surface ends where
  /// its model's box does, seen from the origin. Concurrent rays are safe.
  [[nodiscard]] std::optional<SceneHit> first_hit(const Vec3& origin_mm,
                                                  const Vec3& direction) const noexcept;

 private:
  struct Model {
    geometry::Aabb box_mm;
    geometry::RigidTransform world_from_model, model_from_world;
    std::unique_ptr<geometry::MeshRayCaster> faces;  ///< null: by formula
  };
  explicit SimulatedScene(render::SceneInput scene) : scene_(std::move(scene)) {}

  render::SceneInput scene_;
  std::vector<Model> models_;
  double now_s_ = 0.0;
};

/// Where the camera is at a time.
using CameraPath = std::function<geometry::RigidTransform(double t_s)>;

/// The path, where the camera is within no model. Frames are the same for any number of threads.
[[nodiscard]] std::unique_ptr<DepthSource> make_simulated_camera(std::unique_ptr<SimulatedScene> scene,
                                                                 const DepthCamera& camera, CameraPath path,
                                                                 const SimulatedSensor& simulated,
                                                                 std::string name, int threads = 0);

/// The camera of a stock scene, at rest.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> simulated_camera_of(StockScene stock, std::string name);
/// A stock scene with its options, as "wall:noise_mm=1".
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_simulated_camera(const std::string& spec);

}  // namespace palpate::stream
