#include "toolkit/heightfield/heightfield_model.h"

#include <fmt/format.h>

#include <utility>

namespace palpate::render {

Result<LatticeSurvey> survey_lattice(const cloud::Cloud& cloud, bool fills_gaps, bool keeps_points) {
  LatticeSurvey found;
  Result<cloud::HeightField> field =
      cloud::height_field_of(cloud, keeps_points ? &found.point_of_post : nullptr);
  if (!field) return std::move(field).error();
  found.field = *std::move(field);
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
  Result<LatticeSurvey> survey = survey_lattice(*input.cloud, build.fills_gaps, false);
  if (!survey) return std::move(survey).error();
  Result<SurfaceDecision> surface = decide_surface(input);
  if (!surface) return std::move(surface).error();
  return HeightFieldDecision{std::move(survey->decision), *std::move(surface)};
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

}  // namespace palpate::render
