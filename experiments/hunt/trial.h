// Renders one trial_input and scores its worst behaviour.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/hunt/trial_input.h"

namespace palpate::experiments {

/// Hunted properties: the larger the worse. Dimensionless and so independent of scale, except the counted
/// work and the last, in newtons. The last three are metrics::find_artefacts().
enum class HuntGoal : std::uint8_t {
  kWork,    ///< counted steps of a frame, weighted as instructions
  kForce,   ///< force over stiffness times the HIP's path length since it was free; a spring reaches at most
            ///< 1
  kStick,   ///< frames in contact where the formula has the HIP clear outside
  kJump,    ///< change of force over stiffness times move, within contact
  kEnergy,  ///< energy created by the god object over the largest stored
  kCaught,  ///< frames of a caught hand
  kLost,    ///< frames of a hand that loses the surface
  kKick,    ///< largest force step above the truth's within a moment, N, under a hand
};
inline constexpr std::size_t kGoals = 8;
struct GoalInfo {
  const char* name;
  const char* text;
};
[[nodiscard]] const GoalInfo& info_of(HuntGoal goal);

/// A built trial_input: a renderer's input, with model and world frame equal.
struct HuntScene {
  render::SceneInput input;
  trace::ProbePath path;
  double spacing_mm = 0.0;
  Vec3 offset_mm = Vec3::Zero();                             ///< the formula's
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< null if points were displaced
  bool open = false;                                         ///< the surface has a border at the box's sides
  double clear_mm = 0.0;  ///< distance at which the HIP is clear of any form of the surface
  std::optional<trace::ReferenceTrace> truth;  ///< along a hand's path
};
/// Error: an impossible model; the trial does not count.
[[nodiscard]] Result<HuntScene> make_scene(const TrialInput& trial_input);

struct Worst {
  double score = 0.0;
  std::size_t frame = 0;
};
struct Trial {
  std::array<Worst, kGoals> worst;
  std::string fault;  ///< a broken promise in words; else empty
  std::uint64_t bound_hits = 0;
};
/// Prepares the renderer and replays the path twice. Error: the renderer refuses the scene.
[[nodiscard]] Result<Trial> try_scene(const HuntScene& scene, render::HapticRenderer& renderer);

// A hand's trial_input as a scene file, and its stage.

/// "key = value" lines.
[[nodiscard]] std::string toml_lines(const Options& options);
/// The table [model.surface].
[[nodiscard]] std::string surface_toml(const TrialInput& trial_input);
/// The generated model of a hand's trial_input, with its surface.
[[nodiscard]] Result<std::string> hand_scene_toml(const TrialInput& trial_input);

}  // namespace palpate::experiments
