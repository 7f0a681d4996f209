// The true force along a path, and scores against it (docs/reference/scores.md).
//
// The truth is the constrained god object of an analytic surface, tracked to convergence.
//
// Symbols per sample: F_r is the rendered force, F_g the true force, h the HIP, d its signed distance
// (negative inside), g and g* the rendered and the true god object.
// G is the set of frames with F_g != 0 (the truth's contact frames); C is the set with F_r != 0 or F_g != 0.
// Sums run over C and are divided by |G|, so false contact adds error and no frames.
// Frames whose truth depends on history (trace::TruthFrame::history_decides) belong to neither set and only
// count in the scores named for them.
// An *episode* is a gapless stretch of G; it owns the frames up to the next one. Consecutive frames depend on
// each other, so confidence bounds resample episodes.
// The *floor* is stiffness x device resolution: the smallest force step that the device can show.
//
// First:
//   const auto& model = scene.models[0];
//   const palpate::metrics::AnalyticTruth surface(*model.analytic, model.world_from_model);
//   auto scored = palpate::metrics::score(path, replayed.trace, truth, &surface, {});
//   if (!scored) return failed(scored.error());
//   std::printf("RMS error %g N\n", scored->force_rms_n.value_or(0.0));
//
// Truth:
//   const auto& m = scene.models[0];
//   auto truth = palpate::metrics::analytic_reference(*m.analytic, path, m.surface.stiffness_n_per_mm,
//                                                     scene.force_limit_n, m.world_from_model);
//   if (!truth) return failed(truth.error());
//   std::puts(truth->exactness.c_str());
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/clock.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/vec.h>

namespace palpate::search {
struct NeighbourTable;  // toolkit/search/neighbour_table.h
}

namespace palpate::metrics {

/// The true surface in the WORLD frame, mm. Thread-safe. Not for frames: implementations may allocate and be
/// slow.
class TruthSurface {
 public:
  TruthSurface() = default;
  TruthSurface(const TruthSurface&) = delete;
  TruthSurface& operator=(const TruthSurface&) = delete;
  virtual ~TruthSurface() = default;

  /// Distance to the surface, negative inside.
  [[nodiscard]] virtual double signed_distance_mm(const Vec3& p_mm) const = 0;
  /// The closest point of the whole surface and its outward normal.
  [[nodiscard]] virtual geometry::SurfacePoint closest(const Vec3& p_mm) const = 0;
};

/// An analytic surface with a pose. Keeps a reference to the surface.
class AnalyticTruth final : public TruthSurface {
 public:
  AnalyticTruth(const geometry::AnalyticSurface& surface, const geometry::RigidTransform& world_from_model)
      : surface_(surface),
        world_from_model_(world_from_model),
        model_from_world_(world_from_model.inverse()) {}

  [[nodiscard]] double signed_distance_mm(const Vec3& p_mm) const override {
    return surface_.signed_distance_mm(model_from_world_ * p_mm);
  }
  [[nodiscard]] geometry::SurfacePoint closest(const Vec3& p_mm) const override {
    const geometry::SurfacePoint found = surface_.closest(model_from_world_ * p_mm);
    return {world_from_model_ * found.point_mm, world_from_model_.rotate(found.normal)};
  }

 private:
  const geometry::AnalyticSurface& surface_;
  geometry::RigidTransform world_from_model_;
  geometry::RigidTransform model_from_world_;
};

/// An Error if the path starts inside (file = the path's name, line 2 = the first sample of a CSV file).
[[nodiscard]] Status check_starts_free(const trace::ProbePath& path, const TruthSurface& truth);

struct ReferenceOptions {
  int sub_steps = 8;  ///< pieces into which the HIP's way of one frame is divided
  bool check_halving =
      true;  ///< track again with twice as many pieces and state the difference of the god object
};

/// Tracks the god object along `path`. It is free until a piece enters the surface, then at the local minimum
/// of distance reached along the surface (never changing sheets), until the HIP is outside again. Force =
/// stiffness x (god object - HIP), limited to force_limit_n (0 = none). A path that starts inside is an Error
/// with its line. local_resolution_mm stays 0 (see fill_local_resolution). `exactness` states the checks with
/// numbers. O(frames x sub_steps) closest-point searches; never timed.
[[nodiscard]] Result<trace::ReferenceTrace> analytic_reference(
    const geometry::AnalyticSurface& surface, const trace::ProbePath& path, double stiffness_n_per_mm,
    double force_limit_n, const geometry::RigidTransform& world_from_model,
    const ReferenceOptions& options = {});

/// Sets local_resolution_mm of every frame: the distance from the cloud point nearest to the true god object
/// (when free: to the nearest surface point, h - d n) to its last neighbour in `neighbours`, usually its
/// eighth. Differing sizes are an Error. O(points + frames) for clouds of bounded density variation.
[[nodiscard]] Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud,
                                           const search::NeighbourTable& neighbours,
                                           const geometry::RigidTransform& world_from_model);
