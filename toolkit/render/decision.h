// What a renderer builds for a scene, with which numbers and why: "model only what a scene requires" as a
// list of decisions, like a database's EXPLAIN. decide() makes them before anything is built, prepare()
// follows them and reports which it followed, `palpate plan` prints them.
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
  bool given = false;  ///< the scene or an option said so, other than what would have been chosen
  friend bool operator==(const Decision&, const Decision&) = default;
};

/// The machine that expected times were measured on.
inline constexpr const char* kExpectedOn = "one core of a 2.5 GHz Xeon, caches warm";

/// One model, as a renderer will hold it. Bytes and times are estimates: nothing has been built.
struct ModelDecisions {
  std::string name;
  std::uint64_t points = 0;
  std::optional<double>
      spacing_mm;  ///< between points, as this renderer sees it; none where it does not look
  std::vector<Decision> decisions;
  std::uint64_t bytes = 0;           ///< beside the cloud itself; 0 where it is not known beforehand
  std::optional<double> prepare_ms;  ///< on two threads; none where it was not measured
  std::optional<double> frame_us;  ///< mean frame in contact, see kExpectedOn; none where it was not measured
  friend bool operator==(const ModelDecisions&, const ModelDecisions&) = default;
};

/// A scene: what holds for it as a whole, each of its models, and the sums.
struct Decisions {
  std::vector<Decision> decisions;
  std::vector<ModelDecisions> models;
  std::uint64_t bytes = 0;
  std::optional<double> prepare_ms;
  std::optional<double> frame_us;
  friend bool operator==(const Decisions&, const Decisions&) = default;
};

/// Several models touched at once.
enum class Combine : std::uint8_t {
  kJoint,  ///< the god object is held by all of them together
  kSum,    ///< each answers for itself
};

/// What a kind of local model lets the frame around it do (see frame_shell.h).
struct FrameKind {
  bool boxed = false;    ///< it has a box, by which a broad phase can leave it out
  bool changes = false;  ///< its points may give way or be moved from outside
  bool sums = false;     ///< its forces only add up
};

/// The frame around the models.
struct SceneDecision {
  bool many = false;         ///< it goes through the models near the HIP; else there is one, at rest
  bool broad_phase = false;  ///< and these come from a tree of their boxes
  Combine combine = Combine::kJoint;
  double force_limit_n = 0.0;  ///< 0: none
};
[[nodiscard]] SceneDecision decide_scene(const SceneInput& scene, const FrameKind& kind, Combine combine);

/// Puts the frame's decisions and the sums over the models into `decided`, whose models are there.
void say_scene(const SceneInput& scene, const SceneDecision& scene_decision, Decisions& decided);

/// The decision on the force limit, which control takes over where there is any.
[[nodiscard]] Decision force_limit_decision(double force_limit_n);

/// "shading: none, a change of point moves .."
[[nodiscard]] std::string note_of(const Decision& decision);

}  // namespace palpate::render
