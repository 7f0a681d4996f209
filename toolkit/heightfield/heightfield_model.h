// The preparation shared by both height-field renderers: a regular grid with a pose.
#pragma once

#include <palpate/geometry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/cloud/height_field.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::heightfield {

struct HeightFieldOptions {
  bool fills_gaps = false;            ///< fills gaps: gives their posts heights
  bool holes_kept_by_option = false;  ///< an option keeps holes open
  double blend_resolutions = 0.0;     ///< above 0: blends a varying stiffness over this many resolutions
};

/// Decisions on the lattice, shared by a model's renderers.
struct LatticeDecision {
  std::uint32_t columns = 0, rows = 0;
  double step_x_mm = 0.0, step_y_mm = 0.0;
  double plan_resolution_mm = 0.0;
  std::size_t missing = 0;  ///< posts without a point,
  std::size_t filled = 0;   ///< of these, posts that get a height
  std::string words;        ///< in the words of `info`
  [[nodiscard]] std::size_t posts() const noexcept { return std::size_t{columns} * rows; }
};

/// Findings before the decision.
struct LatticeSurvey {
  LatticeDecision decision;
  cloud::HeightField field;  ///< gaps not yet filled
  cloud::Holes holes;
  std::vector<std::uint32_t> point_of_post;  ///< if requested
};

/// Finds the lattice and its holes, and decides. Errors: those of height_field_of().
[[nodiscard]] Result<LatticeSurvey> survey_lattice(const cloud::Cloud& cloud, bool fills_gaps,
                                                   bool keeps_points);

/// Lattice and surface of one model.
struct HeightFieldDecision {
  LatticeDecision lattice;
  render::SurfaceDecision surface;
};
/// The decisions that build_height_field_model() follows: survey_lattice() and decide_surface().
[[nodiscard]] Result<HeightFieldDecision> decide_heightfield(const render::ModelInput& input,
                                                             const HeightFieldOptions& build);

/// Describes the decisions (except shading) and the bytes. `felt`: see describe_surface().
void describe_heightfield(const render::ModelInput& input, const HeightFieldOptions& build,
                          const HeightFieldDecision& decision, render::Features felt,
                          render::ModelDecisions& out);

/// The grid that frames read. Immutable and shared.
struct HeightFieldGrid {
  cloud::HeightField field;
  geometry::Aabb box_mm;                     ///< of the posts, local
  std::vector<std::uint32_t> point_of_post;  ///< if properties vary per point; else empty
  LatticeDecision decision;                  ///< the decision followed
};

/// One model of one renderer.
struct HeightFieldModel {
  std::shared_ptr<const HeightFieldGrid> grid;
  render::ModelPose pose;
  render::SurfaceField surface;  ///< places are posts

  [[nodiscard]] HeightFieldDecision decided() const { return {grid->decision, surface}; }
  [[nodiscard]] const cloud::HeightField& field() const noexcept { return grid->field; }
};

/// Prepares one model; takes the grid from the context's store if it has one. Errors: no stiffness, a cloud
/// that is no regular height field. Phases, notes and bytes go to `report`.
[[nodiscard]] Result<HeightFieldModel> build_height_field_model(const render::ModelInput& input,
                                                                const HeightFieldOptions& build,
                                                                const render::PrepareContext& context,
                                                                render::PrepareReport& report);

}  // namespace palpate::heightfield
