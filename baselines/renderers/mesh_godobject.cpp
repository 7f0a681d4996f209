#include "baselines/renderers/mesh_godobject.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "baselines/mesh/mesh_report.h"
#include "baselines/mesh/surface_mesh.h"
#include "baselines/mesh_holder.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/reconstruct/advancing_front.h"
#include "baselines/renderers/facet_walk.h"
#include "toolkit/core/clock.h"

namespace palpate::baselines {
namespace {

using render::Frame;
using render::FrameStatus;

/// Facets the god object may cross in a frame: 256 facets of 0.1 mm are 25 m/s at 1 kHz.
constexpr int kMaxRounds = 256;
/// Planes closer to parallel than 1 in 1e4 (the sine) have an intersection line that moves by their distance
/// times that: no use as a constraint.
constexpr double kParallelSine = 1e-4;
/// The god object is held this many of Embree's margins off a crossing facet, and lifted as many off its own.
constexpr double kLiftMargins = 2.0;
/// Past the rim by more than the longest edge of the rim's facet, the HIP has left the sheet: less is a
/// pinhole.
constexpr double kRimEdges = 1.0;

class MeshGodObject final : public render::HapticRenderer, public MeshHolder {
 public:
  explicit MeshGodObject(const Options& options) : options_(options) {}

  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override {
    if (scene.models.size() != 1)
      return Error{fmt::format("mesh-godobject takes one model, the scene has {}", scene.models.size()),
                   "keep one [[model]] in the scene",
                   {},
                   0};
    const render::ModelInput& input = scene.models.front();
    if (!(input.surface.stiffness_n_per_mm > 0.0) || !std::isfinite(input.surface.stiffness_n_per_mm))
      return Error{"the stiffness must be a positive number", "set stiffness_n_per_mm", {}, 0};
    render::PrepareReport report;
    Stopwatch watch;
    const auto phase = [&](const char* name) {
      report.phases.push_back({name, watch.ms()});
      report.total_ms += report.phases.back().ms;
      watch.restart();
    };
    Progress& progress = context.progress != nullptr ? *context.progress : no_progress();
    if (options_.text("mesh") == "original") {
      if (!input.original_mesh || input.original_mesh->empty())
        return Error{
            "the model has no mesh of its own", "use mesh=advancing-front, or a file with faces", {}, 0};
      source_ = input.original_mesh;
    } else {
      Result<geometry::TriangleMesh> made = advancing_front(*input.cloud, progress);
      if (!made) return std::move(made).error();
      source_ = std::make_shared<geometry::TriangleMesh>(std::move(*made));
      phase("advancing-front");
    }
    report.notes.push_back(check_mesh(*source_).text());
    phase("check");
    Result<SurfaceMesh> built = SurfaceMesh::build(*source_, context.threads);
    if (!built) return std::move(built).error();
    mesh_ = std::make_unique<SurfaceMesh>(std::move(*built));
    phase("connect");
    Result<SegmentIndex> index = SegmentIndex::build(*mesh_, context.threads);
    if (!index) return std::move(index).error();
    index_.emplace(std::move(*index));
    phase("embree");
    shade_ = options_.text("shading") == "interpolated";
    if (shade_) {
      fill_vertex_normals();
      phase("normals");
    }
    world_from_model_ = input.world_from_model;
    model_from_world_ = input.world_from_model.inverse();
    stiffness_ = input.surface.stiffness_n_per_mm;
    force_limit_n_ = scene.force_limit_n;
    lift_mm_ = kLiftMargins * index_->margin_mm();
    report.bytes =
        mesh_->bytes() + index_->bytes() + vertex_normals_.capacity() * sizeof(Vec3f) + source_->bytes();
    reset(world_from_model_ * mesh_->origin_mm());
    return report;
  }

  void reset(const Vec3& hip_mm) noexcept override {
    clear_ = to_local(hip_mm);
    contact_ = false;
    counters_ = {};
  }

