// One cell of the stress matrix: a renderer at an extreme, and whether all holds that must.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "experiments/stress/stress_case.h"
#include "toolkit/render/registry.h"

namespace palpate::experiments {

enum class CellStatus : std::uint8_t {
  kOk,
  kLimit,    ///< refused before the first frame, with a message; warned of before the first frame, and
             ///< felt wrongly; or the renderer states that its frame may take
             ///< longer than a tick: render::may_miss_a_tick
  kFailed,   ///< something that must hold did not
  kSkipped,  ///< not run
};
/// "ok", "limit", "failed", "skipped".
[[nodiscard]] const char* name_of(CellStatus status) noexcept;

struct StressCell {
  std::string renderer;  ///< label
  std::string name;      ///< of the case
  CellStatus status = CellStatus::kSkipped;
  std::string
      check;  ///< what did not hold: "crash", "finite", "limit", "free", "felt", "bounded", "replay", "twin"
  std::string cause;                  ///< in words; empty where all held
  std::vector<std::string> warnings;  ///< what the preparation said beforehand, whether it held or not
  std::string trace_hash;
  std::uint64_t frames = 0, contact_frames = 0, bound_hits = 0;
  double largest_force_n = 0.0;
  double twin_difference_n = 0.0,
         twin_bound_n = 0.0;  ///< largest over the frames; both 0 where there is no twin
};

/// Runs it in this process. Never throws.
[[nodiscard]] StressCell run_cell(const StressCase& one, const RendererRequest& request,
                                  const render::Registry& registry);

}  // namespace palpate::experiments
