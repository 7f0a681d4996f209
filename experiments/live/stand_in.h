// A coarse stand-in for every lane while a large scene's renderers are prepared. It is one renderer on an
// evenly spread subset of the points.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "experiments/live/changes.h"
#include "experiments/live/live.h"

namespace palpate::experiments {

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
