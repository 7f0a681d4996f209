// The behaviour suite: small scenes on which the methods of the literature differ, each with one thing that
// is counted. Averages over a long path hide these; a hand does not.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "experiments/run/arguments.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/render/registry.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::experiments {

/// A model of a behaviour and the surface that its points were taken from, which is the truth.
struct BehaviourScene {
  render::SceneInput input;
  std::shared_ptr<const geometry::AnalyticSurface> surface;
};

/// One way of the HIP over one of the scenes, with the truth along it.
struct Stroke {
  std::size_t scene = 0;
  trace::ProbePath path;
  trace::ReferenceTrace truth;
  Vec3 entry = Vec3::UnitZ();  ///< outward normal where the HIP truly went in first; z where it never does
};

/// What is wrong on a stroke: 0 or 1 where strokes are counted, else a number of frames.
using Judge = std::function<std::uint64_t(const Stroke&, std::span<const render::Frame>)>;
/// How much there is to be wrong.
using Whole = std::function<std::uint64_t(const Stroke&)>;

struct Behaviour {
  std::string id;       ///< as on the command line: "thin-plate"
  std::string title;    ///< a few words, heads a column
  std::string text;     ///< the scene, and why methods differ on it; sentences
  std::string counted;  ///< what is counted: "pushes that come out at the back"
  std::vector<BehaviourScene> scenes;
  std::vector<Stroke> strokes;
  Judge judge;
  Whole whole;

  std::size_t shown = 0;  ///< the stroke of the picture
  std::string x_label, y_label;
  std::function<double(const Stroke&, std::size_t sample)> x;
  std::function<double(const render::Frame&)> y;
};

/// What a renderer did.
struct BehaviourOutcome {
  std::string failure;  ///< why it did not run; else empty
  std::uint64_t wrong = 0, of = 0;
  std::vector<double> shown;  ///< y along the stroke of the picture
};

/// All of them, always the same. An Error is a fault of ours. Some seconds.
[[nodiscard]] Result<std::vector<Behaviour>> behaviour_suite(Progress& progress);

/// Prepares the renderer once for each scene and runs all strokes. A renderer that refuses a scene has a
/// failure.
[[nodiscard]] BehaviourOutcome observe(const Behaviour& behaviour, const RendererRequest& request,
                                       const render::Registry& registry, int threads, Progress& progress);

}  // namespace palpate::experiments
