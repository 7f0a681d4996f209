// What a height-field renderer builds of a cloud: decided once from the cloud's lattice and its holes.
// build_height_field_model() follows it and decides nothing; `palpate plan` stops there.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/cloud/height_field_holes.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

struct HeightFieldBuild {
  bool fills_gaps = false;         ///< posts without a point get a height where they are gaps
  bool open_given = false;         ///< they stay open because somebody said so
  double blend_resolutions = 0.0;  ///< above 0 a stiffness that varies is blended over as many
};

/// Of the lattice alone, which renderers of one model share.
struct LatticeDecision {
  std::uint32_t columns = 0, rows = 0;
  double step_x_mm = 0.0, step_y_mm = 0.0;
  double plan_resolution_mm = 0.0;
  std::size_t missing = 0;  ///< posts without a point,
  std::size_t filled = 0;   ///< of which so many get a height
  std::string words;        ///< as `info` says it
  [[nodiscard]] std::size_t posts() const noexcept { return std::size_t{columns} * rows; }
};

/// What was found on the way to the decision.
struct LatticeSurvey {
  LatticeDecision decision;
  cloud::HeightField field;  ///< its gaps not yet filled
  cloud::Holes holes;
  std::vector<std::uint32_t> point_of_post;  ///< where asked for
};

/// Finds the lattice and its holes and decides. Errors: those of height_field_of().
[[nodiscard]] Result<LatticeSurvey> survey_lattice(const cloud::Cloud& cloud, bool fills_gaps,
                                                   bool keeps_points);

/// Lattice and surface of one model.
struct HeightFieldDecision {
  LatticeDecision lattice;
  SurfaceDecision surface;
};
/// What build_height_field_model() will follow: survey_lattice() and decide_surface().
[[nodiscard]] Result<HeightFieldDecision> decide_heights(const ModelInput& input,
                                                         const HeightFieldBuild& build);

/// The decisions in words, but for shading, and the bytes. `felt`: see say_surface().
void say_heights(const ModelInput& input, const HeightFieldBuild& build, const HeightFieldDecision& decision,
                 Features felt, ModelDecisions& out);

}  // namespace palpate::render
