// When the forms as printed shade: section 3.4's rule.
#pragma once

#include <string>

#include "toolkit/core/tolerances.h"
#include "toolkit/render/renderer.h"
#include "toolkit/render/shading.h"

namespace palpate::render {

/// The shading that a choice of shading_spec() means for a model as printed: auto shades by area above a
/// resolution of 0.2 mm, and says so.
[[nodiscard]] inline Shading literal_shading(const std::string& choice, double resolution_mm,
                                             PrepareReport& report) {
  if (choice != "auto") return parse_shading(choice);
  const bool shade = resolution_mm > kLiteralShadingResolutionMm;
  report.notes.push_back(shade ? "shading: area-raw, the resolution is above 0.2 mm"
                               : "shading: none, the resolution is at most 0.2 mm");
  return shade ? Shading::kAreaRaw : Shading::kNone;
}

}  // namespace palpate::render
