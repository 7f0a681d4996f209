// `palpate compare ablate`: leaves out each stage of a scene in turn and measures savings and losses.
#pragma once

#include "experiments/session/study_run.h"

namespace palpate::experiments {

/// Default path length as in sweeps: some thousand contact frames.
inline constexpr int kAblateFrames = 6'000;
/// Preparing and stepping a million points under valgrind takes some 30 s a stage.
inline constexpr double kCountBudgetS = 300.0;
inline constexpr std::uint64_t kAblatePasses = 5;

struct AblateArguments {
  RunArguments run;  ///< scene, one renderer, path, truth, folder, surface, model, json
  double budget_s = kCountBudgetS;
  bool marked = false;  ///< only steps the frames between callgrind's marks
};

/// Returns the exit status.
[[nodiscard]] Result<int> run_ablate(const AblateArguments& arguments, Context& context);

}  // namespace palpate::experiments
