#include <palpate/accuracy.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
namespace {

constexpr double kDegPerRad = 57.295779513082320877;  // 180 / pi
constexpr double kMmPerM = 1000.0;
constexpr double kRuleOfThree =
    3.0;  // -ln 0.05, rounded up: 95 % bound on a rate after N trials without an event
constexpr double kDirectionPercentile = 99;  // direction_p99_deg

// Mean of squares and largest value, for the scores that come as a pair.
struct Spread {
  double sum_of_squares = 0.0, largest = 0.0;
  std::uint64_t count = 0;
  void add(double value) noexcept {
    sum_of_squares += value * value;
    largest = std::max(largest, std::abs(value));
    ++count;
  }
  [[nodiscard]] std::optional<double> rms() const {
    return count > 0 ? std::optional(std::sqrt(sum_of_squares / static_cast<double>(count))) : std::nullopt;
  }
  [[nodiscard]] std::optional<double> max() const {
    return count > 0 ? std::optional(largest) : std::nullopt;
  }
};

double angle_deg(const Vec3& a, const Vec3& b) {
  // atan2 keeps small angles, where acos of a rounded cosine loses half the digits.
  return std::atan2(a.cross(b).norm(), a.dot(b)) * kDegPerRad;
}

/// Possible difference of two right answers: rounding of stored points and of the arithmetic.
double rounding_mm(const trace::ProbePath& path, const AccuracyOptions& options) {
  double size_mm = 0.0;
  for (const Vec3& hip : path.hip_mm) size_mm = std::max(size_mm, hip.cwiseAbs().maxCoeff());
  return options.stored_rounding_mm + kConvergedPerSize * size_mm;
}

/// Sums of squares per episode, for the relative error and its interval.
struct ErrorSums {
  std::vector<double> error, wanted;
  /// In percent; empty counts: every episode once.
  [[nodiscard]] std::optional<double> percent(std::span<const std::uint32_t> counts) const {
    double above = 0.0, below = 0.0;
    for (std::size_t e = 0; e < error.size(); ++e) {
      const double times = counts.empty() ? 1.0 : static_cast<double>(counts[e]);
      above += times * error[e];
      below += times * wanted[e];
    }
    return below > 0.0 ? std::optional(kToPercent * std::sqrt(above / below)) : std::nullopt;
  }
};

void score_forces(const ScoreInput& in, const Episodes& episodes, Accuracy& a) {
  Spread error, normal, tangential, wanted;
  ErrorSums sums{std::vector<double>(episodes.count), std::vector<double>(episodes.count)};
  std::vector<double> sizes;
  std::uint64_t within_jnd = 0, within_deadband = 0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.in_either_contact(i)) continue;
    const Vec3 difference = in.rendered(i) - in.wanted(i);
    const double size = difference.norm();
    const double true_size = in.wanted(i).norm();
    const double along = difference.dot(in.truth[i].normal);
    error.add(size);
    normal.add(along);
    tangential.add((difference - along * in.truth[i].normal).norm());
    sizes.push_back(size);
    sums.error[episodes.of_frame[i]] += size * size;
    sums.wanted[episodes.of_frame[i]] += true_size * true_size;
    if (!in.in_true_contact(i)) continue;
    wanted.add(true_size);
    within_jnd += size <= std::max(kForceJnd * true_size, a.floor_n) ? 1u : 0u;
    within_deadband += size <= std::max(kForceDeadband * true_size, a.floor_n) ? 1u : 0u;
  }
  a.contact_frames = wanted.count;
  a.force_max_n = error.max();
  if (wanted.count == 0) return;
  // Divides by the truth's frames, however many the renderer adds.
  error.count = normal.count = tangential.count = wanted.count;
  a.force_rms_n = error.rms();
  a.force_normal_rms_n = normal.rms();
  a.force_tangential_rms_n = tangential.rms();
  a.force_rms_percent = sums.percent({});
  a.force_rms_percent_interval = bootstrap(
      episodes.count, [&](std::span<const std::uint32_t> counts, Random&) { return sums.percent(counts); });
  std::sort(sizes.begin(), sizes.end());
  const double per_newton = kToPercent / *wanted.rms();
  constexpr double kMiddle = 50.0, kMost = 95.0;
  a.force_p50_percent = per_newton * nearest_rank(sizes, kMiddle);
  a.force_p95_percent = per_newton * nearest_rank(sizes, kMost);
  const double per_frame = kToPercent / static_cast<double>(wanted.count);
  a.within_7_percent = per_frame * static_cast<double>(within_jnd);
  a.within_10_percent = per_frame * static_cast<double>(within_deadband);
}

