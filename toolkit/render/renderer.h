// The renderer interface: everything that answers a HIP with a force stands behind it.
//
// One renderer is owned by one thread at a time (the servo thread during frames). prepare() may use more
// threads.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/core/vec.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/geometry/rigid_transform.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/decision.h"
#include "toolkit/render/motion.h"
#include "toolkit/render/move_queue.h"
#include "toolkit/surface/surface.h"

namespace palpate::render {

/// A model as a renderer sees it. Everything in the model frame but world_from_model. The parts are shared,
/// never copied; a renderer may keep what it still reads in a frame.
struct ModelInput {
  std::string name;
  std::shared_ptr<const cloud::Cloud> cloud;                    ///< never null
  std::shared_ptr<const geometry::TriangleMesh> original_mesh;  ///< the file's own faces, or null
  std::shared_ptr<const geometry::AnalyticSurface> analytic;  ///< the formula it was generated from, or null
  geometry::RigidTransform world_from_model;                  ///< at the start
  std::shared_ptr<MovingModel> motion;                        ///< where it goes from there, or null: at rest
  surface::Surface surface;
  std::shared_ptr<MoveQueue> moves;  ///< what deforms it from outside, or null: nothing does
};

/// What prepare() takes.
struct SceneInput {
  std::vector<ModelInput> models;
  std::shared_ptr<Simulation> simulation;  ///< what publishes their motions, or null: nothing moves
  double force_limit_n = 0.0;  ///< magnitude limit applied by every renderer alike, direction kept; 0 = none
};

struct PreparePhase {
  std::string name;
  double ms = 0.0;
};

/// What prepare() reports.
struct PrepareReport {
  double total_ms = 0.0;
  std::vector<PreparePhase> phases;  ///< in order, their sum is about total_ms
  std::size_t bytes = 0;           ///< held by the renderer after preparation; what it shares is counted too
  std::size_t shared_bytes = 0;    ///< of those, what another renderer or model of the store held already
  std::vector<std::string> notes;  ///< decisions and findings a person should know ("shading off: ...")
  /// What makes the answers doubtful, with a remedy, whole sentences: shown first, on the terminal and in the
  /// report.
  std::vector<std::string> warnings{};
  Decisions decisions{};  ///< what was followed: those of decide() for the same scene
  /// A bound on what the surface is off by where a frame reads it in less than double precision; 0: in
  /// double.
  double read_rounding_mm = 0.0;
};

class ModelStore;  // model_store.h

struct PrepareContext {
  int threads = 0;               ///< 0 = all
  Progress* progress = nullptr;  ///< may be null
  ModelStore* store =
      nullptr;  ///< geometry is taken from here and kept here; null: each renderer builds its own
};

enum class FrameStatus : std::uint8_t {
  kOk,
  kBoundHit,   ///< the written bound on work was reached; the rest is done in the next frame
  kNonFinite,  ///< the HIP was not finite: no force, the last state kept
};

/// What a frame answers. Forces act on the device, world frame, N.
struct Frame {
  Vec3 force_n = Vec3::Zero();
  Vec3 god_object_mm = Vec3::Zero();  ///< equals the HIP when free
  bool contact = false;
  std::int32_t model = -1;  ///< index of the touched model, -1 when free
  FrameStatus status = FrameStatus::kOk;
};

/// Sums since the last restart, for reports; kept without locks by the thread that steps.
struct FrameCounters {
  std::uint64_t frames = 0;
  std::uint64_t bound_hits = 0;    ///< frames that reached the written bound
  std::uint64_t walk_steps = 0;    ///< moves of the god object from point to point (or facet to facet)
  std::uint64_t local_minima = 0;  ///< greedy walks that a wider look proved to be stuck
  std::uint64_t box_tests = 0;     ///< segment-AABB tests
  std::uint64_t cells_visited = 0;
  std::uint64_t sphere_only = 0;   ///< boxes that the swept sphere touched and the segment did not
  std::uint64_t edges = 0;         ///< height fields: times the HIP came under through a border or a hole
  std::uint64_t missed_cells = 0;  ///< literal forms only: crossed cells that the printed sampling skipped
};

struct Description {
  std::string name;
  std::string summary;
  std::string source;  ///< thesis section or paper
  std::string
      work_bound;   ///< the bound on a frame's work, in words with its numbers; "unbounded: why" otherwise
  Options options;  ///< as resolved by prepare()
};

class HapticRenderer {
 public:
  HapticRenderer() = default;
  HapticRenderer(const HapticRenderer&) = delete;
  HapticRenderer& operator=(const HapticRenderer&) = delete;
  virtual ~HapticRenderer() = default;

  /// What prepare() would build for this scene and why. May take as long as finding neighbours; builds
  /// nothing. The same decisions for any number of threads. Errors as of prepare(), as far as they can be
  /// told without building.
  [[nodiscard]] virtual Result<Decisions> decide(const SceneInput& scene,
                                                 const PrepareContext& context) const = 0;

  /// Builds everything a frame needs. May allocate, use threads, take long, fail. Called once, before any
  /// step. The result is the same for any number of threads.
  [[nodiscard]] virtual Result<PrepareReport> prepare(const SceneInput& scene,
                                                      const PrepareContext& context) = 0;

  /// Begins a replay at `t_s`: the HIP is in free space at `hip_mm` (world frame), on the free side of closed
  /// surfaces; models that were deformed get their prepared shape back; the counters are cleared. The same
  /// path gives the same frames again. Up to O(points): not for a servo loop.
  virtual void restart(const Vec3& hip_mm, double t_s) noexcept = 0;

  /// Lets go of what is touched: the HIP is free at `hip_mm`, a place known to be free, and goes on from
  /// there. The sides of closed surfaces, the shape of models, counters and time stay. O(models), nothing
  /// allocated: a servo loop re-arms with it.
  virtual void let_go(const Vec3& hip_mm) noexcept = 0;

  /// One haptic frame: at `t_s`, later than in the last frame, the HIP is at `hip_mm` (world frame).
  /// Allocates nothing, locks nothing, logs nothing; work within describe().work_bound. A non-finite HIP
  /// gives zero force and kNonFinite.
  [[nodiscard]] virtual Frame step(const Vec3& hip_mm, double t_s) noexcept = 0;

  [[nodiscard]] virtual FrameCounters counters() const noexcept = 0;
  [[nodiscard]] virtual Description describe() const = 0;
};

/// The time of a renderer's frames, as its caller gives it.
class FrameTime {
 public:
  void restart(double t_s) noexcept { now_s_ = t_s; }
  /// After let_go() nothing is known of what happened since the last frame: the next one counts no time.
  void let_go() noexcept { resumed_ = true; }
  /// A frame at `t_s`: the time since the one before.
  double advance(double t_s) noexcept {
    const double dt_s = resumed_ ? 0.0 : t_s - now_s_;
    resumed_ = false;
    now_s_ = t_s;
    return dt_s;
  }
  [[nodiscard]] double now_s() const noexcept { return now_s_; }

 private:
  double now_s_ = 0.0;
  bool resumed_ = false;
};

/// `force_n` with its magnitude limited, direction kept; limit 0 means none.
[[nodiscard]] inline Vec3 limited(const Vec3& force_n, double limit_n) noexcept {
  if (!(limit_n > 0.0)) return force_n;
  const double size = force_n.norm();
  return size > limit_n ? Vec3(force_n * (limit_n / size)) : force_n;
}

}  // namespace palpate::render
