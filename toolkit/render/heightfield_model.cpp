#include "toolkit/render/heightfield_model.h"

#include <fmt/format.h>

#include <array>
#include <numeric>
#include <vector>

#include "toolkit/render/prepare_phases.h"

namespace palpate::render {
namespace {

/// The eight posts around each, itself beyond the border, and where the posts stand.
void blend(HeightFieldModel& model, double blend_mm, PrepareReport& report) {
  const cloud::HeightField& field = model.field;
  std::vector<surface::SurfacePoint> points(field.posts());
  std::vector<neighbourhood::Neighbours> around(field.posts());
  const auto columns = static_cast<std::int64_t>(field.columns), rows = static_cast<std::int64_t>(field.rows);
  for (std::int64_t row = 0; row < rows; ++row)
    for (std::int64_t column = 0; column < columns; ++column) {
      const auto place = static_cast<std::size_t>(row * columns + column);
      points[place] = {static_cast<float>(static_cast<double>(column) * field.step_x_mm),
                       static_cast<float>(static_cast<double>(row) * field.step_y_mm), field.height_mm[place],
                       surface::kNoNormal};
      std::size_t k = 0;
      for (std::int64_t dy = -1; dy <= 1; ++dy)
        for (std::int64_t dx = -1; dx <= 1; ++dx) {
          if (dx == 0 && dy == 0) continue;
          const bool inside = column + dx >= 0 && column + dx < columns && row + dy >= 0 && row + dy < rows;
          around[place][k++] = static_cast<std::uint32_t>(inside ? (row + dy) * columns + column + dx
                                                                 : row * columns + column);
        }
    }
  const std::size_t softer = blend_stiffness(model.surface, points, around, blend_mm);
  report.notes.push_back(
      fmt::format("stiffness blended over {:.3g} mm: {} posts made softer", blend_mm, softer));
}

/// The surface of the model, its points' values moved to their posts.
Status prepare_surface(const ModelInput& input, const std::vector<std::uint32_t>& point_of_post,
                       HeightFieldModel& model, PrepareReport& report) {
  std::vector<std::uint32_t> order(input.cloud->size());
  std::iota(order.begin(), order.end(), 0u);
  Result<SurfaceField> built = build_surface_field(input, order, report);
  if (!built) return std::move(built).error();
  model.surface = *std::move(built);
  if (model.surface.of_place.empty()) return Done{};
  LargeVector<PlaceSurface> of_post(point_of_post.size());
  for (std::size_t post = 0; post < of_post.size(); ++post)
    if (point_of_post[post] != cloud::kNoPoint)
      of_post[post] = model.surface.of_place[point_of_post[post]];
    else
      of_post[post] = {static_cast<float>(model.surface.largest_stiffness_n_per_mm), 0.0f, 0.0f};
  model.surface.of_place = std::move(of_post);
  return Done{};
}

}  // namespace

Result<HeightFieldModel> build_height_field_model(const SceneInput& scene, double blend_resolutions,
                                                  const PrepareContext& context, PrepareReport& report) {
  PreparePhases phases(report, context);
  phases.begin("grid");
  const Result<const ModelInput*> only = only_model(scene);
  if (!only) return only.error();
  const ModelInput& input = **only;
  const bool varies = input.surface.per_point != nullptr;
  std::vector<std::uint32_t> point_of_post;
  Result<cloud::HeightField> field = cloud::height_field_of(*input.cloud, varies ? &point_of_post : nullptr);
  if (!field) return std::move(field).error();
  HeightFieldModel model;
  model.field = std::move(*field);
  model.pose = ModelPose(input, model.field.origin_mm);
  if (const Status done = prepare_surface(input, point_of_post, model, report); !done) return done.error();
  if (blend_resolutions > 0.0 && (model.surface.features & kVaried) != 0)
    blend(model, blend_resolutions * model.field.plan_resolution_mm(), report);
  phases.end();
  report.bytes = model.field.bytes() + model.surface.bytes();
  report.notes.push_back(
      fmt::format("{} x {} posts, {:.6g} x {:.6g} mm apart, resolution {:.6g} mm seen from above; {} holes",
                  model.field.columns, model.field.rows, model.field.step_x_mm, model.field.step_y_mm,
                  model.field.plan_resolution_mm(), model.field.holes));
  return model;
}

}  // namespace palpate::render
