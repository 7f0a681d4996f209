// How long a frame of a scene will take on this machine, before the scene is prepared: the renderer is
// prepared for small cut-outs of it and stepped there, which tells the instructions that such points,
// surfaces and options ask for; what the whole waits for memory beyond that is reckoned from its bytes, its
// spacing and the machine's reads.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/plan/machine.h"
#include "toolkit/render/registry.h"

namespace palpate::plan {

/// Points of a cut-out, and how many are taken of a model.
inline constexpr std::size_t kPilotPoints = 4096;
inline constexpr std::size_t kPilots = 3;
/// A model of no more points is its own cut-out: of a small one a part has other borders than the whole.
inline constexpr std::size_t kWholePilotPoints = 4 * kPilotPoints;

struct FrameCost {
  double frame_us = 0.0;  ///< mean frame in contact, the thread's own time; 0: no cut-out was felt
  double warm_us = 0.0;   ///< of it: as measured on the cut-outs
  double miss_us = 0.0;   ///< of it: waiting for memory that the cut-outs had in the cache
  std::size_t pilots = 0;
  /// By model: what the cut-outs held in times of what had been said of them. Where bytes can only be
  /// reckoned from the points (bricks of a surface: of thin things two sheets go through one cube), the
  /// whole's are as far off.
  std::vector<double> bytes_share;
  std::string reason;  ///< one sentence
};

/// A renderer prepared for a scene and stepped along a path.
struct Flight {
  double contact_us = 0.0;      ///< mean frame in contact, the thread's own time, the fastest of some passes
  double contact_frames = 0.0;  ///< 0: nothing is felt
  double bytes = 0.0;           ///< held after preparation
  double bytes_said = 0.0;      ///< as the renderer had decided
  double travel_mm = 0.0;       ///< of the HIP in one frame, the mean
};
/// `path`: a generator; it follows the first model, its formula where it has one. Errors: those of preparing
/// and of the path.
[[nodiscard]] Result<Flight> fly(const render::SceneInput& scene, const NamedOptions& renderer,
                                 const render::Registry& registry, const std::string& path, int threads);

/// `path`: a generator for points ("exploration:depth_mm=..") that moves as the probe will. `decided`: by the
/// renderer for the whole scene. `spacing_mm`: of each model's points. An Error where no cut-out can be
/// prepared. Deterministic but for the times; some tens of milliseconds a cut-out.
[[nodiscard]] Result<FrameCost> expect_frame(const render::SceneInput& scene, const NamedOptions& renderer,
                                             const render::Decisions& decided,
                                             std::span<const double> spacing_mm,
                                             const render::Registry& registry, const std::string& path,
                                             const Machine& machine);

}  // namespace palpate::plan
