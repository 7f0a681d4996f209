#include "toolkit/render/shading_decision.h"

#include <fmt/format.h>

#include "toolkit/core/tolerances.h"

namespace palpate::render {
namespace {

constexpr const char* kAbout = "shading";
constexpr const char* kAuto = "auto";

ShadingDecision given(const std::string& choice) {
  ShadingDecision decided;
  decided.shading = parse_shading(choice);
  decided.said = {kAbout, choice, "as given", true};
  return decided;
}

}  // namespace

ShadingDecision decide_shading(const std::string& choice, double largest_stiffness_n_per_mm,
                               double largest_spacing_mm, bool stretches) {
  if (choice != kAuto) return given(choice);
  ShadingDecision decided;
  const double step_n = largest_stiffness_n_per_mm * largest_spacing_mm;
  const bool felt = step_n > kFeltForceStepN;
  decided.by_spacing = felt || stretches;
  decided.felt_spacing_mm = kFeltForceStepN / largest_stiffness_n_per_mm;
  if (!decided.by_spacing) {
    decided.said = {
        kAbout, "none",
        fmt::format("a change of point moves the force by at most {:.3g} N/mm x {:.3g} mm = {:.3g} "
                    "N, and {} N is felt",
                    largest_stiffness_n_per_mm, largest_spacing_mm, step_n, kFeltForceStepN)};
    return decided;
  }
  decided.shading = Shading::kFacet;
  decided.said = {
      kAbout, "facet, where a point's spacing asks for it",
      fmt::format("a change of point moves the force by up to {:.3g} N/mm x {:.3g} mm = {:.3g} N, "
                  "and {} N is felt{}",
                  largest_stiffness_n_per_mm, largest_spacing_mm, step_n, kFeltForceStepN,
                  felt ? "" : "; the points give way, and stretching moves them apart")};
  return decided;
}

ShadingDecision decide_literal_shading(const std::string& choice, double resolution_mm) {
  if (choice != kAuto) return given(choice);
  ShadingDecision decided;
  const bool shade = resolution_mm > kLiteralShadingResolutionMm;
  if (shade) decided.shading = Shading::kAreaRaw;
  decided.said = {kAbout, shade ? "area-raw" : "none",
                  fmt::format("the resolution, {:.3g} mm, is {} {} mm (section 3.4)", resolution_mm,
                              shade ? "above" : "at most", kLiteralShadingResolutionMm)};
  return decided;
}

}  // namespace palpate::render
