// What both height-field renderers prepare: a model as a regular grid, and its pose.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "toolkit/cloud/height_field.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/aabb.h"
#include "toolkit/heightfield/heightfield_decision.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

/// The grid that frames read. Immutable and shared.
struct HeightFieldGrid {
  cloud::HeightField field;
  geometry::Aabb box_mm;  ///< of the posts, local
  std::vector<std::uint32_t>
      point_of_post;         ///< where the cloud's points differ in their properties; else empty
  LatticeDecision decision;  ///< what was followed
};

/// One model as one renderer holds it.
struct HeightFieldModel {
  std::shared_ptr<const HeightFieldGrid> grid;
  ModelPose pose;
  SurfaceField surface;  ///< places are posts

  [[nodiscard]] HeightFieldDecision decided() const { return {grid->decision, surface}; }
  [[nodiscard]] const cloud::HeightField& field() const noexcept { return grid->field; }
};

/// Prepares one model of a scene; its grid comes from the context's store where it has one. Errors: no
/// stiffness, a cloud that is no height field on a regular grid. Phases, notes and bytes go to `report`.
[[nodiscard]] Result<HeightFieldModel> build_height_field_model(const ModelInput& input,
                                                                const HeightFieldBuild& build,
                                                                const PrepareContext& context,
                                                                PrepareReport& report);

}  // namespace palpate::render
