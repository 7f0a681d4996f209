// The renderer interface: turns HIP positions into forces.
//
// One thread at a time owns a renderer (the servo thread during frames). prepare() may use more threads.
//
// First:
//   if (auto report = renderer->prepare(scene, {}); !report) return failed(report.error());
//   renderer->restart({0.0, 0.0, 60.0}, 0.0);                                     // in free space
//   const palpate::render::Frame frame = renderer->step({0.0, 0.0, 39.0}, 1e-3);  // each millisecond
//   if (frame.contact) send(frame.force_n);
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/decision.h>
#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/motion.h>
#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include <palpate/surface.h>
#include <palpate/vec.h>

namespace palpate::spline_sdf {
class SurfaceFile;  // toolkit/spline_sdf/surface_file.h
}

namespace palpate::render {

/// A model as a renderer sees it, in the model frame except world_from_model. Parts are shared, never copied;
/// a renderer keeps those that its frames read.
struct ModelInput {
  std::string name;
  std::shared_ptr<const cloud::Cloud> cloud;  ///< never null
  /// Surfaces on disk that were prepared before, or null. `cloud` is then a sample of their points.
  std::shared_ptr<const spline_sdf::SurfaceFile> prepared{};
  std::shared_ptr<const geometry::TriangleMesh> original_mesh;  ///< the file's own faces, or null
  std::shared_ptr<const geometry::AnalyticSurface> analytic;    ///< the generating formula, or null
  geometry::RigidTransform world_from_model;                    ///< pose at the start
  std::shared_ptr<MovingModel> motion;                          ///< later poses, or null: at rest
  surface::Surface surface;
  std::shared_ptr<MoveQueue> moves;  ///< moves points from outside, or null
  /// Camera of a stream that replaces the points, or null. The cloud holds the points of its first frame.
  std::shared_ptr<const stream::DepthCamera> camera{};
};

/// Input of prepare().
struct SceneInput {
  std::vector<ModelInput> models;
  std::shared_ptr<Simulation> simulation;  ///< publishes the motions, or null: nothing moves
  double force_limit_n = 0.0;  ///< force magnitude limit, direction kept, the same for all renderers; 0 =
                               ///< none
};

struct PreparePhase {
  std::string name;
  double ms = 0.0;
};

/// Report of prepare().
struct PrepareReport {
  double total_ms = 0.0;
  std::vector<PreparePhase> phases;  ///< in order, their sum is about total_ms
  std::size_t bytes = 0;             ///< held after preparation, shared data included
  std::size_t shared_bytes = 0;      ///< of these, held already by another renderer or model of the store
  std::vector<std::string> notes;    ///< decisions and findings for the user ("shading off: ...")
  /// Reasons to doubt the answers, each with a remedy, in whole sentences. Shown first.
  std::vector<std::string> warnings{};
  Decisions decisions{};  ///< equal to decide() for the same scene
  /// Bound on the surface error from reading in less than double precision; 0: double.
  double read_rounding_mm = 0.0;
};

class ModelStore;  // model_store.h

struct PrepareContext {
  int threads = 0;               ///< 0 = all
  Progress* progress = nullptr;  ///< may be null
  ModelStore* store = nullptr;   ///< shares prepared data; null: each renderer builds its own
  /// Frames come at a device's pace and must not wait. Otherwise, as in a replay, a frame of a prepared file
  /// waits for what it needs, so that a replay is the same every time.
  bool paced = false;
};

enum class FrameStatus : std::uint8_t {
  kOk,
  kBoundHit,   ///< the bound on work was reached; the next frame continues
  kNonFinite,  ///< the HIP was not finite: zero force, state kept
};

/// Answer of a frame. Forces act on the device, world frame, N.
struct Frame {
  Vec3 force_n = Vec3::Zero();
  Vec3 god_object_mm = Vec3::Zero();  ///< equals the HIP when free
  bool contact = false;
  std::int32_t model = -1;  ///< index of the touched model, -1 when free
  FrameStatus status = FrameStatus::kOk;
};

/// Sums since the last restart, for reports. Written by the stepping thread without locks.
struct FrameCounters {
  std::uint64_t frames = 0;
  std::uint64_t bound_hits = 0;    ///< frames that reached the bound on work
  std::uint64_t walk_steps = 0;    ///< moves of the god object from point to point (or facet to facet)
  std::uint64_t local_minima = 0;  ///< stuck greedy walks that a wider search corrected
  std::uint64_t box_tests = 0;     ///< segment-AABB tests
  std::uint64_t cells_visited = 0;
  std::uint64_t sphere_only = 0;     ///< boxes hit by the swept sphere and not by the segment
  std::uint64_t edges = 0;           ///< height fields: entries from below through a border or a hole
  std::uint64_t late_frames = 0;     ///< prepared files: frames that looked for a tile that was not in memory
  std::uint64_t coarse_frames = 0;   ///< prepared files: frames that a coarser surface answered
  std::uint64_t damaged_tiles = 0;   ///< prepared files: damaged tiles that were met, felt as absent
  std::uint64_t damaged_tile = 0;    ///< the first of them
  std::uint64_t swaps = 0;           ///< streams: new surfaces that frames took
  std::uint64_t stalled_frames = 0;  ///< streams: frames after the camera fell silent, on its last surface
};

struct Description {
  std::string name;
  std::string summary;
  std::string source;      ///< thesis section or paper
  std::string work_bound;  ///< the bound on a frame's work, in words with numbers; "unbounded: why" otherwise
  Options options;         ///< as resolved by prepare()
};

class HapticRenderer {
 public:
  HapticRenderer() = default;
  HapticRenderer(const HapticRenderer&) = delete;
  HapticRenderer& operator=(const HapticRenderer&) = delete;
  virtual ~HapticRenderer() = default;