void score_direction(const ScoreInput& in, Accuracy& a) {
  constexpr double kLostDeg = 180.0;  // opposite
  std::vector<double> angles;
  double sum = 0.0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.in_true_contact(i) || in.wanted(i).norm() < a.floor_n) continue;
    // Two forces just above and below the floor do not count as lost.
    const Vec3& rendered = in.rendered(i);
    const bool missed = rendered.norm() < a.floor_n && (rendered - in.wanted(i)).norm() >= a.floor_n;
    const bool lost = !felt(rendered) || missed;
    angles.push_back(lost ? kLostDeg : angle_deg(in.rendered(i), in.wanted(i)));
    sum += angles.back();
  }
  if (angles.empty()) return;
  std::sort(angles.begin(), angles.end());
  a.direction_mean_deg = sum / static_cast<double>(angles.size());
  a.direction_p99_deg = nearest_rank(angles, kDirectionPercentile);
  a.direction_max_deg = angles.back();
}

void score_jumps(const ScoreInput& in, Accuracy& a, AccuracyFrames* out) {
  double largest = 0.0, largest_error = 0.0, travel_mm = 0.0;
  std::uint64_t steps = 0, jumps = 0, errors = 0;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    if (!in.decided_step(i) || (!in.in_either_contact(i) && !in.in_either_contact(i - 1))) continue;
    if (in.true_edge(i, a.floor_n)) continue;
    const double excess =
        (in.rendered(i) - in.rendered(i - 1)).norm() - (in.wanted(i) - in.wanted(i - 1)).norm();
    const double error = in.jump_error_n(i);
    ++steps;
    travel_mm += in.travel_mm(i);
    largest = std::max(largest, excess);
    largest_error = std::max(largest_error, error);
    jumps += excess > a.floor_n ? 1u : 0u;
    errors += error > a.floor_n ? 1u : 0u;
    if (out != nullptr) out->excess_jump_n[i] = static_cast<float>(std::max(0.0, excess));
  }
  a.excess_jumps = jumps;
  a.jump_errors = errors;
  if (steps == 0) return;
  a.excess_jump_max_n = largest;
  a.jump_error_max_n = largest_error;
  if (travel_mm > 0.0) a.excess_jumps_per_m = static_cast<double>(jumps) * kMmPerM / travel_mm;
}

void score_contact(const ScoreInput& in, Accuracy& a, AccuracyFrames* out) {
  std::uint64_t run = 0, shown = 0, felt_frames = 0;
  a.missed_device_frames = a.false_device_frames = a.missed_tenth_mm_frames = a.false_tenth_mm_frames = 0;
  const double device_mm = in.options.device_resolution_mm + a.rounding_mm;
  const double tenth_mm = kContactToleranceMm + a.rounding_mm;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.decided(i)) {
      run = 0;
      continue;
    }
    const double d = in.truth[i].signed_distance_mm;
    const double allowed = in.truth[i].local_resolution_mm;
    const bool answers = felt(in.rendered(i));
    const bool missed = !answers && d < -allowed;
    const bool phantom = answers && d > allowed;
    a.missed_contact_frames += missed ? 1u : 0u;
    a.false_contact_frames += phantom ? 1u : 0u;
    *a.missed_device_frames += !answers && d < -device_mm ? 1u : 0u;
    *a.false_device_frames += answers && d > device_mm ? 1u : 0u;
    *a.missed_tenth_mm_frames += !answers && d < -tenth_mm ? 1u : 0u;
    *a.false_tenth_mm_frames += answers && d > tenth_mm ? 1u : 0u;
    const bool is_shown = in.in_true_contact(i) && in.wanted(i).norm() >= a.floor_n;
    shown += is_shown ? 1u : 0u;
    felt_frames += is_shown && answers ? 1u : 0u;
    run = phantom ? run + 1 : 0;
    a.longest_stick_frames = std::max(a.longest_stick_frames, run);
    if (out == nullptr) continue;
    out->missed_contact[i] = missed ? 1 : 0;
    out->false_contact[i] = phantom ? 1 : 0;
  }
  if (shown > 0) a.felt_percent = percent_of(felt_frames, shown);
}

