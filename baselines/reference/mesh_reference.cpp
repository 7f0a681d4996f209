#include "baselines/reference/mesh_reference.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "baselines/reference/facet_tree.h"
#include "toolkit/core/statistics.h"
#include "toolkit/geometry/god_object_check.h"

namespace palpate::baselines {

MeshTruth::MeshTruth(SurfaceMesh mesh, const geometry::RigidTransform& world_from_model)
    : mesh_(std::move(mesh)),
      tree_(mesh_),
      world_from_model_(world_from_model),
      model_from_world_(world_from_model.inverse()) {}

Result<std::unique_ptr<MeshTruth>> MeshTruth::build(const geometry::TriangleMesh& mesh,
                                                    const geometry::RigidTransform& world_from_model) {
  PALPATE_ASSIGN(auto surface, SurfaceMesh::build(mesh, 0));
  return std::unique_ptr<MeshTruth>(new MeshTruth(std::move(surface), world_from_model));
}

double MeshTruth::signed_distance_mm(const Vec3& p_mm) const {
  const Vec3 p = model_from_world_ * p_mm - mesh_.origin_mm();
  const FacetTree::Nearest near = tree_.closest(p);
  const double distance = std::sqrt(near.point.distance_sq);
  return outward(near).dot(p - near.point.point) < 0.0 ? -distance : distance;
}

geometry::SurfacePoint MeshTruth::closest(const Vec3& p_mm) const {
  const FacetTree::Nearest near = tree_.closest(model_from_world_ * p_mm - mesh_.origin_mm());
  return {world_from_model_ * (near.point.point + mesh_.origin_mm()),
          world_from_model_.rotate(outward(near))};
}

Vec3 MeshTruth::outward(const FacetTree::Nearest& near) const noexcept {
  bool boundary = false;
  return mesh_.pseudonormal(half_facet(near.facet, 0), near.point.feature, &boundary);
}

namespace {

/// Most steps of one piece of the way, each over a vertex's whole star; longer walks are cut and counted.
/// Pieces of a quarter edge usually take a handful.
constexpr int kMaxSteps = 4096;
/// Most flights of one piece.
constexpr int kMaxFlights = 16;
/// Relative difference, besides rounding, up to which god object and closest point agree in distance.
constexpr double kAgreement = 1e-9;
constexpr std::size_t kReportEvery = 1024;

struct Tally {
  std::size_t contact = 0, agree = 0, next_facet = 0, other_sheet = 0, cut_frames = 0, cut_walks = 0,
              free = 0, corrected = 0;
};

/// The reference's own probe: vertex stars instead of half-facets, and as the side a sign relative to each
/// facet's orientation.
class ReferenceProbe {
 public:
  ReferenceProbe(const SurfaceMesh& mesh, const FacetTree& tree, Tally& tally)
      : mesh_(mesh), tree_(tree), tally_(tally) {}

  void reset(const Vec3& hip) { from_ = hip; }
  bool advance(const Vec3& hip);
  /// The rule of geometry/god_object_check.h; after advance(), in contact. False if it frees the HIP. A truth
  /// that stays on an edge while the path goes on below the next face would call every hand wrong.
  bool check_held_position(const Vec3& hip);

  [[nodiscard]] const Vec3& point() const { return at_.point; }
  [[nodiscard]] double distance() const { return std::sqrt(at_.distance_sq); }
  [[nodiscard]] Vec3 outward() const {
    bool boundary = false;
    return mesh_.pseudonormal(half_facet(facet_, side_), at_.feature, &boundary);
  }

 private:
  void descend(const Vec3& hip);
  bool enter(std::uint32_t facet, double fraction, const Vec3& from, const Vec3& to);
  [[nodiscard]] bool outside(const Vec3& hip) const {
    bool boundary = false;
    const Vec3 n = mesh_.pseudonormal(half_facet(facet_, side_), at_.feature, &boundary);
    const Vec3 r = hip - at_.point;
    const double height = n.dot(r);
    return height > 0.0 || (boundary && r.squaredNorm() - height * height > mesh_.longest_edge_sq(facet_));
  }
  [[nodiscard]] std::uint32_t side_across(std::uint32_t next) const;

