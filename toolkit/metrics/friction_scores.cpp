// Scores by Coulomb's law, from the force, the god object's motion and the true normal.
#include <algorithm>
#include <cmath>

#include "toolkit/core/percentiles.h"
#include "toolkit/metrics/score_input.h"

namespace palpate::metrics {
namespace {

/// Literature: the coefficient in slip within 5 %.
constexpr double kFrictionTolerance = 0.05;
/// Motion relative to the HIP: at least half is slip, at most a hundredth stick; between them a slip begins
/// or ends in the frame.
constexpr double kSlips = 0.5, kSticks = 0.01;
/// Below this share of the dynamic coefficient a god object must stick. Not nearer to 1: on curved surfaces
/// the normals at god object and HIP give coefficients a tenth apart.
constexpr double kWellInside = 0.5;
constexpr double kDriftPercentile = 95.0;

}  // namespace

std::vector<double> friction_ratios(const trace::ForceTrace& trace, const TruthSurface& truth) {
  std::vector<double> ratios;
  ratios.reserve(trace.frames.size());
  for (const render::Frame& frame : trace.frames) {
    if (!frame.contact || !felt(frame.force_n)) {
      ratios.push_back(0.0);
      continue;
    }
    const Vec3 normal = truth.closest(frame.god_object_mm).normal;
    const double along = frame.force_n.dot(normal);
    ratios.push_back(along > 0.0 ? (frame.force_n - along * normal).norm() / along : kPullsInward);
  }
  return ratios;
}

void score_friction(const ScoreInput& in, const TruthSamples& answers, Accuracy& a) {
  const AccuracyOptions& o = in.options;
  if (!(o.static_friction > 0.0 || o.dynamic_friction > 0.0) || answers.friction_ratio.empty()) return;
  const double most = std::max(o.static_friction, o.dynamic_friction) * (1.0 + kFrictionTolerance);
  std::uint64_t contact = 0, outside = 0, told = 0, right = 0;
  std::vector<double> slip_errors, drifts_mm_s;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    if (!in.decided(i) || !in.frames[i].contact || !(in.rendered(i).norm() >= a.floor_n)) continue;
    const double ratio = answers.friction_ratio[i];
    ++contact;
    outside += ratio == kPullsInward || ratio > most ? 1u : 0u;
    if (ratio == kPullsInward || !in.frames[i - 1].contact) continue;
    const double way = in.travel_mm(i);
    if (!(way > a.rounding_mm / kSticks)) continue;  // too short to tell
    const double went = (in.frames[i].god_object_mm - in.frames[i - 1].god_object_mm).norm();
    const bool slips = went >= kSlips * way, sticks = went <= kSticks * way;
    // Well inside the cone it must stick; slipping has the dynamic coefficient.
    const bool must_stick = ratio < kWellInside * o.dynamic_friction;
    if (slips && o.dynamic_friction > 0.0)
      slip_errors.push_back(kToPercent * std::abs(ratio / o.dynamic_friction - 1.0));
    if (must_stick) drifts_mm_s.push_back(went / (in.path.t_s[i] - in.path.t_s[i - 1]));
    if (!slips && !sticks) continue;
    ++told;
    right += (slips ? !must_stick : ratio <= most) ? 1u : 0u;
  }
  const auto percent = [](std::uint64_t part, std::uint64_t whole) {
    return kToPercent * static_cast<double>(part) / static_cast<double>(whole);
  };
  if (contact > 0) a.friction_cone_percent = percent(outside, contact);
  if (told > 0) a.stick_slip_percent = percent(right, told);
  if (!slip_errors.empty()) a.friction_slip_error_percent = upper_median(std::move(slip_errors));
  if (drifts_mm_s.empty()) return;
  std::sort(drifts_mm_s.begin(), drifts_mm_s.end());
  a.stick_drift_mm_s = nearest_rank(drifts_mm_s, kDriftPercentile);
}

}  // namespace palpate::metrics
