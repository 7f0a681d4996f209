// The cleaning steps, one function each. They may throw; register_cleaning() catches.
#pragma once

#include <palpate/scene.h>

namespace palpate::baselines {

using StepFunction = Result<scene::CleaningStepOutput>(const scene::CleaningStepInput& input);

StepFunction remove_outliers;
StepFunction smooth;
StepFunction thin;
StepFunction upsample;
StepFunction fill_holes;

/// Outward unit normals as used by `cloud`; zero if none was found.
[[nodiscard]] std::vector<Vec3> plane_normals(const scene::CleaningStepInput& input);

/// An Error if the cloud has fewer than `needed` points.
[[nodiscard]] Status enough_points(const scene::CleaningStepInput& input, std::size_t needed);

/// Callback for CGAL: shows progress, cancels on request. It is no std::function: CGAL 5.5 keeps a reference
/// to a dead copy of it.
struct Advance {
  Progress* progress;
  const char* what;
  bool operator()(double fraction) const {
    progress->report(what, fraction);
    return !progress->cancelled();
  }
};

}  // namespace palpate::baselines
