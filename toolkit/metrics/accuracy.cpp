#include "toolkit/metrics/accuracy.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "toolkit/control/passivity.h"
#include "toolkit/core/nearest_rank.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/core/try.h"
#include "toolkit/metrics/pop_through.h"
#include "toolkit/metrics/reference.h"
#include "toolkit/trace/replay.h"

namespace palpate::metrics {
namespace {

constexpr double kDegPerRad = 57.295779513082320877;  // 180 / pi
constexpr double kMmPerM = 1000.0;
constexpr double kToPercent = 100.0;
constexpr double kRuleOfThree =
    3.0;  // -ln 0.05, rounded up: 95 % bound on a rate after N trials without an event
constexpr double kDirectionPercentile = 99;  // direction_p99_deg

bool felt(const Vec3& force_n) noexcept {
  return force_n != Vec3::Zero();
}

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

// Everything score() reads, under short names.
struct Input {
  const trace::ProbePath& path;
  const std::vector<render::Frame>& frames;
  const std::vector<trace::TruthFrame>& truth;
  const AccuracyOptions& options;

  [[nodiscard]] const Vec3& rendered(std::size_t i) const { return frames[i].force_n; }
  [[nodiscard]] const Vec3& wanted(std::size_t i) const { return truth[i].frame.force_n; }
  [[nodiscard]] bool in_c(std::size_t i) const { return felt(rendered(i)) || felt(wanted(i)); }
  [[nodiscard]] double travel_mm(std::size_t i) const { return (path.hip_mm[i] - path.hip_mm[i - 1]).norm(); }
};

double angle_deg(const Vec3& a, const Vec3& b) {
  // atan2 of sine and cosine keeps small angles, where acos of a rounded cosine loses half its digits.
  return std::atan2(a.cross(b).norm(), a.dot(b)) * kDegPerRad;
}

/// How far apart two right answers may be: by what the points were stored with, and by the arithmetic.
double rounding_mm(const Input& in) {
  double size_mm = 0.0;
  for (const Vec3& hip : in.path.hip_mm) size_mm = std::max(size_mm, hip.cwiseAbs().maxCoeff());
  return in.options.stored_rounding_mm + kStillPerSize * size_mm;
}

void score_forces(const Input& in, Accuracy& a) {
  Spread error, normal, tangential, wanted;
  std::uint64_t within_jnd = 0, within_deadband = 0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.in_c(i)) continue;
    const Vec3 difference = in.rendered(i) - in.wanted(i);
    const double size = difference.norm();
    const double true_size = in.wanted(i).norm();
    const double along = difference.dot(in.truth[i].normal);
    error.add(size);
    normal.add(along);
    tangential.add((difference - along * in.truth[i].normal).norm());
    wanted.add(true_size);
    within_jnd += size <= std::max(kForceJnd * true_size, a.floor_n) ? 1u : 0u;
    within_deadband += size <= std::max(kForceDeadband * true_size, a.floor_n) ? 1u : 0u;
  }
  a.contact_frames = error.count;
  if (error.count == 0) return;
  a.force_rms_n = error.rms();
  a.force_normal_rms_n = normal.rms();
  a.force_tangential_rms_n = tangential.rms();
  a.force_max_n = error.max();
  if (*wanted.rms() > 0.0) a.force_rms_percent = kToPercent * *a.force_rms_n / *wanted.rms();
  const double per_frame = kToPercent / static_cast<double>(error.count);
  a.within_7_percent = per_frame * static_cast<double>(within_jnd);
  a.within_10_percent = per_frame * static_cast<double>(within_deadband);
}

void score_direction(const Input& in, Accuracy& a) {
  std::vector<double> angles;
  double sum = 0.0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!felt(in.rendered(i)) || !felt(in.wanted(i))) continue;
    if (std::min(in.rendered(i).norm(), in.wanted(i).norm()) < a.floor_n) continue;
    angles.push_back(angle_deg(in.rendered(i), in.wanted(i)));
    sum += angles.back();
  }
  if (angles.empty()) return;
  std::sort(angles.begin(), angles.end());
  a.direction_mean_deg = sum / static_cast<double>(angles.size());
  a.direction_p99_deg = nearest_rank(angles, kDirectionPercentile);
  a.direction_max_deg = angles.back();
}

void score_jumps(const Input& in, Accuracy& a, AccuracyFrames* out) {
  double largest = 0.0, travel_mm = 0.0;
  std::uint64_t steps = 0, jumps = 0;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    if (!in.in_c(i) && !in.in_c(i - 1)) continue;
    const double step_mm = in.travel_mm(i);
    const double true_jump = (in.wanted(i) - in.wanted(i - 1)).norm();
    if (true_jump > in.options.stiffness_n_per_mm * step_mm + a.floor_n) continue;  // a true edge
    const double excess = (in.rendered(i) - in.rendered(i - 1)).norm() - true_jump;
    ++steps;
    travel_mm += step_mm;
    largest = std::max(largest, excess);
    jumps += excess > a.floor_n ? 1u : 0u;
    if (out != nullptr) out->excess_jump_n[i] = static_cast<float>(std::max(0.0, excess));
  }
  a.excess_jumps = jumps;
  if (steps == 0) return;
  a.excess_jump_max_n = largest;
  if (travel_mm > 0.0) a.excess_jumps_per_m = static_cast<double>(jumps) * kMmPerM / travel_mm;
}

