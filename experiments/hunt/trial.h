// One quarry, rendered: what it did worst.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "experiments/hunt/quarry.h"
#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/render/registry.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// What is hunted: the larger the worse. All but the first and the last are without unit, so that scale does
/// not count; the last is felt in newtons at any scale. The last three are metrics::wrong_moments().
enum class HuntGoal : std::uint8_t {
  kWork,    ///< counted steps of one frame, weighed as instructions
  kForce,   ///< force over stiffness times the HIP's way since it was free; 1 is what a spring may reach
  kStick,   ///< frames in contact where the formula has the HIP clear outside
  kJump,    ///< change of force over stiffness times move, within contact
  kEnergy,  ///< energy made by the god object over the largest stored
  kCaught,  ///< frames of a hand that is caught
  kLost,    ///< frames of a hand that loses the surface
  kKick,    ///< largest step of force above those of the truth within a moment, N, under a hand
};
inline constexpr std::size_t kGoals = 8;
struct GoalInfo {
  const char* name;
  const char* text;
};
[[nodiscard]] const GoalInfo& info_of(HuntGoal goal);

/// A quarry made flesh: what a renderer takes, in a model frame that is the world's.
struct HuntScene {
  render::SceneInput input;
  trace::ProbePath path;
  double spacing_mm = 0.0;
  Vec3 offset_mm = Vec3::Zero();                             ///< of the formula
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< null where points were put elsewhere
  bool open = false;                                         ///< the surface has a border, at the box's sides
  double clear_mm = 0.0;  ///< farther out than this the HIP is clear of whatever stands for the surface
  std::optional<trace::ReferenceTrace> truth;  ///< along a hand's path
};
/// An Error where there is no such model: a trial that does not count.
[[nodiscard]] Result<HuntScene> make_scene(const Quarry& quarry);

struct Worst {
  double score = 0.0;
  std::size_t frame = 0;
};
struct Trial {
  std::array<Worst, kGoals> worst;
  std::string fault;  ///< a promise that was broken, in words; else empty
  std::uint64_t bound_hits = 0;
};
/// Prepares the renderer and replays the path twice. An Error: the renderer refuses the scene.
[[nodiscard]] Result<Trial> try_scene(const HuntScene& scene, render::HapticRenderer& renderer);

}  // namespace palpate::experiments
