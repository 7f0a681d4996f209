#include "toolkit/metrics/closest_point.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/core/tolerances.h"
#include "toolkit/geometry/broad_phase.h"
#include "toolkit/metrics/scores.h"

namespace palpate::metrics {
namespace {

/// Frames between progress reports.
constexpr std::size_t kReportEvery = 1024;

/// Uncertainty of a point of least distance: there the distance changes by less than its rounding.
double place_rounding_mm(const Vec3& hip_mm, const Vec3& place_mm) {
  return std::sqrt(kUnitRoundoff) * (hip_mm.cwiseAbs().maxCoeff() + place_mm.cwiseAbs().maxCoeff());
}

bool agree_on_state(const trace::TruthFrame& a, const trace::TruthFrame& b, const Vec3& hip_mm) {
  if (a.frame.contact == b.frame.contact) return true;
  // At the surface, within rounding, both states are right.
  const double deepest = std::max(std::abs(a.signed_distance_mm), std::abs(b.signed_distance_mm));
  return deepest <= place_rounding_mm(hip_mm, hip_mm);
}

bool agree_on_place(const trace::TruthFrame& a, const trace::TruthFrame& b, const Vec3& hip_mm) {
  if (!a.frame.contact || !b.frame.contact) return true;
  const double apart = (a.frame.god_object_mm - b.frame.god_object_mm).norm();
  const double depth = (a.frame.god_object_mm - hip_mm).norm();
  return apart <= kAgreementShare * depth + place_rounding_mm(hip_mm, a.frame.god_object_mm);
}

}  // namespace

Result<trace::ReferenceTrace> closest_point_reference(const TruthSurface& truth, const trace::ProbePath& path,
                                                      double stiffness_n_per_mm, double force_limit_n,
                                                      Progress& progress) {
  PALPATE_TRY(check_starts_free(path, truth));
  if (!(stiffness_n_per_mm > 0.0)) return Error{"the stiffness is not positive", "give a stiffness above 0"};
  trace::ReferenceTrace reference;
  reference.name = "closest-point";
  reference.exactness = "the closest point of the whole surface in every frame, without any history";
  reference.frames.resize(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (i % kReportEvery == 0) {
      progress.report("closest points of the true surface",
                      static_cast<double>(i) / static_cast<double>(path.size()));
      if (progress.cancelled()) return Error{"the reference was stopped"};
    }
    const Vec3& hip = path.hip_mm[i];
    trace::TruthFrame& out = reference.frames[i];
    const geometry::SurfacePoint nearest = truth.closest(hip);
    out.normal = nearest.normal;
    out.signed_distance_mm = truth.signed_distance_mm(hip);
    out.frame.god_object_mm = hip;
    if (!(out.signed_distance_mm < 0.0)) continue;
    out.frame.contact = true;
    out.frame.model = 0;
    out.frame.god_object_mm = nearest.point_mm;
    out.frame.force_n = render::limited(stiffness_n_per_mm * (nearest.point_mm - hip), force_limit_n);
  }
  return reference;
}

Result<HistoryCounts> compare_references(trace::ReferenceTrace& reference,
                                         const trace::ReferenceTrace& second, const trace::ProbePath& path) {
  PALPATE_TRY(check_lengths(path, reference.frames.size(), "the reference"));
  PALPATE_TRY(check_lengths(path, second.frames.size(), "the second reference"));
  HistoryCounts tally;
  for (std::size_t i = 0; i < path.size(); ++i) {
    trace::TruthFrame& a = reference.frames[i];
    const trace::TruthFrame& b = second.frames[i];
    const bool state = !agree_on_state(a, b, path.hip_mm[i]), place = !agree_on_place(a, b, path.hip_mm[i]);
    a.history_decides = state || place;
    tally.contact += a.frame.contact || b.frame.contact ? 1u : 0u;
    tally.state += state ? 1u : 0u;
    tally.place += place ? 1u : 0u;
  }
  reference.compared = true;
  if (tally.contact > 0) tally.share_percent = percent_of(tally.state + tally.place, tally.contact);
  reference.exactness += fmt::format(
      "; compared with {}: of {} frames in contact by either, {} differ in contact and {} in place, {:.3g} "
      "%: "
      "history decides them, and they are scored apart",
      second.name, tally.contact, tally.state, tally.place, tally.share_percent);
  return tally;
}

namespace {

// Points in a leaf: a tree of two nodes per 32 points stays small, and testing 32 is fast.
constexpr std::uint32_t kLeafPoints = 32;

}  // namespace

ClosestApproach closest_approach(const trace::ProbePath& path, std::span<const render::ModelInput> models) {
  ClosestApproach best;
  double best_sq = std::numeric_limits<double>::infinity();
  for (std::size_t m = 0; m < models.size(); ++m) {
    const cloud::Cloud& cloud = *models[m].cloud;
    const geometry::AabbTree tree(
        static_cast<std::uint32_t>(cloud.size()),
        [&](std::uint32_t i) {
          const Vec3 p = cloud.local_mm(i);
          return geometry::Aabb{p, p};
        },
        kLeafPoints);
    const geometry::RigidTransform model_from_world = models[m].world_from_model.inverse();
    for (std::size_t k = 0; k < path.size(); ++k) {
      const Vec3 hip = model_from_world * path.hip_mm[k] - cloud.origin_mm;
      tree.visit_nearest([&](const geometry::Aabb& box) { return box.distance_sq_mm2(hip); }, best_sq,
                         [&](std::uint32_t i) {
                           const double distance_sq = (cloud.local_mm(i) - hip).squaredNorm();
                           if (distance_sq < best_sq) {
                             best_sq = distance_sq;
                             best = {std::sqrt(distance_sq), k, m};
                           }
                           return best_sq;
                         });
    }
  }
  return best;
}

}  // namespace palpate::metrics
