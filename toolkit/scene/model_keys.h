// The fields of a scene file's tables. Internal to scene.
#pragma once

#include <palpate/scene.h>
#include "toolkit/scene/toml_fields.h"

namespace palpate::scene {

/// 'position_mm' and 'rotation'.
[[nodiscard]] Fields pose_fields(geometry::RigidTransform& pose);
/// [[model.view]] and [[model.clean]]: where points come from beside the model's own file.
[[nodiscard]] Fields view_fields(SceneView& view);
[[nodiscard]] Field clean_field(SceneModel& model);

/// [model.surface], [[model.region]] and [model.motion].
[[nodiscard]] Fields surface_fields(SceneModel& model);
[[nodiscard]] Fields texture_fields(SceneModel& model);
[[nodiscard]] Fields dent_fields(surface::Dent& dent);
[[nodiscard]] Fields region_fields(SceneRegion& region);
[[nodiscard]] Fields motion_fields(SceneMotion& motion);
[[nodiscard]] Field surface_field(SceneModel& model);
[[nodiscard]] Field regions_field(SceneModel& model);
[[nodiscard]] Field motion_field(SceneModel& model);

}  // namespace palpate::scene
