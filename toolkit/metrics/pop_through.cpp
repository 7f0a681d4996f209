#include "toolkit/metrics/pop_through.h"

#include <algorithm>
#include <cmath>

#include "toolkit/core/tolerances.h"

namespace palpate::metrics {
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
