#include "baselines/reference/mesh_reference.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

#include "baselines/renderers/facet_walk.h"

namespace palpate::baselines {
namespace {

/// Pieces that the way of one frame is walked in.
constexpr int kPieces = 8;
/// Rounds of one walk; the reference may take its time, and says if this was not enough.
constexpr int kRounds = 100000;
/// The closest point of all facets is the god object when their distances differ by no more than this share:
/// both come from the same double formulas over different facets of one place, some tens of rounded
/// operations.
constexpr double kSameShare = 1e-9;

struct Nearest {
  MeshPoint at;
  Vec3 normal = Vec3::UnitZ();
  double signed_distance = 0.0;
};

Nearest nearest_of(const MeshTruth& truth, const Vec3& p) {
  const SurfaceMesh& mesh = truth.mesh();
  // Far enough for any place: the distance to the box and across it.
  const double radius = 2.0 * (p.norm() + mesh.local_box_mm().extent_mm().norm());
  const std::uint32_t facet = truth.index().nearest(p, radius);
  const FacetPoint point = closest_on_facet(mesh.facet(facet), p);
  Nearest found;
  found.at = {half_facet(facet, 0), point.feature, point.point, point.distance_sq};
  bool boundary = false;
  const Vec3 n = mesh.pseudonormal(found.at.half, point.feature, &boundary);
  found.normal = n.squaredNorm() > 0.0 ? n : Vec3(Vec3::UnitZ());
  const double distance = std::sqrt(point.distance_sq);
  found.signed_distance = n.dot(p - point.point) < 0.0 ? -distance : distance;
  return found;
}

}  // namespace

Result<std::unique_ptr<MeshTruth>> MeshTruth::build(const geometry::TriangleMesh& mesh,
                                                    const geometry::RigidTransform& world_from_model) {
  std::unique_ptr<MeshTruth> truth(new MeshTruth());
  Result<SurfaceMesh> surface = SurfaceMesh::build(mesh, 0);
  if (!surface) return std::move(surface).error();
  truth->mesh_ = std::make_unique<SurfaceMesh>(std::move(*surface));
  Result<SegmentIndex> index = SegmentIndex::build(*truth->mesh_, 0);
  if (!index) return std::move(index).error();
  truth->index_ = std::make_unique<SegmentIndex>(std::move(*index));
  truth->world_from_model_ = world_from_model;
  truth->model_from_world_ = world_from_model.inverse();
  return truth;
}

double MeshTruth::signed_distance_mm(const Vec3& p_mm) const {
  return nearest_of(*this, model_from_world_ * p_mm - mesh_->origin_mm()).signed_distance;
}

geometry::SurfacePoint MeshTruth::closest(const Vec3& p_mm) const {
  const Nearest found = nearest_of(*this, model_from_world_ * p_mm - mesh_->origin_mm());
  return {world_from_model_ * (found.at.point + mesh_->origin_mm()), world_from_model_.rotate(found.normal)};
}

Result<trace::ReferenceTrace> mesh_reference(const MeshTruth& truth, const trace::ProbePath& path,
                                             double stiffness_n_per_mm, double force_limit_n,
                                             Progress& progress) {
  if (Status free = metrics::check_starts_free(path, truth); !free) return free.error();
  const SurfaceMesh& mesh = truth.mesh();
  const geometry::RigidTransform& pose = truth.world_from_model();
  const geometry::RigidTransform back = pose.inverse();
  trace::ReferenceTrace reference;
  reference.name = "original-mesh";
  reference.frames.reserve(path.size());
  bool contact = false;
  MeshPoint at;
  Vec3 normal = Vec3::UnitZ();
  std::size_t contacts = 0, agree = 0, unfinished = 0;
  Vec3 from = back * path.hip_mm.front() - mesh.origin_mm();
  constexpr std::size_t kReportEvery = 1024;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vec3 to = back * path.hip_mm[i] - mesh.origin_mm();
    Nearest nearest;
    for (int piece = 1; piece <= kPieces; ++piece) {
      const Vec3 h = from + (static_cast<double>(piece) / kPieces) * (to - from);
      if (!contact) {
        nearest = nearest_of(truth, h);
        if (nearest.signed_distance >= 0.0) continue;
        contact = true;
        at = nearest.at;
      }
      int rounds = kRounds;
      at = descend(mesh, at, h, rounds, [](const MeshPoint&, const MeshPoint&) { return true; });
      unfinished += rounds == 0;
      bool boundary = false;
      const Vec3 n = mesh.pseudonormal(at.half, at.feature, &boundary);
      if (n.squaredNorm() > 0.0) normal = n;
      if (normal.dot(h - at.point) >= 0.0) contact = false;
    }
    nearest = nearest_of(truth, to);
    trace::TruthFrame truth_frame;
    truth_frame.frame.contact = contact;
    truth_frame.frame.god_object_mm = path.hip_mm[i];
    if (contact) {
      ++contacts;
      const Vec3 pull = at.point - to;
      agree += pull.norm() <= std::abs(nearest.signed_distance) * (1.0 + kSameShare) + mesh.rounding_mm();
      truth_frame.frame.model = 0;
      truth_frame.frame.god_object_mm = pose * (at.point + mesh.origin_mm());
      truth_frame.frame.force_n = render::limited(pose.rotate(stiffness_n_per_mm * pull), force_limit_n);
      truth_frame.normal = pose.rotate(normal);
      truth_frame.signed_distance_mm = -pull.norm();
    } else {
      truth_frame.normal = pose.rotate(nearest.normal);
      truth_frame.signed_distance_mm = std::abs(nearest.signed_distance);
    }
    reference.frames.push_back(truth_frame);
    from = to;
    if (i % kReportEvery == 0)
      progress.report("reference", static_cast<double>(i) / static_cast<double>(path.size()));
  }
  reference.exactness = fmt::format(
      "double precision on {} facets, {} pieces a frame, {} walks cut short; in {} of {} contact frames the "
      "god object "
      "is the exact closest point of the whole mesh, in the others some other part is nearer to the HIP",
      mesh.facets().size(), kPieces, unfinished, agree, contacts);
  return reference;
}

}  // namespace palpate::baselines