/// The same, finding the eight nearest neighbours of every point with `threads` threads.
[[nodiscard]] Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                                           const cloud::Cloud& cloud,
                                           const geometry::RigidTransform& world_from_model, int threads);

/// Position resolution of the Phantom Omni, 450 dpi (thesis section 3.6); it defines the floor.
inline constexpr double kOmniResolutionMm = 0.055;
/// The coarser contact tolerance, a length that a hand can tell, independent of the cloud.
inline constexpr double kContactToleranceMm = 0.1;
/// A god object is caught when it is farther from the true one than the larger of kCaughtMm and
/// kCaughtSpacings point spacings. Artefacts shorter than kMinArtefactS are not noticed by a hand.
inline constexpr double kCaughtMm = 1.0, kCaughtSpacings = 2.0, kMinArtefactS = 0.02;
/// Weber deadband of haptic codecs (IEEE 1918.1.1): the band of within_10_percent.
inline constexpr double kForceDeadband = 0.10;

struct AccuracyOptions {
  double stiffness_n_per_mm = 0.5;
  double device_resolution_mm = kOmniResolutionMm;
  /// Rounding of the stored points that the renderers read, as a distance.
  double stored_rounding_mm = 0.0;
  double static_friction = 0.0, dynamic_friction = 0.0;  ///< of the scene where it is uniform; 0 = none
  [[nodiscard]] double floor_n() const noexcept { return stiffness_n_per_mm * device_resolution_mm; }
};

/// A renderer counts as right when at least this share of the truth's contact frames is felt and in the band
/// (literature: 99 % of the force in the band).
inline constexpr double kRequiredSharePercent = 99.0;

/// Scores are empty where they do not apply (no contact, no reference), and counts are 0. Keys ending in
/// _percent run from 0 to 100.
struct Accuracy {
  std::string reference;  ///< name of the reference
  std::string exactness;  ///< how exact the reference is
  double floor_n = 0.0;
  /// Rounding of points and arithmetic along this path, as a distance and as spring force. An error within it
  /// counts as none.
  double rounding_n = 0.0, rounding_mm = 0.0;
  std::uint64_t frames = 0;
  std::uint64_t contact_frames = 0;  ///< |G|
  std::uint64_t episodes = 0;        ///< number of episodes in G

  std::optional<double> force_rms_n;                           ///< sqrt(sum over C of |F_r - F_g|^2 / |G|)
  std::optional<double> force_rms_percent;                     ///< in percent of sqrt(mean over G of |F_g|^2)
  std::optional<Interval> force_rms_percent_interval;          ///< 95 %, bootstrap over episodes
  std::optional<double> force_normal_rms_n;                    ///< the part along the true normal
  std::optional<double> force_tangential_rms_n;                ///< the part across the true normal
  std::optional<double> force_p50_percent, force_p95_percent;  ///< |F_r - F_g| over C, in the percent of
                                                               ///< force_rms_percent
  std::optional<double> force_max_n;
  /// Frames whose truth depends on history: their number, their share of the frames in true contact or
  /// depending on history, their force error, and force_rms_percent with them included. Needs a second
  /// reference.
  std::optional<std::uint64_t> history_frames;
  std::optional<double> history_percent, history_force_rms_n, force_rms_whole_percent;
  std::optional<double> within_7_percent;   ///< percent of G with |F_r - F_g| <= max(0.07 |F_g|, floor)
  std::optional<double> within_10_percent;  ///< the same with 0.10
  /// Angle between F_r and F_g over the frames with |F_g| at or above the floor; 180 where |F_r| is below it.
  /// Percentile by nearest rank.
  std::optional<double> direction_mean_deg, direction_p99_deg, direction_max_deg;

  /// Largest |F_r(n) - F_r(n-1)| - |F_g(n) - F_g(n-1)| over steps that touch C, at least 0. Steps at true
  /// edges are left out: those on which F_g jumps by more than stiffness x HIP travel + floor.
  std::optional<double> excess_jump_max_n;
  std::optional<std::uint64_t> excess_jumps;  ///< of these steps, those above the floor
  std::optional<double> excess_jumps_per_m;   ///< per metre of HIP travel over these steps

  /// |(F_r(n) - F_r(n-1)) - (F_g(n) - F_g(n-1))| over the same steps; it also sees steps in a wrong direction
  /// and late steps.
  std::optional<double> jump_error_max_n;
  std::optional<std::uint64_t> jump_errors;  ///< of these steps, those above the floor
  /// Delay of the rendered force: the delay of the truth, up to 200 samples, that fits F_r best, if it halves
  /// the squared error; else 0. Empty without rendered force.
  std::optional<double> lag_ms;