/// Scores of frames that depend on history, and the measure over all frames.
void score_history(const ScoreInput& in, const trace::ReferenceTrace& reference, Accuracy& a) {
  if (!reference.compared) return;
  Spread apart, all;
  double wanted = 0.0;
  std::uint64_t contact = 0, undecided = 0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    const double error = (in.rendered(i) - in.wanted(i)).norm();
    undecided += in.decided(i) ? 0u : 1u;
    contact += !in.decided(i) || felt(in.wanted(i)) ? 1u : 0u;
    if (!in.decided(i)) apart.add(error);
    all.add(error);
    wanted += in.wanted(i).squaredNorm();
  }
  a.history_frames = undecided;
  if (contact > 0) a.history_percent = percent_of(undecided, contact);
  if (wanted > 0.0) a.force_rms_whole_percent = kToPercent * std::sqrt(all.sum_of_squares / wanted);
  if (apart.count > 0) a.history_force_rms_n = apart.rms();
}

// Contact felt in an episode and then lost deep inside.
void score_fall_throughs(const ScoreInput& in, Accuracy& a) {
  a.fall_throughs = 0;
  bool had = false, counted = false;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.in_true_contact(i)) {
      had = counted = false;
    } else if (felt(in.rendered(i))) {
      had = true;
      counted = false;
    } else if (had && !counted && in.truth[i].signed_distance_mm < -in.truth[i].local_resolution_mm) {
      counted = true;
      ++*a.fall_throughs;
    }
  }
}

void score_god_object(const ScoreInput& in, const TruthSamples* answers, Accuracy& a, AccuracyFrames* out) {
  Spread distance, off_surface;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.decided(i) || !in.frames[i].contact) continue;
    if (answers != nullptr) off_surface.add(answers->god_object_distance_mm[i]);
    if (!in.truth[i].frame.contact) continue;
    const double error = (in.frames[i].god_object_mm - in.truth[i].frame.god_object_mm).norm();
    distance.add(error);
    if (out != nullptr) out->god_object_error_mm[i] = static_cast<float>(error);
  }
  a.god_object_rms_mm = distance.rms();
  a.god_object_max_mm = distance.max();
  a.god_object_surface_rms_mm = off_surface.rms();
  a.god_object_surface_max_mm = off_surface.max();
}

void score_onset_and_release(const ScoreInput& in, Accuracy& a) {
  struct Event {
    double largest = 0.0, sum = 0.0;
    std::uint64_t count = 0;
    void add(double d) noexcept {
      largest = std::max(largest, std::abs(d));
      sum += d;
      ++count;
    }
  } onset, release;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    if (!in.decided_step(i)) continue;
    const bool now = felt(in.rendered(i)), before = felt(in.rendered(i - 1));
    if (now && !before) onset.add(in.truth[i].signed_distance_mm);
    if (!now && before) release.add(in.truth[i - 1].signed_distance_mm);
  }
  if (onset.count > 0) {
    a.onset_error_mm = onset.largest;
    a.onset_error_mean_mm = onset.sum / static_cast<double>(onset.count);
  }
  if (release.count > 0) {
    a.release_error_mm = release.largest;
    a.release_error_mean_mm = release.sum / static_cast<double>(release.count);
  }
}

// Finds repeated HIP positions by sorting; spread of |F_r| among those with equal truth.
void score_path_dependence(const ScoreInput& in, Accuracy& a) {
  std::vector<std::uint32_t> order;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (in.in_either_contact(i)) order.push_back(static_cast<std::uint32_t>(i));
  }
  const auto place = [&](std::uint32_t i) {
    const Vec3& h = in.path.hip_mm[i];
    return std::array<double, 3>{h.x(), h.y(), h.z()};
  };
  std::sort(order.begin(), order.end(), [&](std::uint32_t l, std::uint32_t r) {
    const auto pl = place(l), pr = place(r);
    return pl != pr ? pl < pr : l < r;
  });
  for (std::size_t k = 1, first = 0; k < order.size(); ++k) {
    if (place(order[k]) != place(order[first])) {
      first = k;
      continue;
    }
    if ((in.wanted(order[k]) - in.wanted(order[first])).norm() > a.floor_n) continue;  // another sheet
    const double difference = std::abs(in.rendered(order[k]).norm() - in.rendered(order[first]).norm());
    a.path_dependence_n = std::max(a.path_dependence_n.value_or(0.0), difference);
  }
}

}  // namespace