  const SurfaceMesh& mesh_;
  const FacetTree& tree_;
  Tally& tally_;
  bool attached_ = false;
  std::uint32_t facet_ = kNoFacet, side_ = 0;
  FacetPoint at_;
  Vec3 from_ = Vec3::Zero();
};

/// The side of `next` that continues the present one, from a fan walk: disagreeing edges flip it.
std::uint32_t ReferenceProbe::side_across(std::uint32_t next) const {
  for (std::uint32_t corner = 0; corner < 3; ++corner) {
    std::uint32_t found = kNoFacet;
    mesh_.around_corner(half_facet(facet_, side_), corner, [&](HalfFacet half) {
      if (facet_of(half) == next && found == kNoFacet) found = side_of(half);
    });
    if (found != kNoFacet) return found;
  }
  return kNoFacet;  // touches at a vertex only: another fan
}

void ReferenceProbe::descend(const Vec3& hip) {
  at_ = closest_on_facet(mesh_.facet(facet_), hip);
  for (int step = 0; step < kMaxSteps; ++step) {
    if (at_.feature == kInside) return;
    const Facet& here = mesh_.facet(facet_);
    std::uint32_t best = kNoFacet, best_side = 0;
    FacetPoint target = at_;
    const auto look = [&](std::uint32_t vertex, std::uint32_t also) {
      for (const std::uint32_t other : mesh_.star(vertex)) {
        if (other == facet_) continue;
        if (also != kNoFacet &&
            std::ranges::find(mesh_.facet(other).vertex, also) == mesh_.facet(other).vertex.end())
          continue;
        const FacetPoint p = closest_on_facet(mesh_.facet(other), hip);
        if (!(p.distance_sq < target.distance_sq)) continue;
        const std::uint32_t side = side_across(other);
        if (side == kNoFacet) continue;
        target = p;
        best = other;
        best_side = side;
      }
    };
    if (at_.feature >= kCorner) {
      look(here.vertex[static_cast<std::size_t>(at_.feature - kCorner)], kNoFacet);
    } else {
      const auto edge = static_cast<std::uint32_t>(at_.feature - kEdge);
      look(here.vertex[edge], here.vertex[after(edge)]);
    }
    if (best == kNoFacet) return;
    facet_ = best;
    side_ = best_side;
    at_ = target;
  }
  ++tally_.cut_walks;
}

bool ReferenceProbe::enter(std::uint32_t facet, double fraction, const Vec3& from, const Vec3& to) {
  const Vec3 n = mesh_.normal(half_facet(facet, 0));
  facet_ = facet;
  side_ = n.dot(to - from) < 0.0 ? 0 : 1;
  at_ = closest_on_facet(mesh_.facet(facet), from + (to - from) * fraction);
  attached_ = true;
  return true;
}

bool ReferenceProbe::advance(const Vec3& hip) {
  for (int flight = 0; flight < kMaxFlights; ++flight) {
    if (!attached_) {
      const FacetTree::Crossing crossing = tree_.first_crossing(from_, hip);
      if (crossing.facet == kNoFacet) {
        from_ = hip;
        return false;
      }
      enter(crossing.facet, crossing.fraction, from_, hip);
    }
    descend(hip);
    if (!outside(hip)) return true;
    // Leaving: facets that the god object touches are ignored.
    const Vec3 start = at_.point + outward() * mesh_.rounding_mm();
    const FacetTree::Crossing crossing = tree_.first_crossing(start, hip, facet_);
    if (crossing.facet == kNoFacet) {
      attached_ = false;
      from_ = hip;
      return false;
    }
    enter(crossing.facet, crossing.fraction, start, hip);
  }
  ++tally_.cut_walks;
  return attached_;
}

bool ReferenceProbe::check_held_position(const Vec3& hip) {
  FacetTree::Nearest near;
  const auto look = [&](const Vec3& at) -> geometry::NearestSurface {
    near = tree_.closest(at);
    bool boundary = false;
    const Vec3 out = mesh_.pseudonormal(half_facet(near.facet, side_), near.point.feature, &boundary);
    const double distance = std::sqrt(near.point.distance_sq);
    return {!boundary, out.dot(at - near.point.point) < 0.0 ? -distance : distance, out};
  };
  const geometry::NearestSurface around = look(hip);
  const FacetTree::Nearest nearest = near;
  const Vec3 held = outward();
  // Nothing about a mesh is uncertain by more than rounding.
  switch (geometry::check_god_object(around, hip, at_.point, held, held, mesh_.rounding_mm(),
                                     geometry::kMuchNearerShare, look)) {
    case geometry::GodObjectVerdict::kKeep:
      return true;
    case geometry::GodObjectVerdict::kMove:
      ++tally_.corrected;
      facet_ = nearest.facet;
      at_ = nearest.point;
      return true;
    case geometry::GodObjectVerdict::kFree:
      break;
  }
  ++tally_.corrected;
  attached_ = false;
  from_ = hip;
  return false;
}

double median_edge_mm(const SurfaceMesh& mesh) {
  std::vector<double> lengths;
  lengths.reserve(mesh.facets().size());
  for (const Facet& f : mesh.facets()) lengths.push_back((f.corner[1] - f.corner[0]).norm());
  return upper_median(std::move(lengths));
}

std::string exactness(const Tally& t, double edge_mm, const MeshReferenceOptions& o, double rounding_mm) {
  return fmt::format(
      "double precision on the original mesh, rounding under {:.1e} mm; the HIP's way in pieces of at most "
      "{:.3g} of the median edge ({:.4g} mm); of {} contact frames the god object is the exact closest point "
      "of the whole mesh in {}, in {} a facet within an edge length is nearer (both hold a local minimum), "
      "in {} another part of the surface is (the god object does not change sheets); {} times a surface at "
      "less than half its distance, which faces the same way, took it over; {} free frames; {} frames with "
      "longer pieces, {} walks cut",
      rounding_mm, o.piece_per_edge, edge_mm, t.contact, t.agree, t.next_facet, t.other_sheet, t.corrected,
      t.free, t.cut_frames, t.cut_walks);
}

}  // namespace

struct MeshFollower::State {
  State(const MeshTruth& of, const MeshReferenceOptions& asked)
      : truth(of),
        options(asked),
        model_from_world(of.world_from_model().inverse()),
        edge_mm(median_edge_mm(of.mesh())),
        probe(of.mesh(), of.tree(), tally) {}
  State(const State&) = delete;  // the probe points into it
  State& operator=(const State&) = delete;

