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
#include "experiments/run/arguments.h"

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

}  // namespace palpate::experiments
