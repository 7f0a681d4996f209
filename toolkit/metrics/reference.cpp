#include <palpate/accuracy.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toolkit/core/tolerances.h"
#include "toolkit/metrics/scores.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/point_search.h"

namespace palpate::metrics {
namespace {

using geometry::AnalyticSurface;
using geometry::SurfacePoint;

constexpr std::int64_t kFirstSampleLine = 2;  // line 1 of a path file is its header
constexpr int kMaxTracks = 16;                // repeats of a search; each continues the last

// The constrained god object's state, model frame.
class Tracker {
 public:
  Tracker(const AnalyticSurface& surface, const Vec3& start_mm) : surface_(surface), hip_mm_(start_mm) {}

  void move_to(const Vec3& hip_mm, int sub_steps) {
    const Vec3 from_mm = hip_mm_;
    for (int s = 1; s <= sub_steps; ++s) {
      // The last piece ends exactly at the sample.
      const Vec3 to_mm =
          s == sub_steps ? hip_mm : Vec3(from_mm + (static_cast<double>(s) / sub_steps) * (hip_mm - from_mm));
      piece(to_mm);
    }
  }
  [[nodiscard]] bool contact() const { return contact_; }
  [[nodiscard]] const SurfacePoint& god_object() const { return god_object_; }
  [[nodiscard]] double largest_rest_mm() const { return largest_rest_mm_; }

 private:
  void piece(const Vec3& to_mm) {
    if (!contact_) {
      const std::optional<SurfacePoint> entry = surface_.first_entry(hip_mm_, to_mm);
      if (entry) {
        contact_ = true;
        god_object_ = *entry;
      }
    }
    hip_mm_ = to_mm;
    if (!contact_) return;
    converge();
    // The god object is its sheet's nearest place, so the HIP is outside exactly if beyond the tangent plane.
    if ((hip_mm_ - god_object_.point_mm).dot(god_object_.normal) >= 0.0) contact_ = false;
  }

  void converge() {
    for (int i = 0; i < kMaxTracks; ++i) {
      const SurfacePoint next = surface_.track(god_object_, hip_mm_);
      const double moved_mm = (next.point_mm - god_object_.point_mm).norm();
      god_object_ = next;
      rest_mm_ = moved_mm;
      if (moved_mm <=
          kConvergedPerSize * (hip_mm_.cwiseAbs().maxCoeff() + next.point_mm.cwiseAbs().maxCoeff()))
        return;
    }
    largest_rest_mm_ = std::max(largest_rest_mm_, rest_mm_);
  }

  const AnalyticSurface& surface_;
  Vec3 hip_mm_;
  SurfacePoint god_object_;
  bool contact_ = false;
  double rest_mm_ = 0.0, largest_rest_mm_ = 0.0;
};

struct Pass {
  std::vector<trace::TruthFrame> frames;
  double largest_rest_mm = 0.0;       // last motion of tracking without convergence
  std::uint64_t free_yet_inside = 0;  // frames inside by formula without contact: the tracker lost them
};

Pass run(const AnalyticSurface& surface, const trace::ProbePath& path, double stiffness_n_per_mm,
         double force_limit_n, const geometry::RigidTransform& world_from_model, int sub_steps) {
  const geometry::RigidTransform model_from_world = world_from_model.inverse();
  Pass pass;
  pass.frames.resize(path.size());
  Tracker tracker(surface, model_from_world * path.hip_mm[0]);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vec3 hip_mm = model_from_world * path.hip_mm[i];
    if (i > 0) tracker.move_to(hip_mm, sub_steps);
    trace::TruthFrame& out = pass.frames[i];
    if (tracker.contact()) {
      const SurfacePoint& god_object = tracker.god_object();
      out.frame.contact = true;
      out.frame.model = 0;
      out.frame.god_object_mm = world_from_model * god_object.point_mm;
      const Vec3 pull_mm = god_object.point_mm - hip_mm;
      out.frame.force_n =
          world_from_model.rotate(render::limited(stiffness_n_per_mm * pull_mm, force_limit_n));
      out.normal = world_from_model.rotate(god_object.normal);
      out.signed_distance_mm = -pull_mm.norm();
    } else {
      out.frame.god_object_mm = path.hip_mm[i];
      out.normal = world_from_model.rotate(surface.closest(hip_mm).normal);
      out.signed_distance_mm = surface.signed_distance_mm(hip_mm);
      const double rounding_mm = kConvergedPerSize * hip_mm.cwiseAbs().maxCoeff();
      if (out.signed_distance_mm < -rounding_mm) ++pass.free_yet_inside;
    }
  }
  pass.largest_rest_mm = tracker.largest_rest_mm();
  return pass;
}

std::string halving_words(const Pass& pass, const Pass& finer) {
  double largest_mm = 0.0;
  std::uint64_t states = 0;
  for (std::size_t i = 0; i < pass.frames.size(); ++i) {
    const render::Frame& a = pass.frames[i].frame;
    const render::Frame& b = finer.frames[i].frame;
    if (a.contact != b.contact) {
      ++states;
    } else if (a.contact) {
      largest_mm = std::max(largest_mm, (a.god_object_mm - b.god_object_mm).norm());
    }
  }
  return fmt::format(
      "; halving the sub-steps moves no god object by more than {:.2g} mm and changes {} contact states",
      largest_mm, states);
}

}  // namespace

