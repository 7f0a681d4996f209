// Moments that a hand feels as plainly wrong, whatever the mean error: it is caught, it loses the surface, it
// is kicked. They are counted over all frames, since a hand does not leave any out.
#include <algorithm>
#include <cmath>

#include "toolkit/metrics/score_input.h"

namespace palpate::metrics {
namespace {

/// Caught: the rendered god object farther from the true one than this, or than two spacings of the points
/// where those are larger (the local resolution is the distance to the eighth neighbour: some one and a
/// half), for so long.
constexpr double kCaughtMm = 1.0, kSpacingsPerResolution = 2.0 / 1.5, kLastsS = 0.02;
/// Lost: deeper than a tenth of a millimetre by the truth, and no force for as long.
constexpr double kLostMm = kTenthMm;
/// A kick: a step of force from one frame to the next that is larger by this than any of the truth within
/// kLastsS, before or after.
constexpr double kKickN = 0.5;

struct Moments {
  std::uint64_t episodes = 0, frames = 0;
};

/// Stretches of frames in which `wrong` holds, of kLastsS at least.
template <class Wrong>
Moments stretches(const ScoreInput& in, const Wrong& wrong) {
  Moments out;
  const std::size_t n = in.frames.size();
  for (std::size_t begin = 0; begin < n;) {
    if (!wrong(begin)) {
      ++begin;
      continue;
    }
    std::size_t end = begin + 1;
    while (end < n && wrong(end)) ++end;
    if (in.path.t_s[end - 1] - in.path.t_s[begin] >= kLastsS) {
      ++out.episodes;
      out.frames += end - begin;
    }
    begin = end;
  }
  return out;
}

std::uint64_t count_kicks(const ScoreInput& in) {
  std::uint64_t kicks = 0;
  std::size_t first = 1, last = 0;  // of the true steps within kLastsS
  double quiet_until_s = -HUGE_VAL;
  const std::vector<double>& t = in.path.t_s;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    const double step = (in.rendered(i) - in.rendered(i - 1)).norm();
    if (!(step > kKickN) || t[i] < quiet_until_s) continue;
    while (t[first] < t[i] - kLastsS) ++first;
    last = std::max(last, i);
    while (last + 1 < t.size() && t[last + 1] <= t[i] + kLastsS) ++last;
    double most = 0.0;
    for (std::size_t k = first; k <= last; ++k)
      most = std::max(most, (in.wanted(k) - in.wanted(k - 1)).norm());
    if (!(step - most > kKickN)) continue;
    ++kicks;
    quiet_until_s = t[i] + kLastsS;  // the way back is the same kick
  }
  return kicks;
}

}  // namespace

void score_moments(const ScoreInput& in, Accuracy& a) {
  const Moments caught = stretches(in, [&](std::size_t i) {
    if (!felt(in.rendered(i))) return false;
    const double most = std::max(kCaughtMm, kSpacingsPerResolution * in.truth[i].local_resolution_mm);
    return (in.frames[i].god_object_mm - in.truth[i].frame.god_object_mm).norm() > most;
  });
  const Moments lost = stretches(in, [&](std::size_t i) {
    return felt(in.wanted(i)) && !felt(in.rendered(i)) && in.truth[i].signed_distance_mm < -kLostMm;
  });
  a.caught = caught.episodes;
  a.caught_frames = caught.frames;
  a.lost = lost.episodes;
  a.lost_frames = lost.frames;
  a.kicks = count_kicks(in);
  double felt_most = 0.0, true_most = 0.0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    felt_most = std::max(felt_most, in.rendered(i).norm());
    true_most = std::max(true_most, in.wanted(i).norm());
  }
  a.force_peak_n = felt_most;
  if (true_most > 0.0)
    a.force_peak_excess_percent = std::max(0.0, kToPercent * (felt_most / true_most - 1.0));
}

}  // namespace palpate::metrics
