// What will be built for a scene, and why: "model only what a scene requires" as a list of decisions, like a
// database's EXPLAIN. The renderers decide by the same rules when they prepare.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"

namespace palpate::plan {

struct Decision {
  std::string about;   ///< "renderer", "shading", "friction", ..
  std::string choice;  ///< "heightfield", "none", ..
  std::string reason;  ///< a sentence with the numbers it rests on
  bool given = false;  ///< the scene or the command line said so
};

/// One model, as the planned renderer will hold it.
struct ModelPlan {
  std::string name;
  std::uint64_t points = 0;
  double spacing_mm = 0.0;  ///< largest distance to an immediate neighbour
  std::vector<Decision> decisions;
  std::uint64_t bytes = 0;  ///< beside the cloud itself
};

struct Plan {
  NamedOptions renderer;            ///< what replay and compare run where nobody names one
  std::vector<Decision> decisions;  ///< of the scene as a whole
  std::vector<ModelPlan> models;
  std::uint64_t bytes = 0;
  double frame_us = 0.0;    ///< expected mean frame in contact, see kPlanHardware
  double prepare_ms = 0.0;  ///< expected, on all of `threads`
};

/// The machine that the expected times were measured on.
inline constexpr const char* kPlanHardware = "one core of a 2.5 GHz Xeon, caches warm";

/// Looks at the loaded models (their neighbours are found, which is the longest part); builds nothing.
/// `wanted`: the renderer that the scene or the command line names, or none. `threads` 0 = all. O(n log n).
[[nodiscard]] Result<Plan> make_plan(const render::SceneInput& scene,
                                     const std::optional<NamedOptions>& wanted, int threads);

/// The renderer a scene takes where nobody names one: `heightfield` for one height field as `info` and the
/// renderer define it (cloud/height_field_holes.h), else `cloud`. O(n) with a raster, O(n log n) without.
[[nodiscard]] Decision choose_renderer(const render::SceneInput& scene);

/// As people read it.
[[nodiscard]] std::string text(const Plan& plan);

}  // namespace palpate::plan
