// What both height-field renderers prepare: the only model of a scene as a regular grid, and its pose.
#pragma once

#include "toolkit/cloud/height_field.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

/// Ready for frames. Immutable after build.
struct HeightFieldModel {
  cloud::HeightField field;
  geometry::RigidTransform world_from_model;
  geometry::RigidTransform model_from_world;
  bool moved = false;    ///< world_from_model is not the identity
  SurfaceField surface;  ///< places are posts

  std::shared_ptr<MovingModel> motion;  ///< or null: at rest

  /// Section 3.3.1: the HIP is taken into the model's frame of this instant.
  void move_to(double now_s) noexcept {
    world_from_model = motion->newest().at(now_s);
    model_from_world = world_from_model.inverse();
    moved = true;
  }
  [[nodiscard]] Vec3 to_local(const Vec3& world_mm) const noexcept {
    return (moved ? model_from_world * world_mm : world_mm) - field.origin_mm;
  }
  [[nodiscard]] Vec3 to_world(const Vec3& local_mm) const noexcept {
    const Vec3 in_model = local_mm + field.origin_mm;
    return moved ? world_from_model * in_model : in_model;
  }
  [[nodiscard]] Vec3 direction_to_world(const Vec3& v) const noexcept {
    return moved ? world_from_model.rotate(v) : v;
  }
};

/// `limited`, without a root where nothing is limited.
[[nodiscard]] inline Vec3 limited_fast(const Vec3& force_n, double limit_n) noexcept {
  return force_n.squaredNorm() <= limit_n * limit_n ? force_n : limited(force_n, limit_n);
}

/// Prepares the only model of a scene. With `blend_resolutions` above 0 a stiffness that varies is blended
/// over as many resolutions (blend_stiffness). Errors: several models, no stiffness, a cloud that is no
/// height field on a regular grid. Phases, notes and bytes go to `report`.
[[nodiscard]] Result<HeightFieldModel> build_height_field_model(const SceneInput& scene,
                                                                double blend_resolutions,
                                                                const PrepareContext& context,
                                                                PrepareReport& report);

}  // namespace palpate::render