Result<trace::ReferenceTrace> analytic_reference(const AnalyticSurface& surface, const trace::ProbePath& path,
                                                 double stiffness_n_per_mm, double force_limit_n,
                                                 const geometry::RigidTransform& world_from_model,
                                                 const ReferenceOptions& options) {
  if (path.size() == 0 || path.hip_mm.size() != path.size())
    return Error{"the path has no samples", "give a path with samples", path.name};
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (is_finite(path.hip_mm[i])) continue;
    return Error{"the position is not finite", "remove or mend the sample", path.name,
                 static_cast<std::int64_t>(i) + kFirstSampleLine};
  }
  if (!(stiffness_n_per_mm > 0.0)) return Error{"the stiffness is not positive", "give a stiffness above 0"};
  if (options.sub_steps < 1) return Error{"a reference needs at least one sub-step"};
  if (surface.signed_distance_mm(world_from_model.inverse() * path.hip_mm[0]) < 0.0)
    return Error{"the path starts inside the true surface", "start the path in free space", path.name,
                 kFirstSampleLine};

  Pass pass = run(surface, path, stiffness_n_per_mm, force_limit_n, world_from_model, options.sub_steps);
  trace::ReferenceTrace reference;
  reference.name = "analytic";
  reference.exactness =
      fmt::format("constrained god object on {}, {} sub-steps a frame, tracked until it rests",
                  surface.formula(), options.sub_steps);
  if (pass.largest_rest_mm > 0.0)
    reference.exactness += fmt::format(" (worst last movement {:.2g} mm)", pass.largest_rest_mm);
  if (options.check_halving) {
    Pass finer =
        run(surface, path, stiffness_n_per_mm, force_limit_n, world_from_model, 2 * options.sub_steps);
    reference.exactness += halving_words(pass, finer);
    pass = std::move(finer);
  }
  if (pass.free_yet_inside > 0)
    reference.exactness += fmt::format("; {} frames are free though inside by formula", pass.free_yet_inside);
  reference.frames = std::move(pass.frames);
  return reference;
}

Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                             const cloud::Cloud& cloud, const search::NeighbourTable& neighbours,
                             const geometry::RigidTransform& world_from_model) {
  if (reference.frames.size() != path.size() || path.hip_mm.size() != path.size())
    return Error{"the reference and the path differ in length", "", path.name};
  if (cloud.empty() || neighbours.size() != cloud.size())
    return Error{"the neighbour table does not belong to the cloud", "build it from this cloud"};
  const search::PointSearch points(cloud);
  const geometry::RigidTransform model_from_world = world_from_model.inverse();
  for (std::size_t i = 0; i < path.size(); ++i) {
    trace::TruthFrame& frame = reference.frames[i];
    const Vec3 place_mm = frame.frame.contact
                              ? frame.frame.god_object_mm
                              : Vec3(path.hip_mm[i] - frame.signed_distance_mm * frame.normal);
    if (!is_finite(place_mm)) return Error{"the reference is not finite", "", path.name};
    const std::size_t point = points.nearest(model_from_world * place_mm);
    double last_mm = 0.0;
    for (const std::uint32_t other : neighbours.of[point]) {
      last_mm = std::max(last_mm, (cloud.local_mm(other) - cloud.local_mm(point)).norm());
    }
    frame.local_resolution_mm = last_mm;
  }
  return Done{};
}

Status fill_local_resolution(trace::ReferenceTrace& reference, const trace::ProbePath& path,
                             const cloud::Cloud& cloud, const geometry::RigidTransform& world_from_model,
                             int threads) {
  return fill_local_resolution(reference, path, cloud, search::exact_knn(cloud, threads), world_from_model);
}

Status check_starts_free(const trace::ProbePath& path, const TruthSurface& truth) {
  if (path.hip_mm.empty()) return Error{"the path has no samples", "give a path with samples", path.name};
  if (truth.signed_distance_mm(path.hip_mm[0]) < 0.0)
    return Error{"the path starts inside the true surface", "start the path in free space", path.name,
                 kFirstSampleLine};
  return Done{};
}

}  // namespace palpate::metrics