Status check_lengths(const trace::ProbePath& path, std::size_t frames, std::string_view what) {
  if (path.size() == 0 || path.hip_mm.size() != path.size())
    return Error{"the path has no samples", "", path.name};
  if (frames != path.size())
    return Error{std::string(what) + " has " + std::to_string(frames) + " frames, the path " +
                     std::to_string(path.size()),
                 "score a trace with the path it was made from", path.name};
  return Done{};
}

Status check_finite(const trace::ProbePath& path, const std::vector<render::Frame>& frames,
                    std::string_view what) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (is_finite(path.hip_mm[i]) && is_finite(frames[i].force_n) && is_finite(frames[i].god_object_mm))
      continue;
    return Error{std::string(what) + " or the path is not finite at sample " + std::to_string(i),
                 "scores need finite numbers throughout", path.name, static_cast<std::int64_t>(i) + 2};
  }
  return Done{};
}

trace::ForceTrace as_trace(const trace::ReferenceTrace& reference) {
  trace::ForceTrace trace;
  trace.label = reference.name;
  trace.frames.reserve(reference.frames.size());
  for (const trace::TruthFrame& frame : reference.frames) trace.frames.push_back(frame.frame);
  return trace;
}

namespace {

/// Checks equal lengths and finite numbers.
Status check_all(const trace::ProbePath& path, const trace::ForceTrace& trace,
                 const trace::ReferenceTrace& reference) {
  PALPATE_TRY(check_lengths(path, trace.frames.size(), "the trace"));
  PALPATE_TRY(check_lengths(path, reference.frames.size(), "the reference"));
  PALPATE_TRY(check_finite(path, trace.frames, "the trace"));
  PALPATE_TRY(check_finite(path, as_trace(reference).frames, "the reference"));
  for (const trace::TruthFrame& frame : reference.frames) {
    if (is_finite(frame.normal) && std::isfinite(frame.signed_distance_mm) &&
        std::isfinite(frame.local_resolution_mm))
      continue;
    return Error{"the reference has a normal, distance or resolution that is not finite", "", path.name};
  }
  return Done{};
}

bool has_resolution(const trace::ReferenceTrace& reference) {
  return std::any_of(reference.frames.begin(), reference.frames.end(),
                     [](const auto& f) { return f.local_resolution_mm > 0.0; });
}

}  // namespace

TruthSamples sample_truth(const trace::ProbePath& path, const trace::ForceTrace& trace,
                          const trace::ReferenceTrace& reference, const TruthSurface& truth,
                          const AccuracyOptions& options) {
  TruthSamples answers;
  answers.god_object_distance_mm.reserve(trace.frames.size());
  for (const render::Frame& frame : trace.frames)
    answers.god_object_distance_mm.push_back(frame.contact ? truth.signed_distance_mm(frame.god_object_mm)
                                                           : 0.0);
  if (options.static_friction > 0.0 || options.dynamic_friction > 0.0)
    answers.friction_ratio = friction_ratios(trace, truth);
  if (has_resolution(reference)) answers.pop_throughs = find_pop_throughs(path, trace, reference, truth);
  return answers;
}

Result<Accuracy> score(const trace::ProbePath& path, const trace::ForceTrace& trace,
                       const trace::ReferenceTrace& reference, const TruthSurface* truth,
                       const AccuracyOptions& options, AccuracyFrames* per_frame) {
  PALPATE_TRY(check_all(path, trace, reference));
  std::optional<TruthSamples> answers;
  if (truth != nullptr) answers = sample_truth(path, trace, reference, *truth, options);
  return rescore(path, trace, reference, answers, options, per_frame);
}