void score_contact(const Input& in, Accuracy& a, AccuracyFrames* out) {
  std::uint64_t run = 0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    const double d = in.truth[i].signed_distance_mm;
    const double allowed = in.truth[i].local_resolution_mm;
    const bool missed = !felt(in.rendered(i)) && d < -allowed;
    const bool phantom = felt(in.rendered(i)) && d > allowed;
    a.missed_contact_frames += missed ? 1u : 0u;
    a.false_contact_frames += phantom ? 1u : 0u;
    run = phantom ? run + 1 : 0;
    a.longest_stick_frames = std::max(a.longest_stick_frames, run);
    if (out == nullptr) continue;
    out->missed_contact[i] = missed ? 1 : 0;
    out->false_contact[i] = phantom ? 1 : 0;
  }
}

void score_god_object(const Input& in, const SurfaceAnswers* answers, Accuracy& a, AccuracyFrames* out) {
  Spread distance, off_surface;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (!in.frames[i].contact) continue;
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

void score_onset_and_release(const Input& in, Accuracy& a) {
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

// Visits of the very same HIP position, found by sorting; among them the spread of |F_r| where the truth
// agrees.
void score_path_dependence(const Input& in, Accuracy& a) {
  std::vector<std::uint32_t> order;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    if (in.in_c(i)) order.push_back(static_cast<std::uint32_t>(i));
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

Status check_lengths(const trace::ProbePath& path, std::size_t frames, std::string_view what) {
  if (path.size() == 0 || path.hip_mm.size() != path.size())
    return Error{"the path has no samples", "", path.name, 0};
  if (frames != path.size())
    return Error{std::string(what) + " has " + std::to_string(frames) + " frames, the path " +
                     std::to_string(path.size()),
                 "score a trace with the path it was made from", path.name, 0};
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

}  // namespace

trace::ForceTrace as_trace(const trace::ReferenceTrace& reference) {
  trace::ForceTrace trace;
  trace.label = reference.name;
  trace.frames.reserve(reference.frames.size());
  for (const trace::TruthFrame& frame : reference.frames) trace.frames.push_back(frame.frame);
  return trace;
}

namespace {

/// Lengths that agree, and numbers that are finite throughout.
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
    return Error{"the reference has a normal, distance or resolution that is not finite", "", path.name, 0};
  }
  return Done{};
}

bool has_resolution(const trace::ReferenceTrace& reference) {
  return std::any_of(reference.frames.begin(), reference.frames.end(),
                     [](const auto& f) { return f.local_resolution_mm > 0.0; });
}

}  // namespace

SurfaceAnswers ask_surface(const trace::ProbePath& path, const trace::ForceTrace& trace,
                           const trace::ReferenceTrace& reference, const TruthSurface& truth) {
  SurfaceAnswers answers;
  answers.god_object_distance_mm.reserve(trace.frames.size());
  for (const render::Frame& frame : trace.frames)
    answers.god_object_distance_mm.push_back(frame.contact ? truth.signed_distance_mm(frame.god_object_mm)
                                                           : 0.0);
  if (has_resolution(reference)) answers.pop_throughs = find_pop_throughs(path, trace, reference, truth);
  return answers;
}

Result<Accuracy> score(const trace::ProbePath& path, const trace::ForceTrace& trace,
                       const trace::ReferenceTrace& reference, const TruthSurface* truth,
                       const AccuracyOptions& options, AccuracyFrames* per_frame) {
  PALPATE_TRY(check_all(path, trace, reference));
  std::optional<SurfaceAnswers> answers;
  if (truth != nullptr) answers = ask_surface(path, trace, reference, *truth);
  return score_again(path, trace, reference, answers, options, per_frame);
}

Result<Accuracy> score_again(const trace::ProbePath& path, const trace::ForceTrace& trace,
                             const trace::ReferenceTrace& reference,
                             const std::optional<SurfaceAnswers>& answers, const AccuracyOptions& options,
                             AccuracyFrames* per_frame) {
  PALPATE_TRY(check_all(path, trace, reference));
  const std::size_t n = path.size();
  if (answers && (answers->god_object_distance_mm.size() != n ||
                  (!answers->pop_throughs.empty() && answers->pop_throughs.size() != n)))
    return Error{"the answers of the true surface are not of this trace", "", path.name, 0};
  if (per_frame != nullptr) {
    *per_frame = {std::vector<float>(n),        std::vector<float>(n),        std::vector<float>(n),
                  std::vector<std::uint8_t>(n), std::vector<std::uint8_t>(n), answers};
    for (std::size_t i = 0; i < n; ++i) {
      per_frame->force_error_n[i] =
          static_cast<float>((trace.frames[i].force_n - reference.frames[i].frame.force_n).norm());
    }
  }
  const Input in{path, trace.frames, reference.frames, options};
  Accuracy a;
  a.reference = reference.name;
  a.exactness = reference.exactness;
  a.floor_n = options.floor_n();
  a.rounding_mm = rounding_mm(in);
  a.rounding_n = options.stiffness_n_per_mm * a.rounding_mm;
  a.frames = n;
  score_forces(in, a);
  score_direction(in, a);
  score_jumps(in, a, per_frame);
  score_contact(in, a, per_frame);
  score_god_object(in, answers ? &*answers : nullptr, a, per_frame);
  score_onset_and_release(in, a);
  score_path_dependence(in, a);
  if (answers && !answers->pop_throughs.empty()) {
    a.pop_throughs = 0;
    for (const std::uint8_t events : answers->pop_throughs) *a.pop_throughs += events;
    const auto true_contact = static_cast<double>(std::count_if(
        reference.frames.begin(), reference.frames.end(), [](const auto& f) { return f.frame.contact; }));
    if (*a.pop_throughs == 0 && true_contact > 0) a.pop_through_rate_upper_95 = kRuleOfThree / true_contact;
  }
  return a;
}

void keep_contact_scores(Accuracy& a, AccuracyFrames& per_frame) {
  for (std::optional<double>* score :
       {&a.force_rms_n, &a.force_rms_percent, &a.force_normal_rms_n, &a.force_tangential_rms_n,
        &a.force_max_n, &a.within_7_percent, &a.within_10_percent, &a.direction_mean_deg,
        &a.direction_p99_deg, &a.direction_max_deg, &a.excess_jump_max_n, &a.excess_jumps_per_m,
        &a.god_object_rms_mm, &a.god_object_max_mm, &a.god_object_surface_rms_mm,
        &a.god_object_surface_max_mm, &a.path_dependence_n})
    score->reset();
  a.excess_jumps.reset();
  for (std::vector<float>* frames :
       {&per_frame.force_error_n, &per_frame.excess_jump_n, &per_frame.god_object_error_mm})
    frames->clear();
}

Result<Energy> observe_energy(const trace::ProbePath& path, const trace::ForceTrace& trace,
                              std::span<const double> stiffness_n_per_mm) {
  PALPATE_TRY(check_lengths(path, trace.frames.size(), "the trace"));
  PALPATE_TRY(check_finite(path, trace.frames, "the trace"));
  if (stiffness_n_per_mm.empty() || !std::all_of(stiffness_n_per_mm.begin(), stiffness_n_per_mm.end(),
                                                 [](double k) { return k > 0.0 && std::isfinite(k); }))
    return Error{"the stiffness is not positive", "", path.name, 0};
  Energy e;
  control::PassivityObserver observer(control::EnergyRule::kTrapezoid);
  const double stiffest = *std::max_element(stiffness_n_per_mm.begin(), stiffness_n_per_mm.end());
  double work_mj = 0.0, reach_mj = 0.0, sway_mm2 = 0.0;  // what the rounding of E is a share of
  for (std::size_t i = 0; i < path.size(); ++i) {
    const render::Frame& frame = trace.frames[i];
    const auto model = static_cast<std::size_t>(std::max(frame.model, 0));
    const double k = stiffness_n_per_mm[model < stiffness_n_per_mm.size() ? model : 0];
    e.max_stored_mj = std::max(e.max_stored_mj, frame.force_n.squaredNorm() / (2.0 * k));
    observer.observe(path.hip_mm[i], frame.force_n);
    if (i == 0) continue;
    const Vec3& before_n = trace.frames[i - 1].force_n;
    if (!felt(frame.force_n) && !felt(before_n)) continue;
    const double step_mm = (path.hip_mm[i] - path.hip_mm[i - 1]).norm(), size_mm = path.hip_mm[i].norm();
    const double force_n = std::max(frame.force_n.norm(), before_n.norm());
    work_mj += force_n * step_mm;
    reach_mj += force_n * size_mm;
    sway_mm2 += size_mm * step_mm;
  }
  // The sum of the products (Higham 2002, section 4.2), the differences of positions, and the forces.
  constexpr int kProduct = 5, kMostTerms = 1 << 30;
  const int terms = static_cast<int>(std::min<std::size_t>(path.size(), kMostTerms)) + kProduct;
  e.rounding_mj =
      gamma(terms) * work_mj + 2.0 * kUnitRoundoff * reach_mj + stiffest * kStillPerSize * sway_mm2;
  e.generated_mj = std::max(0.0, -observer.least_mj());  // never -0
  e.final_mj = observer.energy_mj();
  if (e.max_stored_mj > 0.0) e.generated_percent = kToPercent * e.generated_mj / e.max_stored_mj;
  return e;
}

}  // namespace palpate::metrics
