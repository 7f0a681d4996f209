#include "toolkit/heightfield/heightfield_model.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <palpate/model_store.h>
#include <palpate/result.h>
#include "toolkit/cloud/height_field.h"
#include "toolkit/render/prepare.h"

namespace palpate::heightfield {

using namespace render;

namespace {

/// The eight posts around each (itself beyond the border), and the posts' places.
void blend(HeightFieldModel& model, double blend_mm, PrepareReport& report) {
  const cloud::HeightField& field = model.field();
  std::vector<surface::OrientedPoint> points(field.posts());
  std::vector<search::Neighbours> around(field.posts());
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

/// The model's surface, point values moved to posts.
Status prepare_surface(const ModelInput& input, HeightFieldModel& model, PrepareReport& report) {
  const std::vector<std::uint32_t>& point_of_post = model.grid->point_of_post;
  std::vector<std::uint32_t> order(input.cloud->size());
  std::iota(order.begin(), order.end(), 0u);
  PALPATE_ASSIGN(model.surface, build_surface_field(input, order, report));
  if (model.surface.by_point.empty()) return Done{};
  LargePageVector<PointSurface> of_post(point_of_post.size());
  for (std::size_t post = 0; post < of_post.size(); ++post)
    if (point_of_post[post] != cloud::kNoPoint)
      of_post[post] = model.surface.by_point[point_of_post[post]];
    else
      of_post[post] = {static_cast<float>(model.surface.largest_stiffness_n_per_mm), 0.0f, 0.0f};
  model.surface.by_point = std::move(of_post);
  return Done{};
}

/// The lowest and highest post with a height.
std::pair<double, double> heights_of(const cloud::HeightField& field) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const float height : field.height_mm) {
    if (std::isnan(height)) continue;
    low = std::min(low, static_cast<double>(height));
    high = std::max(high, static_cast<double>(height));
  }
  return {low, high};
}

/// Warns of holes that let the HIP through the middle of the data.
void warn_of_open_holes(const cloud::Holes& holes, bool fills_gaps, PreparePhases& phases) {
  const std::size_t open = holes.voids + (fills_gaps ? 0 : holes.gaps);
  if (open == 0) return;
  phases.warn(fmt::format(
      "Nothing is felt over {} posts without a point inside the data: the HIP goes through there.{}", open,
      fills_gaps || holes.gaps == 0
          ? ""
          : fmt::format(" heightfield fills {} of them (holes=fill).", holes.gaps)));
}

Result<std::shared_ptr<const HeightFieldGrid>> build_grid(const cloud::Cloud& cloud, bool fills_gaps,
                                                          bool keeps_points, const PrepareContext& context,
                                                          PrepareReport& report) {
  PreparePhases phases(report, context);
  phases.begin("grid");
  PALPATE_ASSIGN(LatticeSurvey survey, survey_lattice(cloud, fills_gaps, keeps_points));
  auto grid = std::make_shared<HeightFieldGrid>();
  grid->decision = std::move(survey.decision);
  grid->field = std::move(survey.field);
  grid->point_of_post = std::move(survey.point_of_post);
  if (grid->decision.filled > 0) {
    phases.end();
    phases.begin("gaps");
    cloud::fill_gaps(grid->field, survey.holes, keeps_points ? &grid->point_of_post : nullptr,
                     context.threads);
  }
  grid->box_mm.add(Vec3::Zero());
  grid->box_mm.add(Vec3(static_cast<double>(grid->field.columns - 1) * grid->field.step_x_mm,
                        static_cast<double>(grid->field.rows - 1) * grid->field.step_y_mm, 0.0));
  const auto [low, high] = heights_of(grid->field);
  grid->box_mm.low_mm.z() = low;
  grid->box_mm.high_mm.z() = high;
  phases.end();
  warn_of_open_holes(survey.holes, fills_gaps, phases);
  report.bytes += grid->field.bytes() + grid->point_of_post.capacity() * sizeof(std::uint32_t);
  phases.note(fmt::format("{}; {:.6g} x {:.6g} mm apart, resolution {:.6g} mm seen from above",
                          grid->decision.words, grid->field.step_x_mm, grid->field.step_y_mm,
                          grid->field.plan_resolution_mm()));
  return std::shared_ptr<const HeightFieldGrid>(std::move(grid));
}

}  // namespace