  Frame step(const Vec3& hip_mm, double) noexcept override {
    ++counters_.frames;
    Frame frame;
    if (!is_finite(hip_mm)) {
      frame.status = FrameStatus::kNonFinite;
      return frame;
    }
    frame.god_object_mm = hip_mm;
    const Vec3 h = to_local(hip_mm);
    if (!contact_ && !enter(h)) return frame;
    rounds_ = kMaxRounds;
    blocked_ = false;
    at_ = descend(*mesh_, at_, h, rounds_,
                  [&](const MeshPoint& from, MeshPoint& to) { return allowed(from, to, h); });
    counters_.walk_steps += static_cast<std::uint64_t>(kMaxRounds - rounds_);
    if (rounds_ == 0) {
      ++counters_.bound_hits;
      frame.status = FrameStatus::kBoundHit;
    } else if (outside(h)) {
      return frame;
    }
    Vec3 pull = at_.point - h;
    if (shade_) pull = shaded(pull);
    frame.contact = true;
    frame.model = 0;
    frame.god_object_mm = world_from_model_ * (at_.point + mesh_->origin_mm());
    frame.force_n = render::limited(world_from_model_.rotate(stiffness_ * pull), force_limit_n_);
    return frame;
  }

  render::FrameCounters counters() const noexcept override { return counters_; }
  render::Description describe() const override {
    return {"mesh-godobject", "god object on a mesh, contact by Embree", "Zilles and Salisbury 1995; Embree",
            fmt::format(
                "{} facets crossed and as many segment queries a frame, {} facets around a corner; an Embree "
                "query itself is bounded by its tree alone",
                kMaxRounds, kMaxFan),
            options_};
  }
  const geometry::TriangleMesh* mesh(std::size_t model) const noexcept override {
    return model == 0 ? source_.get() : nullptr;
  }

 private:
  Vec3 to_local(const Vec3& world_mm) const noexcept {
    return model_from_world_ * world_mm - mesh_->origin_mm();
  }

  /// Free: the way since the last clear point, so that no link of the chain is untested.
  bool enter(const Vec3& h) noexcept {
    const std::optional<SegmentHit> hit = index_->first_hit(clear_, h);
    if (!hit) {
      if (!index_->within(h, index_->margin_mm())) clear_ = h;
      return false;
    }
    const Facet& f = mesh_->facet(hit->facet);
    // The side the HIP came from, in double.
    const std::uint32_t side = f.scaled_normal().dot(clear_ - f.corner[0]) >= 0.0 ? 0u : 1u;
    const FacetPoint p = closest_on_facet(f, clear_ + hit->fraction * (h - clear_));
    at_ = {half_facet(hit->facet, side), p.feature, p.point, (p.point - h).squaredNorm()};
    contact_ = true;
    return true;
  }

  /// True where the HIP is on the free side at the god object, or past a rim: contact ends.
  bool outside(const Vec3& h) noexcept {
    bool boundary = false;
    const Vec3 up = mesh_->pseudonormal(at_.half, at_.feature, &boundary);
    const Vec3 r = h - at_.point;
    const double height = up.dot(r);
    bool out = height >= 0.0 && !blocked_;
    if (!out && boundary) {
      const Facet& f = mesh_->facet(facet_of(at_.half));
      double longest = 0.0;
      for (std::uint32_t e = 0; e < 3; ++e)
        longest = std::max(longest, (f.corner[after(e)] - f.corner[e]).squaredNorm());
      out = r.squaredNorm() - height * height > kRimEdges * kRimEdges * longest;
    }
    if (!out) return false;
    contact_ = false;
    // Just above the surface there is nothing but free space, wherever the HIP is now.
    clear_ = height >= 0.0 ? Vec3(at_.point + lift_mm_ * up) : h;
    return true;
  }

