// Scores of a force trace against the truth, open loop: design.md section 4 names the keys, the definitions
// follow the literature page's section on metrics. F_r is the rendered force, F_g the true one at the same
// sample, h the HIP, d its signed distance (negative inside), g and g* the rendered and the true god object.
// G = frames where F_g is not zero, the truth's contact frames; C = those where F_r or F_g is not zero. What
// a renderer answers outside of G counts as error and never as a frame more to share it: the denominators are
// the truth's. Frames in which the way decides what is right (trace::TruthFrame::history_decides) belong to
// neither G nor C, and to no score but those named for them. An *episode* is a stretch of G without a gap;
// what is felt after it and before the next one belongs to it. Frames of an episode follow each other, so
// bounds are taken over episodes. The *floor* is stiffness x device resolution: the smallest force step the
// device can show.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/bootstrap.h"
#include "toolkit/core/result.h"
#include "toolkit/metrics/truth.h"
#include "toolkit/trace/trace.h"

namespace palpate::metrics {

/// Position resolution of the Phantom Omni, 450 dpi (section 3.6 of the thesis): the length behind the floor.
inline constexpr double kOmniResolutionMm = 0.055;
/// The coarser of the two tolerances of contact that are lengths of a hand, not of a cloud.
inline constexpr double kTenthMm = 0.1;
/// Caught: the rendered god object is farther from the true one than this, or than two spacings of the points
/// where those are larger. What lasts shorter than kMomentS no hand makes out.
inline constexpr double kCaughtMm = 1.0, kCaughtSpacings = 2.0, kMomentS = 0.02;
/// Weber deadband of haptic codecs (IEEE 1918.1.1): the band of within_10_percent.
inline constexpr double kForceDeadband = 0.10;

struct AccuracyOptions {
  double stiffness_n_per_mm = 0.5;
  double device_resolution_mm = kOmniResolutionMm;
  /// What the renderers' input lost before they saw it: the rounding of a stored point, as a distance.
  double stored_rounding_mm = 0.0;
  double static_friction = 0.0, dynamic_friction = 0.0;  ///< of the scene where it is uniform; 0: none
  [[nodiscard]] double floor_n() const noexcept { return stiffness_n_per_mm * device_resolution_mm; }
};

/// Share of the truth's contact frames that must be felt, and within the band, before anybody says that a
/// renderer is right (literature: force in band, 99 %).
inline constexpr double kRightSharePercent = 99.0;

/// A score that does not apply (no contact, no reference for it) is nothing; counts are 0 then. Every key
/// that ends in _percent is in percent, 0 to 100.
struct Accuracy {
  std::string reference;  ///< name of the reference
  std::string exactness;  ///< how exact that is
  double floor_n = 0.0;
  /// Rounding of points and arithmetic along this path, as a distance and as the force of the spring over it.
  /// An error that is no larger is none: who has it answers exactly.
  double rounding_n = 0.0, rounding_mm = 0.0;
  std::uint64_t frames = 0;
  std::uint64_t contact_frames = 0;  ///< |G|
  std::uint64_t episodes = 0;        ///< of G

  std::optional<double> force_rms_n;                           ///< sqrt(sum over C of |F_r - F_g|^2 / |G|)
  std::optional<double> force_rms_percent;                     ///< of sqrt(mean over G of |F_g|^2)
  std::optional<Interval> force_rms_percent_interval;          ///< 95 %, bootstrap over episodes
  std::optional<double> force_normal_rms_n;                    ///< the part along the true normal
  std::optional<double> force_tangential_rms_n;                ///< the part across it
  std::optional<double> force_p50_percent, force_p95_percent;  ///< of |F_r - F_g| over C, in percent as above
  std::optional<double> force_max_n;
  /// Frames in which history decides; nothing without a second reference. Their share is of those in which
  /// the truth is in contact or history decides. Their force error, and force_rms_percent with them counted.
  std::optional<std::uint64_t> history_frames;
  std::optional<double> history_percent, history_force_rms_n, force_rms_whole_percent;
  std::optional<double> within_7_percent;   ///< percent of G with |F_r - F_g| <= max(0.07 |F_g|, floor)
  std::optional<double> within_10_percent;  ///< the same with 0.10
  /// Angle between F_r and F_g over the frames where F_g is at or above the floor; where F_r is below, the
  /// force is lost and counts as 180. Percentile by nearest rank.
  std::optional<double> direction_mean_deg, direction_p99_deg, direction_max_deg;

  /// Largest |F_r(n) - F_r(n-1)| - |F_g(n) - F_g(n-1)| over steps that touch C, without true edges: steps on
  /// which F_g itself jumps by more than stiffness x HIP travel + floor. Never below 0.
  std::optional<double> excess_jump_max_n;
  std::optional<std::uint64_t> excess_jumps;  ///< steps of these above the floor
  std::optional<double> excess_jumps_per_m;   ///< per metre of HIP travel over these steps

