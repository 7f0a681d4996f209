// What a simulated camera sees: rays into a scene whose models are known by formula or by faces, at any time.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/geometry/triangle_meshes.h"

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

}  // namespace palpate::stream
