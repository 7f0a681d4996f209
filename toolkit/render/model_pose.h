// A model's pose and local coordinates: model frame, relative to an origin near its points, so a model far
// from the world's origin keeps full precision.
#pragma once

#include <memory>

#include <palpate/geometry.h>
#include <palpate/motion.h>
#include <palpate/renderer.h>

namespace palpate::render {

/// Belongs to one thread. A model at the identity costs no transform.
struct ModelPose {
  Vec3 origin_mm = Vec3::Zero();  ///< origin of the local coordinates, model frame
  geometry::RigidTransform world_from_model;
  geometry::RigidTransform model_from_world;
  bool moved = false;                   ///< world_from_model is not the identity
  std::shared_ptr<MovingModel> motion;  ///< or null: at rest

  ModelPose() = default;
  ModelPose(const ModelInput& input, const Vec3& origin)
      : origin_mm(origin),
        world_from_model(input.world_from_model),
        model_from_world(input.world_from_model.inverse()),
        moved(!input.world_from_model.is_identity()),
        motion(input.motion) {}

  /// Takes the current pose. Frames transform the HIP into the model's frame (section 3.3.1), so a model that
  /// moves onto a resting HIP meets it. Wait-free.
  void take(double now_s) noexcept {
    if (motion != nullptr) take_from(*motion, now_s);
  }
  // Inlined: a call or a select would pass each vector through memory in halves and stall the full-width
  // load.
  [[nodiscard, gnu::always_inline]] Vec3 to_local(const Vec3& world_mm) const noexcept {
    Vec3 at = world_mm;
    if (moved) [[unlikely]]
      at = model_from_world * world_mm;
    return at - origin_mm;
  }
  [[nodiscard, gnu::always_inline]] Vec3 to_world(const Vec3& local_mm) const noexcept {
    Vec3 at = local_mm + origin_mm;
    if (moved) [[unlikely]]
      at = world_from_model * at;
    return at;
  }
  [[nodiscard, gnu::always_inline]] Vec3 direction_to_world(const Vec3& v) const noexcept {
    Vec3 to = v;
    if (moved) [[unlikely]]
      to = world_from_model.rotate(v);
    return to;
  }
  [[nodiscard, gnu::always_inline]] Vec3 direction_to_local(const Vec3& v) const noexcept {
    Vec3 to = v;
    if (moved) [[unlikely]]
      to = model_from_world.rotate(v);
    return to;
  }

 private:
  // Not inlined: it would cost registers in frames of resting models.
  [[gnu::noinline]] void take_from(MovingModel& moving, double now_s) noexcept {
    world_from_model = moving.newest().at(now_s);
    model_from_world = world_from_model.inverse();
    moved = true;
  }
};

}  // namespace palpate::render
