// Creates the renderers of a live session. It does so at the start and after each parameter change, with a
// coarse one that stands in meanwhile.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/control.h>
#include <palpate/model_store.h>
#include <palpate/registry.h>
#include "experiments/live/live.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {

/// Everything renderers are made from except their own options. Lives as long as the session.
struct Workshop {
  const Stage& stage;
  const render::Registry& registry;
  int threads = 0;
  bool paced = false;                         ///< see render::PrepareContext
  render::ModelStore store{};                 ///< shares built geometry between all renderers
  const render::SceneInput* other = nullptr;  ///< rendered instead of the stage's scene; null: the stage's
                                              ///< scene

  /// True if passivity control encloses all renderers together; a single renderer's replay then differs.
  [[nodiscard]] bool passivity_apart() const { return stage.scene.control.passivity.has_value(); }
  /// Control around each renderer: coupling and filter. Passivity control encloses the mixer.
  [[nodiscard]] control::ControlOptions around_each() const {
    control::ControlOptions options = stage.scene.control;
    options.passivity.reset();
    return options;
  }
};

/// A renderer's request and its own changes of the scene.
struct LiveSetting {
  RendererRequest request;
  double stiffness_n_per_mm = 0.0;  ///< 0: the scene's
  double force_limit_n = -1.0;      ///< below 0: the scene's; 0: none
};

struct MadeRenderer {
  std::unique_ptr<render::HapticRenderer> renderer;
  render::PrepareReport report;
};
/// Prepared, with control around it, not yet placed. May take long. Errors name the renderer.
[[nodiscard]] Result<MadeRenderer> make_live(Workshop& workshop, const LiveSetting& setting,
                                             Progress& progress);

/// Receivers of a stream's images, by lane. Error: one takes none.
[[nodiscard]] Result<std::vector<stream::DepthReceiver*>> receivers_of(const std::vector<MadeRenderer>& made);

/// Replaces a lane's renderer at `at_s` of the session.
struct LiveChange {
  double at_s = 0.0;
  std::size_t lane = 0;
  LiveSetting setting;
};
/// Parses "2:cloud:stiffness=0.8,4:cloud:refine=1:force_limit=2": at each time in s, options for a label, on
/// top of earlier changes. stiffness in N/mm and force_limit in N replace the scene's for this renderer
/// alone. Sorted by time. Errors name the invalid part.
[[nodiscard]] Result<std::vector<LiveChange>> parse_changes(const std::string& text,
                                                            const std::vector<LiveSetting>& at_start,
                                                            const render::Registry& registry);

/// A wrapper. Moves the models to the time of each step before it. Owns the renderer; refers to the
/// simulation, which nothing else may advance.
class MovingScene final : public render::WrappedRenderer {
 public:
  MovingScene(std::unique_ptr<render::HapticRenderer> inner, render::Simulation& simulation)
      : WrappedRenderer(std::move(inner)), simulation_(simulation) {}

  void restart(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.reset();
    simulation_.advance(t_s);
    inner().restart(hip_mm, t_s);
  }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override {
    simulation_.advance(t_s);
    return inner().step(hip_mm, t_s);
  }

 private:
  render::Simulation& simulation_;
};

// A coarse stand-in for every lane while a large scene's renderers are prepared. It is one renderer on an
// evenly spread subset of the points.

/// Ascending indices of about `points` of the cloud's points, at most one per grid cell. Work is bounded by
/// `points`, not by the cloud. A cloud of at most `points` is kept whole.
[[nodiscard]] std::vector<std::uint32_t> thinned(const cloud::Cloud& cloud, std::size_t points);

/// A coarse scene and its renderer.
struct StandIn {
  render::SceneInput input;  ///< without the files' faces
  RendererRequest request;
  std::size_t points = 0, of_points = 0;
  /// "cloud on 60,000 of 437,645 points"
  [[nodiscard]] std::string text() const;
};

/// Empty if everything is prepared at once (no window, virtual clock, small scene) or a coarse scene would
/// behave differently: moving points (dents), or a recording, whose replay uses the whole scene. Uses the
/// first requested renderer if it renders points, else `cloud`.
[[nodiscard]] std::optional<StandIn> stand_in_for(const LiveArguments& arguments,
                                                  const std::vector<LiveSetting>& settings,
                                                  const render::SceneInput& scene,
                                                  const render::Registry& registry);

/// The document's entry for a renderer.
[[nodiscard]] LiveRenderer described(const LiveSetting& setting, const MadeRenderer& made);

}  // namespace palpate::experiments
