// One cell of the stress matrix: a renderer in a case, judged.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/driver/json_document.h"
#include "experiments/run/arguments.h"

namespace palpate::experiments {

// A case of the stress matrix: a scene, a HIP path, and requirements on every renderer.

/// A frame's expected contact, independent of any renderer.
enum class Due : std::uint8_t {
  kAny,     ///< undecided: near the surface, or dependent on the path
  kFree,    ///< several resolutions from every point on the free side: no contact, no force
  kInside,  ///< entered in small steps, several rounding units deep: a force
};

/// Force limit of every scene, a desktop device's.
inline constexpr double kStressLimitN = 3.3;
/// Default spring stiffness.
inline constexpr double kStressStiffness = 0.5;

/// A built scene with its path.
struct StressSetup {
  render::SceneInput scene;
  trace::ProbePath path;
  std::vector<Due> due;  ///< per frame
  Options options{};     ///< the renderer's; renderers without such an option skip the case
  int threads = 1;       ///< of the preparation
  double tick_s = 1e-3;  ///< a frame's time limit
  /// The same at unit scale. Forces must match within `twin_bound_n` (0: bit-identical) plus `twin_n_per_mm`
  /// times both errors of a surface read in less than double precision.
  std::shared_ptr<const StressSetup> twin{};
  double twin_bound_n = 0.0, twin_n_per_mm = 0.0;
};

struct StressCase {
  std::string name;    ///< on the command line: "scale-1e-6"
  std::string group;   ///< "scale", "offset", ..; selects all its cases
  std::string text;    ///< description, a sentence
  bool quick = false;  ///< in the short test set
  bool full = false;   ///< only with --full: takes minutes, gigabytes
  std::function<Result<StressSetup>()> make;
};

/// All cases in matrix order. Nothing is built before make().
[[nodiscard]] std::vector<StressCase> stress_cases();

void add_number_cases(std::vector<StressCase>& cases);  ///< scale, offset, points, threads
void add_motion_cases(std::vector<StressCase>& cases);  ///< speed, depth, time, stiffness, surface, probe
void add_cloud_cases(std::vector<StressCase>& cases);   ///< spacing, degenerate clouds
void add_body_cases(std::vector<StressCase>& cases);    ///< thin, sharp, open and nested bodies
void add_likely_cases(std::vector<StressCase>& cases);  ///< suspected from reading the code

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
