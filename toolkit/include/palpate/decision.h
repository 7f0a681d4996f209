// Decisions of a renderer: numbers and reasons of its build. decide() makes the list before anything is
// built, prepare() follows and reports it, and `palpate info plan` prints it.
//
// First:
//   const auto decided = renderer->decide(scene, {});  // what would be built, and why
//   if (!decided) return failed(decided.error());
//   for (const auto& d : decided->models[0].decisions) std::puts(palpate::render::note_text(d).c_str());
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace palpate::render {

struct SceneInput;

struct Decision {
  std::string about;   ///< "neighbours", "shading", "friction", ..
  std::string choice;  ///< "scanner-path", "none", ..
  std::string reason;  ///< a sentence with the numbers it rests on
  bool given = false;  ///< set by the scene or an option against the automatic choice
  friend bool operator==(const Decision&, const Decision&) = default;
};

/// The machine that expected times were measured on.
inline constexpr const char* kReferenceMachine = "one core of a 2.5 GHz Xeon, caches warm";

/// One model as a renderer will hold it. Bytes and times are estimates made before building.
struct ModelDecisions {
  std::string name;
  std::uint64_t points = 0;
  std::optional<double> spacing_mm;  ///< between points, as this renderer sees it; empty if not measured
  std::vector<Decision> decisions;
  std::uint64_t bytes = 0;           ///< beside the cloud itself; 0 if not known beforehand
  std::optional<double> prepare_ms;  ///< on two threads; empty if not measured
  std::optional<double> frame_us;    ///< mean contact frame on kReferenceMachine; empty if not measured
  friend bool operator==(const ModelDecisions&, const ModelDecisions&) = default;
};

/// The decisions for a scene: for the whole, for each model, and the sums.
struct Decisions {
  std::vector<Decision> decisions;
  std::vector<ModelDecisions> models;
  std::uint64_t bytes = 0;
  std::optional<double> prepare_ms;
  std::optional<double> frame_us;
  friend bool operator==(const Decisions&, const Decisions&) = default;
};

/// Combination of contacts with several models at once.
enum class ContactCombination : std::uint8_t {
  kJoint,  ///< all models together hold one god object
  kSum,    ///< each model answers for itself
};

/// Properties of a local model that the frame loop relies on (frame_loop.h).
struct LocalModelTraits {
  bool boxed = false;    ///< has a box, so that a broad phase can skip it
  bool changes = false;  ///< its points may deform or be moved from outside
  bool sums = false;     ///< its forces can only be summed
};

/// The frame around the models.
struct SceneDecision {
  bool many = false;         ///< loops over the models near the HIP; else there is one model at rest
  bool broad_phase = false;  ///< finds them in a tree of boxes
  ContactCombination combine = ContactCombination::kJoint;
  double force_limit_n = 0.0;  ///< 0: none
};
[[nodiscard]] SceneDecision decide_scene(const SceneInput& scene, const LocalModelTraits& kind,
                                         ContactCombination combine);

/// Writes the frame's decisions and the sums over the models into `decided`, which holds the models.
void describe_scene(const SceneInput& scene, const SceneDecision& scene_decision, Decisions& decided);

/// The decision on the force limit; control takes the limit over where it is active.
[[nodiscard]] Decision force_limit_decision(double force_limit_n);

/// "shading: none, a change of point moves .."
[[nodiscard]] std::string note_text(const Decision& decision);

}  // namespace palpate::render