Result<HeightFieldModel> build_height_field_model(const ModelInput& input, const HeightFieldOptions& build,
                                                  const PrepareContext& context, PrepareReport& report) {
  const cloud::Cloud& cloud = *input.cloud;
  const bool varied = varies(input.surface);
  HeightFieldModel model;
  PALPATE_ASSIGN(
      model.grid,
      get_or_build<HeightFieldGrid>(
          context, report,
          [&] {
            return fmt::format("height field {:016x} {} {} {}", cloud::content_hash(cloud), cloud.size(),
                               build.fills_gaps, varied);
          },
          [&](PrepareReport& to) { return build_grid(cloud, build.fills_gaps, varied, context, to); }));
  model.pose = ModelPose(input, model.field().origin_mm);
  PALPATE_TRY(prepare_surface(input, model, report));
  if (build.blend_resolutions > 0.0 && (model.surface.features & kVaried) != 0)
    blend(model, build.blend_resolutions * model.field().plan_resolution_mm(), report);
  report.bytes += model.surface.bytes();
  return model;
}

Result<LatticeSurvey> survey_lattice(const cloud::Cloud& cloud, bool fills_gaps, bool keeps_points) {
  LatticeSurvey found;
  PALPATE_ASSIGN(found.field, cloud::height_field_of(cloud, keeps_points ? &found.point_of_post : nullptr));
  found.holes = cloud::find_holes(found.field);
  LatticeDecision& decided = found.decision;
  decided.columns = found.field.columns;
  decided.rows = found.field.rows;
  decided.step_x_mm = found.field.step_x_mm;
  decided.step_y_mm = found.field.step_y_mm;
  decided.plan_resolution_mm = found.field.plan_resolution_mm();
  decided.missing = found.holes.missing;
  decided.filled = fills_gaps ? found.holes.gaps : 0;
  decided.words = cloud::describe(found.field, found.holes, fills_gaps);
  return found;
}

Result<HeightFieldDecision> decide_heightfield(const ModelInput& input, const HeightFieldOptions& build) {
  PALPATE_ASSIGN(LatticeSurvey survey, survey_lattice(*input.cloud, build.fills_gaps, false));
  PALPATE_ASSIGN(SurfaceDecision surface, decide_surface(input));
  return HeightFieldDecision{std::move(survey.decision), std::move(surface)};
}

void describe_heightfield(const ModelInput& input, const HeightFieldOptions& build,
                          const HeightFieldDecision& decision, Features felt, ModelDecisions& out) {
  const LatticeDecision& lattice = decision.lattice;
  out.name = input.name;
  out.points = input.cloud->size();
  out.spacing_mm = lattice.plan_resolution_mm;
  const std::size_t open = lattice.missing - lattice.filled;
  out.decisions.push_back({"lattice", fmt::format("{} x {} posts", lattice.columns, lattice.rows),
                           fmt::format("{:.3g} x {:.3g} mm apart: {} bytes a post and nothing to look up",
                                       lattice.step_x_mm, lattice.step_y_mm, sizeof(float))});
  out.decisions.push_back({"holes",
                           lattice.missing == 0 ? "none"
                           : open == 0          ? "filled"
                                                : fmt::format("open, {} posts", open),
                           "it is " + lattice.words, build.holes_kept_by_option});
  out.decisions.push_back(
      {"neighbours", "none stored", "the neighbours of a post are known from its column and row"});
  out.bytes +=
      (lattice.posts() + cloud::HeightField::blocks_of(lattice.columns, lattice.rows)) * sizeof(float);
  if (varies(input.surface)) out.bytes += lattice.posts() * sizeof(std::uint32_t);
  describe_surface(input, decision.surface, felt, lattice.posts(), out);
  if (input.motion != nullptr)
    out.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
}

}  // namespace palpate::heightfield