  /// The decisions of prepare() for this scene, with reasons. The call builds nothing, but may search
  /// neighbours. The result does not depend on the number of threads. Errors as of prepare(), where known
  /// without building.
  [[nodiscard]] virtual Result<Decisions> decide(const SceneInput& scene,
                                                 const PrepareContext& context) const = 0;

  /// Builds all that a frame needs. Called once, before any step. The call may allocate, use threads, take
  /// long and fail. The result does not depend on the number of threads.
  [[nodiscard]] virtual Result<PrepareReport> prepare(const SceneInput& scene,
                                                      const PrepareContext& context) = 0;

  /// Begins a replay at `t_s` with the HIP free at `hip_mm` (world frame), outside closed surfaces. Restores
  /// deformed models and clears the counters, so the same path gives the same frames. Up to O(points): not
  /// for a servo loop.
  virtual void restart(const Vec3& hip_mm, double t_s) noexcept = 0;

  /// Drops contact: the HIP is free at `hip_mm`, which must be free space, and continues from there. The
  /// sides of closed surfaces, the shape of models, counters and time stay. O(models), allocates nothing;
  /// servo loops re-arm with it.
  virtual void release_contact(const Vec3& hip_mm) noexcept = 0;

  /// One haptic frame: the HIP is at `hip_mm` (world frame) at `t_s`, later than the last frame. Allocates,
  /// locks and logs nothing; the work is within describe().work_bound. A non-finite HIP gives zero force and
  /// kNonFinite.
  [[nodiscard]] virtual Frame step(const Vec3& hip_mm, double t_s) noexcept = 0;

  /// The receiver of depth images that arrive while the surface is felt; null if the renderer knows no
  /// streams. Valid after prepare() and as long as the renderer.
  [[nodiscard]] virtual stream::DepthReceiver* depth_receiver() noexcept { return nullptr; }

  [[nodiscard]] virtual FrameCounters counters() const noexcept = 0;
  [[nodiscard]] virtual Description describe() const = 0;
};

/// `force_n` limited in magnitude, direction kept; limit 0 means none.
[[nodiscard]] inline Vec3 limited(const Vec3& force_n, double limit_n) noexcept {
  if (!(limit_n > 0.0)) return force_n;
  const double size = force_n.norm();
  return size > limit_n ? Vec3(force_n * (limit_n / size)) : force_n;
}

}  // namespace palpate::render
