// A case of the stress matrix: a scene, a HIP path, and requirements on every renderer.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/options.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::experiments {

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

}  // namespace palpate::experiments
