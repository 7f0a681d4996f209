// One function a step. Each may throw: register_cleaning() wraps them with the border that catches.
#pragma once

#include "toolkit/scene/cleaning.h"

namespace palpate::baselines {

using StepFunction = Result<scene::StepOutput>(const scene::StepInput& input);

StepFunction remove_outliers;
StepFunction smooth;
StepFunction thin;
StepFunction upsample;
StepFunction fill_holes;

/// Outward unit normals, or zero where none could be found: those that `cloud` itself works with.
[[nodiscard]] std::vector<Vec3> plane_normals(const scene::StepInput& input);

/// An Error where the cloud has fewer than `needed` points.
[[nodiscard]] Status enough_points(const scene::StepInput& input, std::size_t needed);

/// What CGAL calls while it works: shows progress, stops it where the user asked to. Not a std::function: of
/// those CGAL 5.5 keeps a reference to a copy that is gone; of anything else it makes one of its own.
struct Advance {
  Progress* progress;
  const char* what;
  bool operator()(double fraction) const {
    progress->report(what, fraction);
    return !progress->cancelled();
  }
};

}  // namespace palpate::baselines