  /// Percent of the frames with |F_g| at or above the floor that have F_r != 0.
  std::optional<double> felt_percent;
  std::optional<std::uint64_t> missed_device_frames;  ///< F_r = 0 and d < -(device resolution)
  std::optional<std::uint64_t> false_device_frames;   ///< F_r != 0 and d > device resolution
  std::optional<std::uint64_t> missed_tenth_mm_frames, false_tenth_mm_frames;  ///< the same with 0.1 mm
  std::uint64_t missed_contact_frames = 0;  ///< F_r = 0 and d < -(local resolution)
  std::uint64_t false_contact_frames = 0;   ///< F_r != 0 and d > local resolution
  std::uint64_t longest_stick_frames = 0;   ///< longest run of consecutive false contact frames

  /// Artefacts that a hand feels as plainly wrong, over *all* frames, including those that depend on history
  /// (metrics/scores.cpp).
  std::optional<std::uint64_t> caught, caught_frames;  ///< g stays far from g*
  std::optional<std::uint64_t> lost, lost_frames;      ///< true contact, nothing felt
  std::optional<std::uint64_t> kicks;                  ///< steps of force that the truth does not have
  std::optional<double> force_peak_n;                  ///< largest |F_r|
  std::optional<double> force_peak_excess_percent;     ///< excess over the largest |F_g|

  /// Events: contact felt in an episode is lost while h is deeper inside than the local resolution. Needs
  /// local resolutions.
  std::optional<std::uint64_t> fall_throughs;
  /// Events, each one of: g is inside by more than the local resolution; the segment g(n-1) -> g(n) crosses
  /// matter deeper than that and g*(n-1) -> g*(n) does not; g stays on a sheet facing away from g*'s (normals
  /// over 90 degrees apart) while h travels more than the local resolution. Needs a TruthSurface and local
  /// resolutions.
  std::optional<std::uint64_t> pop_throughs;
  /// 95 % upper bound on the rate per episode where no such event occurred: 3 / episodes (rule of three).
  std::optional<double> pop_through_rate_upper_95;

  /// |g - g*| over frames in which both are in contact.
  std::optional<double> god_object_rms_mm, god_object_max_mm;
  /// |signed distance of g to the true surface| over frames of rendered contact. Needs a TruthSurface.
  std::optional<double> god_object_surface_rms_mm, god_object_surface_max_mm;

  /// d at the first and the last frame of each run of F_r != 0: largest magnitude and signed mean. A run cut
  /// by an end of the path has no onset or no release. The HIP travel of one frame bounds the precision.
  std::optional<double> onset_error_mm, onset_error_mean_mm;
  std::optional<double> release_error_mm, release_error_mean_mm;

  /// Largest difference of |F_r| between visits of exactly the same h with the same true force (within the
  /// floor). Empty where no h is visited twice.
  std::optional<double> path_dependence_n;

  /// Movement of stylus and hand caused by the force error at 20 to 500 Hz, over the touch threshold at that
  /// frequency: the largest ratio and its frequency (perception.cpp).
  std::optional<double> ripple_ratio, ripple_hz;
  /// Relief of the rendered god object that the true one lacks, over the touch threshold for that width: the
  /// largest of 1, 3 and 10 mm, and its width (perception.cpp).
  std::optional<double> relief_ratio, relief_width_mm;

  /// Percent of contact frames with F_r at or above the floor that violate Coulomb's law at the rendered god
  /// object: they pull (F_n <= 0) or have |F_t| > 1.05 mu_s F_n. F_n is the part of F_r along the true
  /// normal, F_t the rest. Needs friction and a TruthSurface.
  std::optional<double> friction_cone_percent;
  /// Median of | |F_t| / (mu_d F_n) - 1 | over slipping frames: g travels at least half as far as h.
  std::optional<double> friction_slip_error_percent;
  /// Percent of sticking and slipping frames whose force agrees with their motion. A frame sticks when g
  /// travels at most a hundredth as far as h, and must be inside the cone; a slipping frame must not have
  /// |F_t| < mu_d F_n / 2.
  std::optional<double> stick_slip_percent;
  /// Speed of g, 95th percentile, over frames with |F_t| < mu_d F_n / 2, which should stick.
  std::optional<double> stick_drift_mm_s;

  /// The headline: percent of frames that no human threshold tells from the truth, among those in which
  /// either force is above the floor. Such a frame has |F_r - F_g| <= max(0.07 |F_g|, floor) and a jump error
  /// into it of at most the floor.
  std::optional<double> indistinguishable_percent;
  std::optional<Interval> indistinguishable_interval;  ///< 95 %, bootstrap over episodes
};