Result<Accuracy> rescore(const trace::ProbePath& path, const trace::ForceTrace& trace,
                         const trace::ReferenceTrace& reference, const std::optional<TruthSamples>& answers,
                         const AccuracyOptions& options, AccuracyFrames* per_frame) {
  PALPATE_TRY(check_all(path, trace, reference));
  const std::size_t n = path.size();
  if (answers && (answers->god_object_distance_mm.size() != n ||
                  (!answers->pop_throughs.empty() && answers->pop_throughs.size() != n) ||
                  (!answers->friction_ratio.empty() && answers->friction_ratio.size() != n)))
    return Error{"the answers of the true surface are not of this trace", "", path.name};
  if (per_frame != nullptr) {
    *per_frame = {std::vector<float>(n),        std::vector<float>(n),        std::vector<float>(n),
                  std::vector<std::uint8_t>(n), std::vector<std::uint8_t>(n), answers};
    for (std::size_t i = 0; i < n; ++i) {
      per_frame->force_error_n[i] =
          static_cast<float>((trace.frames[i].force_n - reference.frames[i].frame.force_n).norm());
    }
  }
  const ScoreInput in{path, trace.frames, reference.frames, options};
  Accuracy a;
  a.reference = reference.name;
  a.exactness = reference.exactness;
  a.floor_n = options.floor_n();
  a.rounding_mm = rounding_mm(path, options);
  a.rounding_n = options.stiffness_n_per_mm * a.rounding_mm;
  a.frames = n;
  const Episodes episodes = episodes_of(reference.frames);
  a.episodes = episodes.in_contact;
  score_forces(in, episodes, a);
  score_direction(in, a);
  score_jumps(in, a, per_frame);
  score_contact(in, a, per_frame);
  score_history(in, reference, a);
  score_god_object(in, answers ? &*answers : nullptr, a, per_frame);
  score_onset_and_release(in, a);
  score_path_dependence(in, a);
  score_perception(in, episodes, a);
  score_artefacts(in, a);
  if (answers) score_friction(in, *answers, a);
  if (has_resolution(reference)) score_fall_throughs(in, a);
  if (answers && !answers->pop_throughs.empty()) {
    a.pop_throughs = 0;
    for (std::size_t i = 0; i < n; ++i) *a.pop_throughs += in.decided(i) ? answers->pop_throughs[i] : 0u;
    if (*a.pop_throughs == 0 && a.fall_throughs.value_or(0) == 0 && a.episodes > 0)
      a.pop_through_rate_upper_95 = kRuleOfThree / static_cast<double>(a.episodes);
  }
  return a;
}

Status check_contact_flags(const trace::ProbePath& path, const trace::ForceTrace& trace,
                           const AccuracyOptions& options) {
  PALPATE_TRY(check_lengths(path, trace.frames.size(), "the trace"));
  const double least_mm = rounding_mm(path, options);
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const render::Frame& frame = trace.frames[i];
    const double off_mm = (frame.god_object_mm - path.hip_mm[i]).norm();
    const bool flag_alone = frame.contact && !felt(frame.force_n) && off_mm > least_mm;
    const bool force_alone = !frame.contact && felt(frame.force_n);
    if (!flag_alone && !force_alone) continue;
    return Error{
        std::string(force_alone ? "it answers a force and says that nothing is in contact"
                                : "it says contact and answers no force, its god object off the HIP") +
            ", at sample " + std::to_string(i),
        "a renderer's contact flag and its force must agree: see docs/reference/scores.md", path.name,
        static_cast<std::int64_t>(i) + 2};
  }
  return Done{};
}

void keep_contact_scores(Accuracy& a, AccuracyFrames& per_frame) {
  for (std::optional<double>* score : {&a.force_rms_n,
                                       &a.force_rms_percent,
                                       &a.force_normal_rms_n,
                                       &a.force_tangential_rms_n,
                                       &a.force_max_n,
                                       &a.within_7_percent,
                                       &a.within_10_percent,
                                       &a.direction_mean_deg,
                                       &a.force_p50_percent,
                                       &a.force_p95_percent,
                                       &a.direction_p99_deg,
                                       &a.direction_max_deg,
                                       &a.excess_jump_max_n,
                                       &a.excess_jumps_per_m,
                                       &a.jump_error_max_n,
                                       &a.lag_ms,
                                       &a.ripple_ratio,
                                       &a.ripple_hz,
                                       &a.relief_ratio,
                                       &a.relief_width_mm,
                                       &a.indistinguishable_percent,
                                       &a.history_force_rms_n,
                                       &a.force_rms_whole_percent,
                                       &a.god_object_rms_mm,
                                       &a.god_object_max_mm,
                                       &a.god_object_surface_rms_mm,
                                       &a.god_object_surface_max_mm,
                                       &a.path_dependence_n,
                                       &a.force_peak_n,
                                       &a.force_peak_excess_percent})
    score->reset();
  for (std::optional<std::uint64_t>* count : {&a.caught, &a.caught_frames, &a.kicks}) count->reset();
  a.excess_jumps.reset();
  a.jump_errors.reset();
  a.force_rms_percent_interval.reset();
  a.indistinguishable_interval.reset();
  for (std::vector<float>* frames :
       {&per_frame.force_error_n, &per_frame.excess_jump_n, &per_frame.god_object_error_mm})
    frames->clear();
}

}  // namespace palpate::metrics
