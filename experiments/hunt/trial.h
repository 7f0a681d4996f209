// Renders one trial_input and scores its worst behaviour.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/vec.h>
#include "toolkit/core/random.h"

namespace palpate::experiments {

// A trial's input: small model, renderer options, and HIP path or hand. A value that is drawn at random,
// mutated, and written as text.

/// An edit of one point of the model.
struct PointEdit {
  enum class Kind : std::uint8_t { kMove, kDouble, kDrop, kOnto } kind = Kind::kMove;
  double which = 0.0;      ///< share of the points, [0, 1)
  double other = 0.0;      ///< kOnto: the target point
  Vec3 by = Vec3::Zero();  ///< spacings
};

/// The HIP's next place.
struct Waypoint {
  enum class Kind : std::uint8_t { kFree, kAtPoint, kBetween } kind = Kind::kFree;
  Vec3 at = Vec3::Zero();           ///< kFree: half box sizes from its centre; else spacings from the place
  double which = 0.0, other = 0.0;  ///< points, shares as in PointEdit
  int frames = 1;                   ///< on the way there
};

/// A simulated hand on the formula, like the path generator `hand`.
struct HandWay {
  double force_n = 0.0;
  double fastest_mm_s = 0.0;  ///< a quarter of it for the slowest stroke, as of the default hand
  double spacing_mm = 0.0;    ///< spacing of the stroked points: sets the model's scale
  std::uint64_t seed = 1;

  /// The path generator with its options.
  [[nodiscard]] std::string path_text() const;
};

/// One trial's input. A HIP path starts and ends above the model.
struct TrialInput {
  std::string shape;  ///< a generator
  Options form;       ///< the generator's own options, as given
  int points = 0;
  std::string sampling;  ///< the generator's
  double noise = 0.0, outliers = 0.0;
  std::uint64_t model_seed = 1;
  double scale = 1.0;   ///< of all lengths
  double offset = 0.0;  ///< of the model from the origin, in its own sizes
  double friction = 0.0;
  std::vector<PointEdit> edits;
  std::vector<Waypoint> way;
  std::optional<HandWay> hand;  ///< replaces a HIP path
  Options options;              ///< the renderer's, as given

  /// True if raster points are still in their raster: at most lifted.
  [[nodiscard]] bool keeps_raster() const;
  /// The model as a command-line scene.
  [[nodiscard]] std::string model_text() const;
  /// True if the surface has a border.
  [[nodiscard]] bool open() const;
  /// Width of the shape's thinnest part or crest, mm; infinite without one.
  [[nodiscard]] double finest_mm() const;
};

/// Least width in spacings of judged parts and crests. Caught tolerates a god object two spacings off, which
/// on a thinner part may be the other side.
inline constexpr double kFinestSpacings = 4.0;
/// Least number of points for a surface: twenty spacings across a square.
inline constexpr double kFewestJudged = 300.0;
/// Every model's stiffness, N/mm, the default.
inline constexpr double kHuntedStiffness = 0.5;

/// Most frames of a trial_input's paths together; longer ones are cut.
inline constexpr int kMostFrames = 1500;
/// Frames of a hand: three seconds, with one or two lifts.
inline constexpr int kHandFrames = 3000;

/// The variable parts of a renderer.
struct Ground {
  std::span<const OptionSpec> options;
  bool heights = false;  ///< height fields only: raster points, lifted and lowered
};
[[nodiscard]] TrialInput random_trial_input(Random& random, const Ground& ground);
/// Makes one to three changes.
[[nodiscard]] TrialInput mutated(const TrialInput& trial_input, Random& random, const Ground& ground);

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