/// The true surface's values at the rendered god objects. Stored with the per-frame scores, they let a trace
/// be scored again without the surface.
struct TruthSamples {
  std::vector<double> god_object_distance_mm;  ///< signed; 0 in frames without rendered contact
  std::vector<std::uint8_t> pop_throughs;      ///< events at this frame; empty without local resolutions
  std::vector<double>
      friction_ratio;  ///< |F_t| / F_n, 0 free, kPullsInward where F_n <= 0; empty without friction
};
/// The ratio of a force that pulls the device into the surface.
inline constexpr double kPullsInward = -1.0;
/// Lengths must agree. At most 131 distance queries a frame.
[[nodiscard]] TruthSamples sample_truth(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                        const trace::ReferenceTrace& reference, const TruthSurface& truth,
                                        const AccuracyOptions& options);

/// Per-frame scores for plots; each array is as long as the path, or empty where it does not apply.
struct AccuracyFrames {
  std::vector<float> force_error_n;        ///< |F_r - F_g|
  std::vector<float> excess_jump_n;        ///< excess_jump per frame, 0 at true edges and at the first frame
  std::vector<float> god_object_error_mm;  ///< |g - g*| where both are in contact, else 0
  std::vector<std::uint8_t> missed_contact;
  std::vector<std::uint8_t> false_contact;
  std::optional<TruthSamples> surface;
};

/// Checks that the contact flag and the force agree in every frame. A force without contact, or contact
/// without force although the god object is farther from the HIP than rounding, is an Error that names the
/// sample. The scores use the force alone.
[[nodiscard]] Status check_contact_flags(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                         const AccuracyOptions& options);

/// Computes all scores. Differing lengths, no samples or non-finite numbers are an Error, so a score is never
/// NaN. `truth` may be null. O(n log n), with up to 130 distance queries a frame.
[[nodiscard]] Result<Accuracy> score(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                     const trace::ReferenceTrace& reference, const TruthSurface* truth,
                                     const AccuracyOptions& options, AccuracyFrames* per_frame = nullptr);

/// Computes the same scores, bit for bit, from stored TruthSamples.
[[nodiscard]] Result<Accuracy> rescore(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                       const trace::ReferenceTrace& reference,
                                       const std::optional<TruthSamples>& answers,
                                       const AccuracyOptions& options, AccuracyFrames* per_frame = nullptr);

/// Clears every score except those of contact timing, of the whole and per frame. The truth is a rigid
/// surface without friction or texture, so scenes with more can only be compared by contact.
void keep_contact_scores(Accuracy& accuracy, AccuracyFrames& per_frame);

/// Passivity observer over a replay (Hannaford and Ryu 2002; control/coupling_and_passivity.h): E(n) = -sum
/// of (F(n-1) + F(n))/2 . (h(n) - h(n-1)), the energy put into the virtual model so far. The rule is exact
/// for a linear spring between samples: a frictionless spring returns to 0 on every closed path, and a
/// renderer below 0 has given more than it received. 1 N mm = 1 mJ.
struct Energy {
  std::optional<double> generated_percent;  ///< max(0, -min E) / max stored; nothing without contact
  double generated_mj = 0.0;                ///< max(0, -min E)
  double max_stored_mj = 0.0;  ///< max of |F|^2 / (2 k), which is k d^2 / 2 of the renderer's own depth
  double final_mj = 0.0;       ///< E at the end of the path
  double rounding_mj = 0.0;    ///< bound on the rounding of E itself: less has not been generated
  /// Largest fall of E - |F_r|^2 / (2 k) (energy put in minus energy stored in the spring) from any earlier
  /// moment of an episode, in percent of the most energy that the *true* contact stores in it; the worst
  /// episode. Needs a truth.
  std::optional<double> drawdown_percent;
  std::optional<double> drawdown_p50_percent;  ///< the median of the episodes
};
/// Observes the energy of a trace. Differing lengths are an Error. Applied to the reference's frames it shows
/// the effect of sampling alone. Takes one effective stiffness per model (deformation and coupling lower it);
/// a frame with no model or an index beyond the list uses the first. O(n).
[[nodiscard]] Result<Energy> observe_energy(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                            std::span<const double> stiffness_n_per_mm);
[[nodiscard]] inline Result<Energy> observe_energy(const trace::ProbePath& path,
                                                   const trace::ForceTrace& trace,
                                                   double stiffness_n_per_mm) {
  return observe_energy(path, trace, std::span<const double>(&stiffness_n_per_mm, 1));
}

/// Fills the drawdown by the truth's episodes. Differing lengths are an Error. O(n).
[[nodiscard]] Status observe_episodes(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                      const trace::ReferenceTrace& reference,
                                      std::span<const double> stiffness_n_per_mm, Energy& energy);

/// Converts the reference to a trace, for scoring, hashing and plotting.
[[nodiscard]] trace::ForceTrace as_trace(const trace::ReferenceTrace& reference);

}  // namespace palpate::metrics
