#include "toolkit/render/heightfield_model.h"

#include <fmt/format.h>

#include <cmath>

#include "toolkit/core/clock.h"

namespace palpate::render {

Result<HeightFieldModel> build_height_field_model(const SceneInput& scene, const PrepareContext& context,
                                                  PrepareReport& report) {
  const Stopwatch watch;
  if (scene.models.size() != 1)
    return Error{
        fmt::format("the height-field renderers take one model, the scene has {}", scene.models.size()),
        "keep one [[model]] in the scene",
        {},
        0};
  const ModelInput& input = scene.models.front();
  if (!(input.surface.stiffness_n_per_mm > 0.0) || !std::isfinite(input.surface.stiffness_n_per_mm))
    return Error{"the stiffness must be a positive number", "set stiffness_n_per_mm", {}, 0};
  Result<cloud::HeightField> field = cloud::height_field_of(*input.cloud);
  if (!field) return std::move(field).error();
  HeightFieldModel model;
  model.field = std::move(*field);
  model.world_from_model = input.world_from_model;
  model.model_from_world = input.world_from_model.inverse();
  model.moved = !input.world_from_model.is_identity();
  model.stiffness_n_per_mm = input.surface.stiffness_n_per_mm;
  report.phases.push_back({"grid", watch.ms()});
  report.total_ms = report.phases.back().ms;
  report.bytes = model.field.bytes();
  report.notes.push_back(
      fmt::format("{} x {} posts, {:.6g} x {:.6g} mm apart, resolution {:.6g} mm seen from above; {} holes",
                  model.field.columns, model.field.rows, model.field.step_x_mm, model.field.step_y_mm,
                  model.field.plan_resolution_mm(), model.field.holes));
  if (context.progress != nullptr) context.progress->report("grid", 1.0);
  return model;
}

}  // namespace palpate::render