  bool advance(const Vec3& hip_mm) {
    hip = model_from_world * hip_mm - truth.mesh().origin_mm();
    if (!begun) {
      begun = true;
      probe.reset(hip);
      last = hip;
    }
    const double wanted = std::ceil((hip - last).norm() / (options.piece_per_edge * edge_mm));
    const int pieces = static_cast<int>(std::clamp(wanted, 1.0, static_cast<double>(options.max_pieces)));
    tally.cut_frames += wanted > options.max_pieces;
    bool contact = false;
    for (int piece = 1; piece <= pieces; ++piece)
      contact = probe.advance(piece == pieces ? hip : Vec3(last + (hip - last) * (double(piece) / pieces)));
    last = hip;
    return contact && probe.check_held_position(hip);
  }
  [[nodiscard]] Vec3 god_object_mm() const {
    return truth.world_from_model() * (probe.point() + truth.mesh().origin_mm());
  }

  const MeshTruth& truth;
  MeshReferenceOptions options;
  geometry::RigidTransform model_from_world;
  double edge_mm;
  Tally tally;
  ReferenceProbe probe;
  bool begun = false;
  Vec3 hip = Vec3::Zero(), last = Vec3::Zero();  ///< model frame, relative to the mesh's origin
};

MeshFollower::MeshFollower(const MeshTruth& truth, const MeshReferenceOptions& options)
    : state_(std::make_unique<State>(truth, options)) {}
MeshFollower::MeshFollower(MeshFollower&&) noexcept = default;
MeshFollower& MeshFollower::operator=(MeshFollower&&) noexcept = default;
MeshFollower::~MeshFollower() = default;

bool MeshFollower::advance(const Vec3& hip_mm) {
  return state_->advance(hip_mm);
}

Vec3 MeshFollower::god_object_mm() const {
  return state_->god_object_mm();
}

Result<trace::ReferenceTrace> mesh_reference(const MeshTruth& truth, const trace::ProbePath& path,
                                             double stiffness_n_per_mm, double force_limit_n,
                                             Progress& progress, const MeshReferenceOptions& options) {
  PALPATE_TRY(metrics::check_starts_free(path, truth));
  const SurfaceMesh& mesh = truth.mesh();
  const FacetTree& tree = truth.tree();
  const geometry::RigidTransform& world_from_model = truth.world_from_model();
  MeshFollower::State follower(truth, options);
  const ReferenceProbe& probe = follower.probe;
  const double edge_mm = follower.edge_mm;
  Tally& tally = follower.tally;
  trace::ReferenceTrace result;
  result.name = "original-mesh";
  result.frames.reserve(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (i % kReportEvery == 0) {
      progress.report("reference on the original mesh",
                      static_cast<double>(i) / static_cast<double>(path.size()));
      if (progress.cancelled()) return Error{"the reference was stopped"};
    }
    const bool contact = follower.advance(path.hip_mm[i]);
    const Vec3& hip = follower.hip;
    const FacetTree::Nearest near = tree.closest(hip);
    const double nearest = std::sqrt(near.point.distance_sq);
    trace::TruthFrame frame;
    if (contact) {
      ++tally.contact;
      const bool agrees = probe.distance() - nearest <= kAgreement * nearest + mesh.rounding_mm();
      const bool beside = (near.point.point - probe.point()).norm() <= edge_mm;
      ++(agrees ? tally.agree : beside ? tally.next_facet : tally.other_sheet);
      frame.frame.contact = true;
      frame.frame.model = 0;
      frame.frame.god_object_mm = follower.god_object_mm();
      frame.frame.force_n =
          render::limited((frame.frame.god_object_mm - path.hip_mm[i]) * stiffness_n_per_mm, force_limit_n);
      frame.normal = world_from_model.rotate(probe.outward());
      frame.signed_distance_mm = -probe.distance();
    } else {
      ++tally.free;
      frame.frame.god_object_mm = path.hip_mm[i];
      // Towards the HIP, on either side of the surface.
      const Vec3 away = hip - near.point.point;
      frame.normal = nearest > 0.0 ? Vec3(world_from_model.rotate(away / nearest))
                                   : Vec3(world_from_model.rotate(mesh.normal(half_facet(near.facet, 0))));
      frame.signed_distance_mm = nearest;
    }
    result.frames.push_back(frame);
  }
  result.exactness = exactness(tally, edge_mm, options, mesh.rounding_mm());
  return result;
}

}  // namespace palpate::baselines