  /// |(F_r(n) - F_r(n-1)) - (F_g(n) - F_g(n-1))| over the same steps: a step the wrong way, or one that comes
  /// late, is seen too.
  std::optional<double> jump_error_max_n;
  std::optional<std::uint64_t> jump_errors;  ///< steps of these above the floor
  /// By how much later than the truth the force comes: the delay of the truth, up to 200 samples, that is
  /// nearest to the rendered force, where it takes away half of the squared error; else 0. Nothing without
  /// rendered force.
  std::optional<double> lag_ms;

  /// Percent of the frames with |F_g| at or above the floor in which F_r is not zero.
  std::optional<double> felt_percent;
  std::optional<std::uint64_t> missed_device_frames;  ///< F_r = 0 and d < -(device resolution)
  std::optional<std::uint64_t> false_device_frames;   ///< F_r != 0 and d > device resolution
  std::optional<std::uint64_t> missed_tenth_mm_frames, false_tenth_mm_frames;  ///< the same with 0.1 mm
  std::uint64_t missed_contact_frames = 0;  ///< F_r = 0 and d < -(local resolution)
  std::uint64_t false_contact_frames = 0;   ///< F_r != 0 and d > local resolution
  std::uint64_t longest_stick_frames = 0;   ///< longest run of consecutive false contact frames

  /// What a hand feels as plainly wrong, over *all* frames, those in which history decides too. See
  /// wrong_moments.cpp.
  std::optional<std::uint64_t> caught, caught_frames;  ///< g stays far from g*
  std::optional<std::uint64_t> lost, lost_frames;      ///< true contact, nothing felt
  std::optional<std::uint64_t> kicks;                  ///< steps of force that the truth has not
  std::optional<double> force_peak_n;                  ///< largest |F_r|
  std::optional<double> force_peak_excess_percent;     ///< by how much it is above the largest |F_g|

  /// Events; nothing without local resolutions: contact that was felt in an episode is lost while h is deeper
  /// inside than the local resolution.
  std::optional<std::uint64_t> fall_throughs;
  /// Events; nothing without a TruthSurface or without local resolutions. One of: g gets inside by more than
  /// the local resolution; the step g(n-1) -> g(n) leads through matter deeper than that, and the true step
  /// g*(n-1) -> g*(n) does not; or g stays on a
  /// sheet that faces away from g*'s (normals more than 90 degrees apart) while h travels more than the local
  /// resolution.
  std::optional<std::uint64_t> pop_throughs;
  /// 95 % upper bound on the rate per episode where neither was seen: 3 / episodes (rule of three).
  std::optional<double> pop_through_rate_upper_95;

  /// |g - g*| over frames in contact in both.
  std::optional<double> god_object_rms_mm, god_object_max_mm;
  /// |signed distance of g to the true surface| over frames of rendered contact; needs a TruthSurface.
  std::optional<double> god_object_surface_rms_mm, god_object_surface_max_mm;

  /// d at the first and last frame of each run of F_r != 0: largest magnitude, and signed mean. A run cut off
  /// by an end of the path has no onset or no release. A sampled path cannot show less than its travel in one
  /// frame.
  std::optional<double> onset_error_mm, onset_error_mean_mm;
  std::optional<double> release_error_mm, release_error_mean_mm;

  /// Largest difference of |F_r| between visits of exactly the same h with the same true force (to the
  /// floor); nothing where no h is visited twice.
  std::optional<double> path_dependence_n;

  /// What stays of the force error at 20 to 500 Hz, as a movement of stylus and hand, over what touch notices
  /// at that frequency: the largest of all frequencies, and where. See felt.cpp.
  std::optional<double> ripple_ratio, ripple_hz;
  /// Relief of the rendered god object that the true one has not, over what touch notices of that width: the
  /// largest of 1, 3 and 10 mm, and which. See felt.cpp.
  std::optional<double> relief_ratio, relief_width_mm;

  /// Friction, by Coulomb's law and the true normal n at the rendered god object; nothing without friction or
  /// a TruthSurface. F_n is the part of F_r along n, F_t the rest. Percent of the frames in contact, with F_r
  /// at or above the floor, that pull (F_n <= 0) or have |F_t| > 1.05 mu_s F_n.
  std::optional<double> friction_cone_percent;
  /// Median of | |F_t| / (mu_d F_n) - 1 | over frames that slip: g goes by at least half of h's way.
  std::optional<double> friction_slip_error_percent;
  /// Percent of the frames that stick (g goes by at most a hundredth of h's way) or slip that do what their
  /// force says: who sticks is inside the cone, who slips is not in its inner half, |F_t| < mu_d F_n / 2.
  std::optional<double> stick_slip_percent;
  /// Speed of g, 95th percentile, over frames with |F_t| < mu_d F_n / 2, which should stick.
  std::optional<double> stick_drift_mm_s;

