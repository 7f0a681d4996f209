// Measurements of one renderer in the loop.
#pragma once

#include "experiments/stability/bench.h"
#include "experiments/stability/stability.h"

namespace palpate::experiments {

using RunDone = std::function<void()>;

/// The largest stiffness that rests under the hand of `point`, like every smaller one tried. Tries upwards in
/// steps of a half, then bisects to 3 %. Fills the point. `unit` renders 1 N/mm; `control` encloses it.
/// Error: an invalid bench.
[[nodiscard]] Status find_largest_stable(render::HapticRenderer& unit, double unit_n_per_mm,
                                         const control::ControlOptions& control, Bench bench,
                                         const Places& places, StabilityPoint& point, const RunDone& done);

/// Runs every task with the renderer and with the truth.
[[nodiscard]] Result<std::vector<TaskResult>> do_tasks(render::HapticRenderer& renderer, const Stage& stage,
                                                       const Bench& bench, const Places& places,
                                                       const RunDone& done);

/// Scores along the stage's path.
[[nodiscard]] Result<LoopScores> score_loop(render::HapticRenderer& renderer, const Stage& stage,
                                            const Bench& bench, const Places& places, Progress& progress,
                                            const RunDone& done);

/// Stiffness of the scene's model, N/mm.
[[nodiscard]] double scene_stiffness(const Stage& stage);

}  // namespace palpate::experiments
