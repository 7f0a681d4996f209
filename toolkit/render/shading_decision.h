// Whether and how forces are shaded over three points: what the choice `auto` of shading_spec() means.
#pragma once

#include <string>

#include "toolkit/render/decision.h"
#include "toolkit/render/shading.h"

namespace palpate::render {

struct ShadingDecision {
  Shading shading = Shading::kNone;
  bool by_spacing = false;       ///< only where the next point is farther off than felt_spacing_mm
  double felt_spacing_mm = 0.0;  ///< a change of point over it is felt: kFeltForceStepN / stiffness
  Decision said;
};

/// Ours. Each change of point moves the force by stiffness x spacing: shaded by the facet where that is felt,
/// and not at all, frame and bytes spared, where no spacing is so large. `largest_spacing_mm`: of immediate
/// neighbours as they will be walked; `stretches`: points give way, which makes it larger.
[[nodiscard]] ShadingDecision decide_shading(const std::string& choice, double largest_stiffness_n_per_mm,
                                             double largest_spacing_mm, bool stretches);

/// As printed (section 3.4): by area above a resolution of 0.2 mm.
[[nodiscard]] ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm);

}  // namespace palpate::render
