// A case of the stress matrix: a scene at an extreme, a way of the HIP, and what must hold of every renderer.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// What is known of a frame without asking any renderer.
enum class Due : std::uint8_t {
  kAny,     ///< nothing: near the surface, or where the way there decides
  kFree,    ///< several resolutions clear of every point, on the free side: no contact, no force
  kInside,  ///< entered in small steps and several rounding units deep: a force
};

/// The force limit of every scene, as a desktop device has it.
inline constexpr double kStressLimitN = 3.3;
/// Of the spring, where a case is not about it.
inline constexpr double kStressStiffness = 0.5;

/// A scene and a way over it, made.
struct StressSetup {
  render::SceneInput scene;
  trace::ProbePath path;
  std::vector<Due> due;  ///< of every frame
  Options options{};  ///< of the renderer, for those that have an option of this name; others skip the case
  int threads = 1;    ///< of the preparation
  double tick_s = 1e-3;  ///< a frame may take no longer
  /// The same at unit scale: its forces must be these to within `twin_bound_n` (0: to the last bit), and what
  /// a surface that is read in less than double precision is off by, in both, times `twin_n_per_mm`.
  std::shared_ptr<const StressSetup> twin{};
  double twin_bound_n = 0.0, twin_n_per_mm = 0.0;
};

struct StressCase {
  std::string name;    ///< as on the command line: "scale-1e-6"
  std::string group;   ///< "scale", "offset", ..; also names all of its cases
  std::string text;    ///< what it is, a sentence
  bool quick = false;  ///< one of the short set that runs as a test
  bool full = false;   ///< only with --full: minutes, gigabytes
  std::function<Result<StressSetup>()> make;
};

/// All of them, in the order of the matrix. Nothing is made before make().
[[nodiscard]] std::vector<StressCase> stress_cases();

// The parts that stress_cases() joins, by what is extreme in them.
void add_number_cases(std::vector<StressCase>& cases);  ///< scale, offset, points, threads
void add_motion_cases(std::vector<StressCase>& cases);  ///< speed, depth, time, stiffness, surface, probe
void add_cloud_cases(std::vector<StressCase>& cases);   ///< spacing, degenerate clouds
void add_body_cases(std::vector<StressCase>& cases);    ///< thin, sharp, open and nested bodies
void add_likely_cases(std::vector<StressCase>& cases);  ///< what reading the code found likely to break

}  // namespace palpate::experiments
