// What both height-field renderers prepare: the only model of a scene as a regular grid, and its pose.
#pragma once

#include "toolkit/cloud/height_field.h"
#include "toolkit/core/result.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

/// Ready for frames. Immutable after build.
struct HeightFieldModel {
  cloud::HeightField field;
  ModelPose pose;
  SurfaceField surface;  ///< places are posts
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