  /// The headline: percent of frames that no human threshold tells from the truth, among those in which
  /// either force is above the floor. A frame counts where |F_r - F_g| <= max(0.07 |F_g|, floor), and the
  /// jump error into it is at most the floor.
  std::optional<double> indistinguishable_percent;
  std::optional<Interval> indistinguishable_interval;  ///< 95 %, bootstrap over episodes
};

/// What the true surface answers about the rendered god objects: all that scores need of the surface beyond
/// the reference trace. Kept with the per-frame scores, it lets a trace be scored again where the surface is
/// no longer at hand.
struct SurfaceAnswers {
  std::vector<double> god_object_distance_mm;  ///< signed; 0 in frames without rendered contact
  std::vector<std::uint8_t> pop_throughs;      ///< events at this frame; empty without local resolutions
  std::vector<double> friction_ratio;  ///< |F_t| / F_n, 0 free, kPulls where F_n <= 0; empty without friction
};
/// The ratio of a force that pulls the device into the surface.
inline constexpr double kPulls = -1.0;
/// Lengths must agree. At most 131 distance queries a frame.
[[nodiscard]] SurfaceAnswers ask_surface(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                         const trace::ReferenceTrace& reference, const TruthSurface& truth,
                                         const AccuracyOptions& options);

/// Per frame, for plots and for scoring again; each as long as the path, or empty where it does not apply.
struct AccuracyFrames {
  std::vector<float> force_error_n;        ///< |F_r - F_g|
  std::vector<float> excess_jump_n;        ///< as above, 0 at true edges and at the first frame
  std::vector<float> god_object_error_mm;  ///< |g - g*| in contact in both, else 0
  std::vector<std::uint8_t> missed_contact;
  std::vector<std::uint8_t> false_contact;
  std::optional<SurfaceAnswers> surface;
};

/// Contact and force must agree in every frame: a force without contact, or contact without a force though
/// the god object is farther from the HIP than rounding, is an Error that names the sample. What a
/// renderer says of contact is scored by its force; a flag that says something else would escape.
[[nodiscard]] Status check_contact_flags(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                         const AccuracyOptions& options);

/// All scores. Lengths that differ, no samples, or numbers that are not finite are an Error: a score is never
/// NaN. `truth` may be null. O(n log n), with up to 130 distance queries a frame.
[[nodiscard]] Result<Accuracy> score(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                     const trace::ReferenceTrace& reference, const TruthSurface* truth,
                                     const AccuracyOptions& options, AccuracyFrames* per_frame = nullptr);

/// The same from recorded answers of the surface, where there are any: the same scores, to the last bit.
[[nodiscard]] Result<Accuracy> score_again(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                           const trace::ReferenceTrace& reference,
                                           const std::optional<SurfaceAnswers>& answers,
                                           const AccuracyOptions& options,
                                           AccuracyFrames* per_frame = nullptr);

/// The truth is of a rigid surface without friction or texture: where a scene has more, only whether and when
/// there is contact can be compared. Takes away every other score, of the whole and of the frames.
void keep_contact_scores(Accuracy& accuracy, AccuracyFrames& per_frame);

/// The passivity observer (Hannaford and Ryu 2002; control/passivity.h) over a replay: E(n) = -sum of (F(n-1)
/// + F(n))/2 . (h(n) - h(n-1)), the energy put into the virtual model so far, exact for a linear spring
/// between samples. A frictionless spring returns to 0 on every closed path; below 0 the renderer has given
/// more than it got. 1 N mm = 1 mJ.
struct Energy {
  std::optional<double> generated_percent;  ///< max(0, -min E) / max stored; nothing without contact
  double generated_mj = 0.0;                ///< max(0, -min E)
  double max_stored_mj = 0.0;  ///< max of |F|^2 / (2 k), which is k d^2 / 2 of the renderer's own depth
  double final_mj = 0.0;       ///< E at the end of the path
  double rounding_mj = 0.0;    ///< bound on the rounding of E itself: less has not been generated
  /// By episode: the largest fall of E - |F_r|^2 / (2 k), what is put in less what a spring would still hold,
  /// from any earlier moment, in percent of the most energy that the *true* contact stores in it. The worst
  /// episode; nothing without a truth.
  std::optional<double> drawdown_percent;
  std::optional<double> drawdown_p50_percent;  ///< the median of the episodes
};
/// Needs no truth; lengths that differ are an Error. Apply it to the reference's frames to see what sampling
/// alone does. One stiffness for each model of the scene, as felt (a deformation or a coupling lowers it); a
/// frame that names no model, or one beyond the list, takes the first. O(n).
[[nodiscard]] Result<Energy> observe_energy(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                            std::span<const double> stiffness_n_per_mm);
[[nodiscard]] inline Result<Energy> observe_energy(const trace::ProbePath& path,
                                                   const trace::ForceTrace& trace,
                                                   double stiffness_n_per_mm) {
  return observe_energy(path, trace, std::span<const double>(&stiffness_n_per_mm, 1));
}

/// Fills the drawdown, by the truth's episodes. Lengths that differ are an Error. O(n).
[[nodiscard]] Status observe_episodes(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                      const trace::ReferenceTrace& reference,
                                      std::span<const double> stiffness_n_per_mm, Energy& energy);

/// The reference as a trace, so that it can be scored, hashed and plotted like any other.
[[nodiscard]] trace::ForceTrace as_trace(const trace::ReferenceTrace& reference);

}  // namespace palpate::metrics
