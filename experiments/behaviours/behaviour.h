// The behaviour suite: small scenes that separate published methods by one counted fault each. Averages over
// a long path hide such faults; a hand notices them.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/progress.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/driver/suite.h"
#include "experiments/run/arguments.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

/// A behaviour's model and its true surface, from which its points were taken.
struct BehaviourScene {
  render::SceneInput input;
  std::shared_ptr<const geometry::AnalyticSurface> surface;
};

/// A HIP path over one of the scenes, with its truth.
struct Stroke {
  std::size_t scene = 0;
  trace::ProbePath path;
  trace::ReferenceTrace truth;
  Vec3 entry = Vec3::UnitZ();  ///< outward normal at the first true contact; z without contact
};

/// Counts faults of a stroke: 0 or 1 for counted strokes, else frames.
using Judge = std::function<std::uint64_t(const Stroke&, std::span<const render::Frame>)>;
/// The total of possible faults.
using Whole = std::function<std::uint64_t(const Stroke&)>;

struct Behaviour {
  std::string id;       ///< on the command line: "thin-plate"
  std::string title;    ///< column heading, a few words
  std::string text;     ///< the scene and why methods differ on it; sentences
  std::string counted;  ///< what is counted: "pushes that come out at the back"
  std::vector<BehaviourScene> scenes;
  std::vector<Stroke> strokes;
  Judge judge;
  Whole whole;

  std::size_t shown = 0;  ///< stroke of the picture
  std::string x_label, y_label;
  std::function<double(const Stroke&, std::size_t sample)> x;
  std::function<double(const render::Frame&)> y;
};

struct BehaviourOutcome {
  std::string failure;  ///< reason; empty: it ran
  std::uint64_t wrong = 0, of = 0;
  std::vector<double> shown;  ///< y along the picture's stroke
};

/// All behaviours, deterministic. Error: an internal fault. Takes some seconds.
[[nodiscard]] Result<std::vector<Behaviour>> behaviour_suite(Progress& progress);

/// Prepares the renderer once per scene and runs all strokes. A refused scene is a failure.
[[nodiscard]] BehaviourOutcome observe(const Behaviour& behaviour, const RendererRequest& request,
                                       const render::Registry& registry, int threads, Progress& progress);

// Building blocks of the behaviours.

/// Stiffness of every model in the suite.
inline constexpr double kBehaviourStiffness = 0.5;
/// Speed of a hand.
inline constexpr double kHandSpeed = 50.0;

/// A generator's model as a scene.
[[nodiscard]] Result<BehaviourScene> generated_scene(const std::string& generator);
/// The same surface with other points.
[[nodiscard]] Result<BehaviourScene> scene_of_points(
    const std::vector<Vec3>& points, std::string name,
    std::shared_ptr<const geometry::AnalyticSurface> surface);

/// A 1 kHz path along straight lines between corners, with its truth. The first corner must be free.
[[nodiscard]] Result<Stroke> stroke(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                    const std::vector<Vec3>& corners, double speed_mm_s = kHandSpeed);
/// A given path with its truth.
[[nodiscard]] Result<Stroke> stroke_along(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                          trace::ProbePath path);

/// Aperiodic places in [low, high] from multiples of the golden section, so none repeats a pattern of the
/// points.
[[nodiscard]] double scattered(std::size_t i, double low, double high) noexcept;

/// True if the force differs from the truth by more than a hand distinguishes and a device resolves.
[[nodiscard]] bool out_of_band(const render::Frame& frame, const trace::TruthFrame& truth) noexcept;
/// True if force and true force enclose more than `deg`, or a due force is missing.
[[nodiscard]] bool turned_by(const render::Frame& frame, const trace::TruthFrame& truth, double deg) noexcept;

/// Number of true contact frames.
[[nodiscard]] std::uint64_t contact_frames(const Stroke& stroke) noexcept;

// The behaviour suite, as a command for several renderers: a matrix and a picture per behaviour.

struct BehaviourMatrix {
  std::vector<Behaviour> behaviours;
  std::vector<RendererRequest> renderers;
  std::vector<std::vector<BehaviourOutcome>> outcomes;  ///< by renderer, then behaviour
  std::vector<render::Role> roles{};                    ///< by renderer
};

/// Every registered renderer except the truth and the tests' oracle.
[[nodiscard]] std::vector<RendererRequest> methods_of(const render::Registry& registry);

/// `suite`: keeps each renderer's row, and takes over those of an interrupted run. Error: storing failed.
[[nodiscard]] Result<BehaviourMatrix> run_behaviours(std::vector<Behaviour> behaviours,
                                                     std::vector<RendererRequest> renderers,
                                                     const render::Registry& registry, int threads,
                                                     Progress& progress, const Suite* suite = nullptr);

[[nodiscard]] std::string matrix_json(const BehaviourMatrix& matrix, const metrics::DocumentHead& head);
/// Adds a section with matrix and pictures, drawn into `folder`/figures.
void add_behaviours(Page& page, const BehaviourMatrix& matrix, const OutputFolder& folder);

struct BehavioursArguments {
  std::string renderers;  ///< empty: all methods
  std::string only;       ///< "thin-plate,ridge"; empty: all
  std::string out;
  int threads = 0;
  bool json = false;
};

/// Returns the exit status.
[[nodiscard]] Result<int> watch_behaviours(const BehavioursArguments& arguments, Context& context);

}  // namespace palpate::experiments
