// Moments that feel plainly wrong (caught, lost, kicked), counted over all frames, as a hand does; and
// pop-throughs.
#include "toolkit/metrics/scores.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/tolerances.h"

namespace palpate::metrics {
namespace {

/// The local resolution is the distance to the eighth neighbour, about 1.5 spacings.
constexpr double kSpacingsPerResolution = kCaughtSpacings / 1.5;
/// A kick: a step of force larger by this than any true step within kMinArtefactS before or after.
constexpr double kKickN = 0.5;

/// Stretches of at least kMinArtefactS in which `wrong` holds.
template <class Wrong>
Moments stretches(const ScoreInput& in, const Wrong& wrong) {
  Moments out;
  double longest_s = 0.0;
  const std::size_t n = in.frames.size();
  for (std::size_t begin = 0; begin < n;) {
    if (!wrong(begin)) {
      ++begin;
      continue;
    }
    std::size_t end = begin + 1;
    while (end < n && wrong(end)) ++end;
    const double lasts_s = in.path.t_s[end - 1] - in.path.t_s[begin];
    if (lasts_s >= kMinArtefactS) {
      ++out.episodes;
      out.frames += end - begin;
      if (lasts_s > longest_s) out.longest_at = begin;
      longest_s = std::max(longest_s, lasts_s);
    }
    begin = end;
  }
  return out;
}

void count_kicks(const ScoreInput& in, ContactArtefacts& out) {
  std::size_t first = 1, last = 0;  // of the true steps within kMinArtefactS
  double quiet_until_s = -HUGE_VAL;
  const std::vector<double>& t = in.path.t_s;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    const double step = (in.rendered(i) - in.rendered(i - 1)).norm();
    const bool counts = step > kKickN && t[i] >= quiet_until_s;
    if (!counts && !(step > out.kick_max_n)) continue;
    while (t[first] < t[i] - kMinArtefactS) ++first;
    last = std::max(last, i);
    while (last + 1 < t.size() && t[last + 1] <= t[i] + kMinArtefactS) ++last;
    double most = 0.0;
    for (std::size_t k = first; k <= last; ++k)
      most = std::max(most, (in.wanted(k) - in.wanted(k - 1)).norm());
    if (step - most > out.kick_max_n) {
      out.kick_max_n = step - most;
      out.kick_max_at = i;
    }
    if (!counts || !(step - most > kKickN)) continue;
    ++out.kicks;
    quiet_until_s = t[i] + kMinArtefactS;  // the way back is the same kick
  }
}

}  // namespace

ContactArtefacts find_artefacts(const trace::ProbePath& path, const std::vector<render::Frame>& frames,
                                const std::vector<trace::TruthFrame>& truth, double lost_mm) {
  const AccuracyOptions unread;
  const ScoreInput in{path, frames, truth, unread};
  ContactArtefacts out;
  out.caught = stretches(in, [&](std::size_t i) {
    if (!felt(in.rendered(i))) return false;
    const double most = std::max(kCaughtMm, kSpacingsPerResolution * in.truth[i].local_resolution_mm);
    return (in.frames[i].god_object_mm - in.truth[i].frame.god_object_mm).norm() > most;
  });
  out.lost = stretches(in, [&](std::size_t i) {
    return felt(in.wanted(i)) && !felt(in.rendered(i)) && in.truth[i].signed_distance_mm < -lost_mm;
  });
  count_kicks(in, out);
  return out;
}

void score_artefacts(const ScoreInput& in, Accuracy& a) {
  const ContactArtefacts wrong = find_artefacts(in.path, in.frames, in.truth);
  a.caught = wrong.caught.episodes;
  a.caught_frames = wrong.caught.frames;
  a.lost = wrong.lost.episodes;
  a.lost_frames = wrong.lost.frames;
  a.kicks = wrong.kicks;
  double felt_most = 0.0, true_most = 0.0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    felt_most = std::max(felt_most, in.rendered(i).norm());
    true_most = std::max(true_most, in.wanted(i).norm());
  }
  a.force_peak_n = felt_most;
  if (true_most > 0.0)
    a.force_peak_excess_percent = std::max(0.0, kToPercent * (felt_most / true_most - 1.0));
}

namespace {

// Most samples along a god-object step. They are half a local resolution apart, so that no deeper matter is
// skipped; longer steps are sampled more coarsely, and cross large matter.
constexpr int kMaxSamples = 64;
// Some hundred coordinate roundings: the error of a distance to a formula or mesh.
constexpr double kRoundingPerSize = 256.0 * kUnitRoundoff;

bool leads_through_matter(const Vec3& from_mm, const Vec3& to_mm, double resolution_mm,
                          const TruthSurface& truth) {
  const double length_mm = (to_mm - from_mm).norm();
  // A chord of length L is at most L / 2 deep.
  if (!(length_mm > 2.0 * resolution_mm)) return false;
  const double wanted = std::ceil(2.0 * length_mm / resolution_mm);  // resolution > 0 here
  const int samples = static_cast<int>(std::min(wanted, static_cast<double>(kMaxSamples)));
  for (int s = 1; s < samples; ++s) {
    const double t = static_cast<double>(s) / samples;
    if (truth.signed_distance_mm(from_mm + t * (to_mm - from_mm)) < -resolution_mm) return true;
  }
  return false;
}

}  // namespace

std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                            const trace::ReferenceTrace& reference,
                                            const TruthSurface& truth) {
  std::vector<std::uint8_t> events(trace.frames.size());
  bool was_inside = false, away_counted = false;
  double away_travel_mm = -1.0;  // HIP travel since g faces away; negative if it does not
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const render::Frame& frame = trace.frames[i];
    const trace::TruthFrame& wanted = reference.frames[i];
    const double resolution_mm =
        wanted.local_resolution_mm + kRoundingPerSize * frame.god_object_mm.cwiseAbs().maxCoeff();
    const bool inside = frame.contact && truth.signed_distance_mm(frame.god_object_mm) < -resolution_mm;
    const bool through =
        i > 0 && frame.contact && trace.frames[i - 1].contact && !inside && !was_inside &&
        leads_through_matter(trace.frames[i - 1].god_object_mm, frame.god_object_mm, resolution_mm, truth) &&
        // A fast hand may take the true god object around a bump in a step, whose chord is not its way.
        !leads_through_matter(reference.frames[i - 1].frame.god_object_mm, wanted.frame.god_object_mm,
                              resolution_mm, truth);
    const bool away = frame.contact && wanted.frame.contact && !inside &&
                      truth.closest(frame.god_object_mm).normal.dot(wanted.normal) < 0.0;
    if ((inside && !was_inside) || through) ++events[i];
    if (!away) {
      away_travel_mm = -1.0;
      away_counted = false;
    } else {
      away_travel_mm =
          away_travel_mm < 0.0 ? 0.0 : away_travel_mm + (path.hip_mm[i] - path.hip_mm[i - 1]).norm();
      if (through || was_inside) away_counted = true;  // already counted
      if (!away_counted && away_travel_mm > resolution_mm) {
        away_counted = true;
        ++events[i];
      }
    }
    was_inside = inside;
  }
  return events;
}

}  // namespace palpate::metrics
