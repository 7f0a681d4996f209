// The whole of `palpate ablate`: a scene with each of its stages left out in turn, what that saves and what
// it costs.
#pragma once

#include "experiments/session/study_run.h"

namespace palpate::experiments {

/// Of the path where none is named, as in sweeps: some thousand frames of contact.
inline constexpr int kAblateFrames = 6'000;
/// A scan of a million points is prepared and stepped under valgrind in some 30 s a stage.
inline constexpr double kCountBudgetS = 300.0;
inline constexpr std::uint64_t kAblatePasses = 5;

struct AblateArguments {
  RunArguments run;  ///< of it: scene, one renderer, path, truth, folder, surface, model, json
  double budget_s = kCountBudgetS;
  bool marked = false;  ///< steps the frames between callgrind's marks, and nothing else
};

/// The exit status.
int run_ablate(const AblateArguments& arguments, Context& context);

}  // namespace palpate::experiments
