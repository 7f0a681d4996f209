#include "toolkit/render/shading.h"

#include <fmt/format.h>

#include "toolkit/core/tolerances.h"

namespace palpate::render {
namespace {

constexpr const char* kAbout = "shading";

}  // namespace

ShadingDecision given_shading(const std::string& choice) {
  return {parse_shading(choice), {kAbout, choice, "as given", true}};
}

ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm) {
  if (choice != "auto") return given_shading(choice);
  ShadingDecision decided;
  const bool shade = resolution_mm > kLiteralShadingResolutionMm;
  if (shade) decided.shading = Shading::kAreaRaw;
  decided.explanation = {kAbout, shade ? "area-raw" : "none",
                         fmt::format("the resolution, {:.3g} mm, is {} {} mm (section 3.4)", resolution_mm,
                                     shade ? "above" : "at most", kLiteralShadingResolutionMm)};
  return decided;
}

}  // namespace palpate::render
