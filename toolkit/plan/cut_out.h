// Pieces of a scene that stand for the whole: a stretch of the probe's way, and the points that it can feel.
#pragma once

#include <cstdint>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/trace.h"

namespace palpate::plan {

/// A model of no more points is its own piece: of a small one a part has other borders than the whole.
inline constexpr std::size_t kWholePilotPoints = 16'384;

/// How far from the HIP points count. In the model frame.
struct Reach {
  double felt_mm = 0.0;     ///< between the HIP and the surface, at most
  double spacing_mm = 0.0;  ///< of the points, the median; 0: not known
  bool heights = false;     ///< of a height field: however far above or below
};

struct CutOut {
  render::SceneInput scene;  ///< one model, alone and at rest
  trace::ProbePath path;     ///< over it
};

/// The frames [begin, end) of `path` and the points of the model that they can feel; a raster stays one where
/// the piece is a rectangle of it. Frames at the end are left out where the points would be too many. O(n).
[[nodiscard]] CutOut cut_out(const render::SceneInput& scene, const render::ModelInput& model,
                             const trace::ProbePath& path, std::size_t begin, std::size_t end,
                             const Reach& reach);

/// Some frames in a row, from one free place of a path to another.
struct Window {
  std::size_t begin = 0, end = 0;
};
/// `count` of them at most, evenly over the path: each of some 900 frames, that is whole rounds of
/// `period_frames` (0: the path has none), for there the HIP is free. A short path is one window.
[[nodiscard]] std::vector<Window> windows_of(std::size_t frames, std::size_t period_frames,
                                             std::size_t count);

}  // namespace palpate::plan
