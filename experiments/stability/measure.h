// What is measured of one renderer in the loop.
#pragma once

#include "experiments/stability/bench.h"
#include "experiments/stability/stability.h"

namespace palpate::experiments {

/// Called after every run.
using RunDone = std::function<void()>;

/// The largest stiffness that rests under the hand of `point` (and every smaller one that was tried): tried
/// upwards in steps of a half, then halved to 3 %. Fills the point. `unit` answers 1 N/mm; `control` is put
/// around it. An Error is a bench that is not right.
[[nodiscard]] Status find_largest_stable(render::HapticRenderer& unit, double unit_n_per_mm,
                                         const control::ControlOptions& control, Bench bench,
                                         const Places& places, StabilityPoint& point, const RunDone& done);

/// Every task with the renderer and with the truth.
[[nodiscard]] Result<std::vector<TaskResult>> do_tasks(render::HapticRenderer& renderer, const Stage& stage,
                                                       const Bench& bench, const Places& places,
                                                       const RunDone& done);

/// Along the stage's path.
[[nodiscard]] Result<LoopScores> score_loop(render::HapticRenderer& renderer, const Stage& stage,
                                            const Bench& bench, const Places& places, Progress& progress,
                                            const RunDone& done);

/// What a model of the scene is felt with, N/mm.
[[nodiscard]] double scene_stiffness(const Stage& stage);

}  // namespace palpate::experiments
