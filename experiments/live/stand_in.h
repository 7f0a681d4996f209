// What is felt while the renderers of a large scene are still being prepared: one renderer on a part of the
// points, spread evenly over the whole scene, in every lane.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "experiments/live/changes.h"
#include "experiments/live/live.h"

namespace palpate::experiments {

/// Points of a stand-in where nobody says otherwise: `cloud` is prepared on them in some tenths of a second.
inline constexpr std::size_t kStandInPoints = 60'000;

/// Numbers of about `points` of the cloud's points, ascending. Evenly spread: at most one in each cell of a
/// grid. The work is bounded by `points`, not by the cloud. A cloud of no more points is kept whole.
[[nodiscard]] std::vector<std::uint32_t> thinned(const cloud::Cloud& cloud, std::size_t points);

/// A coarse scene, and who renders it.
struct StandIn {
  render::SceneInput input;  ///< without the files' faces
  RendererRequest request;
  std::size_t points = 0, of_points = 0;
  /// "cloud on 60,000 of 437,645 points"
  [[nodiscard]] std::string text() const;
};

/// Nothing where all that is asked for is prepared at once: no window, a clock of its own, a scene of few
/// points; and where a coarse scene would not be the same thing: points that move (dents), a recording, which
/// is replayed on the whole scene. The renderer is the first one that is asked for where it renders points,
/// else `cloud`.
[[nodiscard]] std::optional<StandIn> stand_in_for(const LiveArguments& arguments,
                                                  const std::vector<LiveSetting>& settings,
                                                  const render::SceneInput& scene,
                                                  const render::Registry& registry);

/// What the document says of a renderer that was made.
[[nodiscard]] LiveRenderer described(const LiveSetting& setting, const MadeRenderer& made);

}  // namespace palpate::experiments
