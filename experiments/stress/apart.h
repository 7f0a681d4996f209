// Cells run in another process, within limits of time and memory: what crashes or hangs there is a red cell
// here.
#pragma once

#include <functional>
#include <vector>

#include "experiments/stress/cell.h"
#include "toolkit/core/progress.h"

namespace palpate::experiments {

struct CellLimits {
  double seconds = 60.0;                ///< of one cell, preparation and all
  std::uint64_t bytes = 6'000'000'000;  ///< of private memory
};

/// Runs the cases one after the other in a process forked from this one, and in a new one after each that
/// ends it. `ready` is called for each cell; false ends the row there. Where no process can be forked they
/// run here.
void run_row_apart(const std::vector<StressCase>& cases, const RendererRequest& request,
                   const render::Registry& registry, const CellLimits& limits,
                   const std::function<bool(StressCell&&)>& ready);

/// A cell as one line, and back; false where the text is none.
[[nodiscard]] std::string to_line(const StressCell& cell);
[[nodiscard]] bool from_line(const std::string& line, StressCell& cell);

}  // namespace palpate::experiments
