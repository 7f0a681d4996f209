// How long a frame of a scene will take on this machine, before the scene is prepared: the renderer is
// prepared for pieces of it along the probe's very way and stepped there, which tells the instructions that
// such points, surfaces and options ask for, in the places where the probe will be; and stepped there again
// with cold caches, which tells what the whole waits for memory beyond that.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/plan/cut_out.h"
#include "toolkit/plan/machine.h"
#include "toolkit/render/registry.h"

namespace palpate::plan {

/// How many pieces are taken of a model, at most: fewer where the path is short.
inline constexpr std::size_t kPilots = 12;

struct FrameCost {
  double frame_us = 0.0;  ///< mean frame in contact, the thread's own time; 0: no piece was felt
  double warm_us = 0.0;   ///< of it: as measured on the pieces
  double miss_us = 0.0;   ///< of it: waiting for memory that the pieces had in the cache
  std::size_t pilots = 0;
  /// By model: what the pieces held in times of what had been said of them. Where bytes can only be
  /// reckoned from the points (bricks of a surface: of thin things two sheets go through one cube), the
  /// whole's are as far off.
  std::vector<double> bytes_share;
  std::string reason;  ///< one sentence
};

/// What stepping pieces of a model with cold caches showed.
struct ColdPieces {
  double cold_ns = 0.0;      ///< a frame, beyond what it took warm
  double frames = 0.0;       ///< in contact, on the pieces
  double path_share = 1.0;   ///< the whole path's frames in times of the pieces'
  double whole_bytes = 0.0;  ///< of the whole model
};
/// What a frame waits for memory, ns, on the whole path: from the cold pass follows how many lines are read
/// for the first time; along the whole path they come to so many bytes, and each is waited for as a read in
/// so many bytes waits. Zero where the times tell nothing.
[[nodiscard]] double waiting_ns(const ColdPieces& pieces, const Machine& machine);

/// A renderer prepared for a scene and stepped along a path.
struct Flight {
  double contact_us = 0.0;      ///< mean frame in contact, the thread's own time, the fastest of some passes
  double contact_frames = 0.0;  ///< 0: nothing is felt
  double bytes = 0.0;           ///< held after preparation
  double bytes_said = 0.0;      ///< as the renderer had decided
};
/// `path`: a generator; it follows the first model, its formula where it has one. Errors: those of preparing
/// and of the path.
[[nodiscard]] Result<Flight> fly(const render::SceneInput& scene, const NamedOptions& renderer,
                                 const render::Registry& registry, const std::string& path, int threads);

/// What is expected of a scene: `decided` by the renderer for the whole of it, `spacing_mm` of each model's
/// points, `path` a generator that moves as the probe will, on each model as if it stood alone.
struct Expected {
  const render::SceneInput& scene;
  const NamedOptions& renderer;
  const render::Decisions& decided;
  std::span<const double> spacing_mm;
  const std::string& path;
};

/// An Error where no piece can be prepared. Deterministic but for the times; up to a second.
[[nodiscard]] Result<FrameCost> expect_frame(const Expected& expected, const render::Registry& registry,
                                             const Machine& machine);

/// Instructions a frame, all frames, for comparison on a machine whose times are not to be had. Under
/// callgrind the frames of the first model's pieces are counted as parts "expected ..", those of the whole as
/// "measured"; answers how many frames stand in each.
struct CountedFrames {
  std::size_t expected = 0, measured = 0;
};
inline constexpr const char* kExpectedPart = "expected";
inline constexpr const char* kMeasuredPart = "measured";
[[nodiscard]] Result<CountedFrames> step_marked(const Expected& expected, const render::Registry& registry,
                                                int threads);

}  // namespace palpate::plan