  /// Whether the god object may go from -> to, or some facet that is not connected here stands in the way.
  /// Then it goes as far as that facet and slides along the line of the two planes, up to a third: two and
  /// three active planes.
  bool allowed(const MeshPoint& from, MeshPoint& to, const Vec3& h) noexcept {
    if (blocked_) return false;
    if (to.point == from.point) return true;
    const Vec3 up = mesh_->normal(to.half);
    const Vec3 lift = lift_mm_ * up;
    const std::optional<SegmentHit> hit =
        index_->first_hit(from.point + lift, to.point + lift, facet_of(to.half));
    if (!hit) return true;
    blocked_ = true;
    const Facet& other = mesh_->facet(hit->facet);
    Vec3 wall = other.scaled_normal().normalized();
    if (wall.dot(from.point - other.corner[0]) < 0.0) wall = -wall;
    // A wall that the pull does not press against, or an edge brushed from behind, is no constraint.
    if (wall.dot(h - from.point) >= 0.0) {
      blocked_ = false;
      return true;
    }
    const Vec3 stop = from.point + hit->fraction * (to.point - from.point) + lift_mm_ * wall;
    const Facet& own = mesh_->facet(facet_of(to.half));
    Vec3 target = stop;
    const Vec3 line = up.cross(wall);
    if (line.squaredNorm() > kParallelSine * kParallelSine) {
      const Vec3 along = line.normalized();
      target = stop + along.dot(h - stop) * along;
      if (const auto third = index_->first_hit(stop + lift, target + lift, facet_of(to.half)))
        target = stop + third->fraction * (target - stop);
    }
    const FacetPoint p = closest_on_facet(own, target);
    to = {to.half, p.feature, p.point, (p.point - h).squaredNorm()};
    return true;
  }

  void fill_vertex_normals() {
    vertex_normals_.assign(mesh_->vertices().size(), Vec3f::Zero());
    for (std::uint32_t i = 0; i < mesh_->facets().size(); ++i)
      for (std::uint32_t c = 0; c < 3; ++c) {
        Vec3f& n = vertex_normals_[mesh_->facet(i).vertex[c]];
        if (n.squaredNorm() > 0.0f) continue;
        bool boundary = false;
        n = mesh_->pseudonormal(half_facet(i, 0), static_cast<Feature>(kCorner + c), &boundary).cast<float>();
      }
  }

  /// The pull's part along the normal interpolated from the corners (force shading, Morgenbesser and
  /// Srinivasan 1996).
  Vec3 shaded(const Vec3& pull) const noexcept {
    const Facet& f = mesh_->facet(facet_of(at_.half));
    const Vec3 n = f.scaled_normal();
    const double nn = n.squaredNorm();
    if (!(nn > 0.0)) return pull;
    Vec3 sum = Vec3::Zero();
    for (std::uint32_t c = 0; c < 3; ++c) {
      const Vec3& a = f.corner[after(c)];
      const double weight = (f.corner[before(c)] - a).cross(at_.point - a).dot(n) / nn;
      sum += weight * vertex_normals_[f.vertex[c]].cast<double>();
    }
    if (side_of(at_.half) != 0) sum = -sum;
    const double size = sum.norm();
    if (!(size > 0.0)) return pull;
    const double along = pull.dot(sum) / size;
    return along > 0.0 ? Vec3((along / size) * sum) : pull;
  }

  Options options_;
  std::shared_ptr<const geometry::TriangleMesh> source_;
  std::unique_ptr<SurfaceMesh> mesh_;
  std::optional<SegmentIndex> index_;
  std::vector<Vec3f> vertex_normals_;
  geometry::RigidTransform world_from_model_, model_from_world_;
  double stiffness_ = 0.0;
  double force_limit_n_ = 0.0;
  double lift_mm_ = 0.0;
  bool shade_ = false;

  Vec3 clear_ = Vec3::Zero();  ///< a point of the path in free space; everything since is tested from here
  MeshPoint at_;
  bool contact_ = false;
  bool blocked_ = false;
  int rounds_ = 0;
  render::FrameCounters counters_;
};

}  // namespace

render::RendererInfo mesh_godobject_info() {
  render::RendererInfo info;
  info.name = "mesh-godobject";
  info.summary = "god object on a mesh, contact found by Embree";
  info.source = "Zilles and Salisbury 1995; Embree";
  info.options = {
      {"mesh",
       OptionKind::kChoice,
       "advancing-front",
       "the mesh: the file's own, or CGAL's advancing front over the points",
       {"original", "advancing-front"}},
      {"shading",
       OptionKind::kChoice,
       "none",
       "force shading by interpolated vertex normals",
       {"none", "interpolated"}},
  };
  info.make = [](const Options& options) { return std::make_unique<MeshGodObject>(options); };
  return info;
}

}  // namespace palpate::baselines
