// One cell of the stress matrix: a renderer in a case, judged.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <palpate/registry.h>
#include "experiments/driver/json_document.h"
#include "experiments/run/arguments.h"
#include "experiments/stress/stress_case.h"

namespace palpate::experiments {

enum class CellStatus : std::uint8_t {
  kOk,
  kLimit,    ///< refused with a message before the first frame; warned before it and felt wrongly; or
             ///< declared render::may_miss_a_tick
  kFailed,   ///< a requirement was broken
  kSkipped,  ///< not run
};
/// "ok", "limit", "failed", "skipped".
[[nodiscard]] const char* name_of(CellStatus status) noexcept;

struct StressCell {
  std::string renderer;  ///< label
  std::string name;      ///< the case's
  CellStatus status = CellStatus::kSkipped;
  std::string
      check;  ///< broken requirement: "crash", "finite", "limit", "free", "felt", "bounded", "replay", "twin"
  std::string cause;                  ///< in words; empty without failure
  std::vector<std::string> warnings;  ///< of the preparation, in any case
  std::string trace_hash;
  std::uint64_t frames = 0, contact_frames = 0, bound_hits = 0;
  double largest_force_n = 0.0;
  double twin_difference_n = 0.0,
         twin_bound_n = 0.0;  ///< largest over the frames; both 0 without a twin
};

NLOHMANN_JSON_SERIALIZE_ENUM(CellStatus, {{CellStatus::kSkipped, "skipped"},
                                          {CellStatus::kOk, "ok"},
                                          {CellStatus::kLimit, "limit"},
                                          {CellStatus::kFailed, "failed"}})
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(StressCell, renderer, name, status, check, cause, warnings, trace_hash,
                                   frames, contact_frames, bound_hits, largest_force_n, twin_difference_n,
                                   twin_bound_n)

/// Runs a cell in this process. Never throws.
[[nodiscard]] StressCell run_cell(const StressCase& one, const RendererRequest& request,
                                  const render::Registry& registry);

struct CellLimits {
  double seconds = 60.0;                ///< processor time of one cell, preparation included
  std::uint64_t bytes = 6'000'000'000;  ///< private memory
};

/// Runs the cases in order in a forked process, replaced after each case that ends it: a crash or hang is a
/// failed cell. Calls `ready` for each cell; false stops the row.
void run_row_apart(const std::vector<StressCase>& cases, const RendererRequest& request,
                   const render::Registry& registry, const CellLimits& limits,
                   const std::function<bool(StressCell&&)>& ready);

}  // namespace palpate::experiments
