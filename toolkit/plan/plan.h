// The plan of a scene: renderer, decisions, expected frame time.
//
// The renderer is chosen if none is named; decisions are those of HapticRenderer::decide. The frame time on
// this machine is estimated before preparation: the renderer is prepared for pieces of the scene along the
// probe's path and stepped there, which measures the instructions; cold-cache steps show the memory waits of
// the whole. The machine's memory latency is measured once, in less than a second, and cached by processor
// name and Palpate version.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/decision.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/registry.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::plan {

/// A dependent read somewhere in this many bytes.
struct ReadLatency {
  double bytes = 0.0;
  double ns = 0.0;
};

struct Machine {
  std::string cpu;
  std::vector<ReadLatency> reads;  ///< bytes ascending
  bool from_cache = false;

  /// Interpolated along the logarithm; constant beyond the measured sizes.
  [[nodiscard]] double read_ns(double bytes) const noexcept;
};

/// From the cache unless `anew`; else measured and cached if possible. `version`: of the program. Invalid
/// cache files are replaced. Thread time.
[[nodiscard]] Machine measure_machine(const std::string& version, bool anew, Progress* progress);

/// "Intel Xeon ..: a read of 16 kB 1.2 ns, of 1 MB 4 ns, of 64 MB 95 ns"
[[nodiscard]] std::string text(const Machine& machine);

/// A smaller model is its own piece: parts of it would have other borders.
inline constexpr std::size_t kMaxWholePoints = 16'384;

/// Distance from the HIP within which points matter, model frame.
struct FeltReach {
  double felt_mm = 0.0;     ///< largest distance between HIP and surface
  double spacing_mm = 0.0;  ///< median spacing of the points; 0: unknown
  bool heights = false;     ///< a height field: any distance above or below
};

struct SceneExcerpt {
  render::SceneInput scene;  ///< one model, alone and at rest
  trace::ProbePath path;     ///< over it
};

/// The frames [begin, end) of `path`, and the model's points that they can feel; a rectangle of a raster
/// stays a raster. Drops final frames if there are too many points. O(n).
[[nodiscard]] SceneExcerpt extract_excerpt(const render::SceneInput& scene, const render::ModelInput& model,
                                           const trace::ProbePath& path, std::size_t begin, std::size_t end,
                                           const FeltReach& reach);

/// Consecutive frames between two free places of a path.
struct Window {
  std::size_t begin = 0, end = 0;
};
/// At most `count` windows, spread over the path. Each has about 900 frames in whole rounds of
/// `period_frames` (0: none), at whose ends the HIP is free. A short path is one window.
[[nodiscard]] std::vector<Window> choose_windows(std::size_t frames, std::size_t period_frames,
                                                 std::size_t count);

/// Most pieces per model; fewer on short paths.
inline constexpr std::size_t kMaxExcerpts = 12;

struct FrameCost {
  double frame_us = 0.0;  ///< mean contact frame, thread time; 0: no piece was felt
  double warm_us = 0.0;   ///< part measured on the pieces
  double miss_us = 0.0;   ///< part waiting for memory that the pieces had in cache
  std::size_t excerpts = 0;
  /// Per model: the pieces' bytes over their estimates. Where bytes are only estimated from points (bricks:
  /// thin things have two sheets per cube), the whole's are off alike.
  std::vector<double> bytes_share;
  std::string reason;  ///< one sentence
};

/// Result of stepping pieces with cold caches.
struct ColdCacheRun {
  double cold_ns = 0.0;      ///< per frame, beyond the warm time
  double frames = 0.0;       ///< in contact, on the pieces
  double path_share = 1.0;   ///< the whole path's frames over the pieces'
  double whole_bytes = 0.0;  ///< of the whole model
};
/// A frame's memory wait on the whole path, ns. The cold pass gives the number of first-time line reads; over
/// the whole path they spread over these bytes, and each waits like a read in that many bytes. Zero if the
/// times are inconclusive.
[[nodiscard]] double memory_wait_ns(const ColdCacheRun& pieces, const Machine& machine);

/// A renderer prepared for a scene and stepped along a path.
struct SceneRun {
  double contact_us = 0.0;       ///< mean contact frame, thread time, fastest of several passes
  double contact_frames = 0.0;   ///< 0: nothing is felt
  double bytes = 0.0;            ///< held after preparation
  double bytes_estimated = 0.0;  ///< the renderer's estimate
};
/// `path`: a generator, on the first model (its formula, if any). Errors: those of preparing and of the path.
[[nodiscard]] Result<SceneRun> run_scene(const render::SceneInput& scene, const NamedOptions& renderer,
                                         const render::Registry& registry, const std::string& path,
                                         int threads);

/// A scene's query: `decided` by the renderer for the whole, `spacing_mm` per model, and a generator `path`
/// that moves like the probe, on each model separately.
struct CostQuery {
  const render::SceneInput& scene;
  const NamedOptions& renderer;
  const render::Decisions& decided;
  std::span<const double> spacing_mm;
  const std::string& path;
};

/// An Error if no piece can be prepared. Deterministic except for times; up to a second.
[[nodiscard]] Result<FrameCost> estimate_frame_cost(const CostQuery& expected,
                                                    const render::Registry& registry, const Machine& machine);

struct Plan {
  NamedOptions renderer;           ///< default of replay and compare
  render::Decisions decided;       ///< its decisions, its own choice first
  std::optional<Machine> machine;  ///< machine of `cost`; empty: expected times are for kReferenceMachine
  std::optional<FrameCost> cost;   ///< of a frame on it
  std::vector<double> spacing_mm;  ///< per model: the median of sqrt(area per point); 0: unknown
  std::vector<std::string> warnings;
};

/// Asks the renderer without preparing or running it. `wanted`: the one named by the scene or command line,
/// or none. Errors: those of making it and of its decide().
[[nodiscard]] Result<Plan> make_plan(const render::SceneInput& scene,
                                     const std::optional<NamedOptions>& wanted,
                                     const render::Registry& registry, const render::PrepareContext& context);

/// Replaces reference frame times by estimates for this machine; leaves the plan unchanged if that is
/// impossible.
void estimate_on_machine(Plan& plan, const render::SceneInput& scene, const render::Registry& registry,
                         const std::string& path, Machine machine);

/// The renderer for a scene that names none: `heightfield` for a single height field (as defined for `info`,
/// cloud/height_field.h), else `cloud`, or `cloud-smooth` for one model with noise that is felt at its
/// spacing and stiffness. O(n log n).
[[nodiscard]] render::Decision choose_renderer(const render::SceneInput& scene,
                                               const render::PrepareContext& context = {});

/// For the user.
[[nodiscard]] std::string text(const Plan& plan);

}  // namespace palpate::plan
