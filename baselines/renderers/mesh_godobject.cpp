#include "baselines/renderers/mesh_godobject.h"

#include <fmt/format.h>

#include "baselines/mesh/mesh_report.h"
#include "baselines/mesh_holder.h"
#include "baselines/reconstruct/advancing_front.h"
#include "baselines/renderers/mesh_probe.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {
namespace {

constexpr const char* kName = "mesh-godobject";
constexpr const char* kSummary =
    "god object on a triangle mesh, up to three constraints solved within a frame";
constexpr const char* kSource = "Zilles and Salisbury 1995 (the thesis's [70]), entries by Embree";

/// A model's mesh with everything a frame reads; not moved after building.
struct Model {
  std::shared_ptr<const geometry::TriangleMesh> source;
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
  Crossings crossings;
  std::unique_ptr<MeshProbe> probe;
  std::vector<Vec3f> vertex_normals;  ///< only with shading; per welded vertex, for side 0 of its first facet
  geometry::RigidTransform world_from_model, model_from_world;
  std::shared_ptr<render::MovingModel> motion;  ///< or null: at rest
  render::SurfaceField surface;
  render::SurfaceState state;

  void pose_at(double now_s) noexcept {
    if (motion == nullptr) return;
    world_from_model = motion->newest().at(now_s);
    model_from_world = world_from_model.inverse();
  }

  [[nodiscard]] Vec3 to_local(const Vec3& world_mm) const noexcept {
    return model_from_world * world_mm - mesh.origin_mm();
  }
  [[nodiscard]] Vec3 to_world(const Vec3& local_mm) const noexcept {
    return world_from_model * (local_mm + mesh.origin_mm());
  }
};

class MeshGodObject final : public render::HapticRenderer, public MeshHolder {
 public:
  explicit MeshGodObject(const Options& options)
      : options_(options), shaded_(options.text("shading") == "interpolated") {}

  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override;
  void reset(const Vec3& hip_mm) noexcept override;
  render::Frame step(const Vec3& hip_mm, double dt_s) noexcept override;
  render::FrameCounters counters() const noexcept override;
  render::Description describe() const override;
  const geometry::TriangleMesh* mesh(std::size_t model) const noexcept override {
    return model < models_.size() ? models_[model]->source.get() : nullptr;
  }

 private:
  Status prepare_model(const render::ModelInput& input, const render::PrepareContext& context,
                       render::PrepareReport& report);
  [[nodiscard]] Vec3 shaded_god_object(const Model& model, const Vec3& hip) const noexcept;
  [[nodiscard]] static render::SurfaceAnswer answer(Model& model, const Vec3& hip,
                                                    const Vec3& target) noexcept;

  Options options_;
  bool shaded_;
  double force_limit_n_ = 0.0;
  double now_s_ = 0.0;
  std::vector<std::unique_ptr<Model>> models_;
  render::Frame last_;
  render::FrameCounters counters_;
};

/// Adds phases to a report.
class Phases {
 public:
  Phases(render::PrepareReport& report, const render::PrepareContext& context)
      : report_(report), progress_(context.progress != nullptr ? *context.progress : no_progress()) {}
  void begin(const char* name) {
    name_ = name;
    progress_.report(name, -1.0);
    watch_.restart();
  }
  void end() {
    report_.phases.push_back({name_, watch_.ms()});
    report_.total_ms += report_.phases.back().ms;
  }
  Progress& progress() { return progress_; }

 private:
  render::PrepareReport& report_;
  Progress& progress_;
  std::string name_;
  Stopwatch watch_;
};

std::vector<Vec3f> interpolation_normals(const SurfaceMesh& mesh) {
  std::vector<Vec3f> normals(mesh.vertices().size(), Vec3f::Zero());
  for (std::uint32_t v = 0; v < normals.size(); ++v) {
    if (mesh.star(v).empty()) continue;
    const std::uint32_t facet = mesh.star(v)[0];
    std::uint32_t corner = 0;
    while (corner < 2 && mesh.facet(facet).vertex[corner] != v) ++corner;
    // Area weights over the fan, on the side that the first facet calls 0.
    Vec3 sum = mesh.facet(facet).scaled_normal();
    mesh.around_corner(half_facet(facet, 0), corner, [&](HalfFacet half) {
      sum += mesh.facet(facet_of(half)).scaled_normal() * (side_of(half) == 0 ? 1.0 : -1.0);
    });
    const double size = sum.norm();
    if (size > 0.0) normals[v] = (sum / size).cast<float>();
  }
  return normals;
}

Result<render::PrepareReport> MeshGodObject::prepare(const render::SceneInput& scene,
                                                     const render::PrepareContext& context) {
  render::PrepareReport report;
  force_limit_n_ = scene.force_limit_n;
  models_.clear();
  for (const render::ModelInput& input : scene.models)
    if (Status done = prepare_model(input, context, report); !done.ok()) return std::move(done).error();
  report.notes.push_back(shaded_ ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                 : "shading off");
  return report;
}

Status MeshGodObject::prepare_model(const render::ModelInput& input, const render::PrepareContext& context,
                                    render::PrepareReport& report) {
  Phases phases(report, context);
  auto model = std::make_unique<Model>();
  if (options_.text("mesh") == "original") {
    if (input.original_mesh == nullptr || input.original_mesh->empty())
      return Error{fmt::format("model '{}' brings no mesh of its own", input.name),
                   "use mesh-godobject:mesh=advancing-front",
                   {},
                   0};
    model->source = input.original_mesh;
  } else {
    phases.begin("advancing front (CGAL)");
    ReconstructionReport found;
    auto made = advancing_front(*input.cloud, phases.progress(), &found);
    if (!made.ok()) return std::move(made).error();
    model->source = std::make_shared<const geometry::TriangleMesh>(std::move(made).value());
    phases.end();
    report.notes.push_back(
        fmt::format("advancing front: Delaunay {:.0f} ms, front {:.0f} ms, {} duplicate points",
                    found.triangulation_ms, found.front_ms, found.duplicates));
  }
  phases.begin("connect facets");
  auto mesh = SurfaceMesh::build(*model->source, context.threads);
  if (!mesh.ok()) return std::move(mesh).error();
  model->mesh = std::move(mesh).value();
  if (shaded_) model->vertex_normals = interpolation_normals(model->mesh);
  phases.end();
  phases.begin("check (OpenMesh)");
  for (std::string& line : baselines::describe(report_on(model->mesh), model->mesh.counts()))
    report.notes.push_back(std::move(line));
  phases.end();
  phases.begin("build tree (Embree)");
  auto index = SegmentIndex::build(model->mesh, context.threads);
  if (!index.ok()) return std::move(index).error();
  model->index = std::make_unique<SegmentIndex>(std::move(index).value());
  phases.end();
  phases.begin("find crossing facets");
  model->crossings = Crossings::find(model->mesh, *model->index, context.threads);
  phases.end();
  if (model->crossings.any())
    report.notes.push_back(
        fmt::format("mesh: {} facets cross others ({} pairs): they constrain the god object",
                    model->crossings.facets(), model->crossings.pairs()));
  model->probe = std::make_unique<MeshProbe>(model->mesh, *model->index, model->crossings);
  model->world_from_model = input.world_from_model;
  model->model_from_world = input.world_from_model.inverse();
  model->motion = input.motion;
  if (input.surface.per_point != nullptr)
    return Error{fmt::format("model '{}' has properties that differ from point to point", input.name),
                 "mesh-godobject takes one value for the whole model: leave out regions and columns",
                 {},
                 0};
  Result<render::SurfaceField> surface = render::build_uniform_surface_field(input.surface, report);
  if (!surface.ok()) return std::move(surface).error();
  model->surface = std::move(surface).value();
  report.bytes += model->source->bytes() + model->mesh.bytes() + model->index->bytes() +
                  model->crossings.bytes() + model->vertex_normals.capacity() * sizeof(Vec3f);
  models_.push_back(std::move(model));
  return Done{};
}

void MeshGodObject::reset(const Vec3& hip_mm) noexcept {
  counters_ = {};
  last_ = {};
  last_.god_object_mm = hip_mm;
  now_s_ = 0.0;
  for (const auto& model : models_) {
    model->pose_at(now_s_);
    model->probe->reset(model->to_local(hip_mm));
    model->state.release();
  }
}

/// Two passes (Ruspini 1997): the HIP is projected on the plane through the god object whose normal is
/// interpolated from the facet's corners, and that point on the facet's own plane.
Vec3 MeshGodObject::shaded_god_object(const Model& model, const Vec3& hip) const noexcept {
  const SurfacePosition& at = model.probe->god_object();
  const Facet& f = model.mesh.facet(facet_of(at.half));
  const Vec3 n = model.mesh.normal(at.half);
  Vec3 blend = Vec3::Zero();
  for (std::uint32_t i = 0; i < 3; ++i) {
    // The weight of corner i: the area opposite to it.
    const double area = (f.corner[after(i)] - at.point).cross(f.corner[before(i)] - at.point).norm();
    const Vec3 corner_normal = model.vertex_normals[f.vertex[i]].cast<double>();
    blend += corner_normal * (corner_normal.dot(n) < 0.0 ? -area : area);
  }
  const double size = blend.norm();
  if (!(size > 0.0) || n == Vec3::Zero()) return at.point;
  blend /= size;
  const Vec3 first = hip + blend * blend.dot(at.point - hip);
  return first - n * n.dot(first - at.point);
}

/// The surface's own part: the same stage that the point renderers use.
render::SurfaceAnswer MeshGodObject::answer(Model& model, const Vec3& hip, const Vec3& target) noexcept {
  render::SurfaceContact contact;
  contact.hip = hip;
  contact.pull = target - hip;
  contact.stiffness_n_per_mm = model.surface.stiffness_n_per_mm;
  if (model.surface.features == 0)
    return model.state.respond<0>(contact, model.surface.texture, Vec3::Zero());
  contact.static_friction = model.surface.friction.static_coefficient;
  contact.dynamic_friction = model.surface.friction.dynamic_coefficient;
  const Vec3& origin = model.mesh.origin_mm();
  if ((model.surface.features & render::kTexture) == 0)
    return model.state.respond<render::kFriction>(contact, model.surface.texture, origin);
  return model.state.respond<render::kFriction | render::kTexture>(contact, model.surface.texture, origin);
}

render::Frame MeshGodObject::step(const Vec3& hip_mm, double dt_s) noexcept {
  ++counters_.frames;
  now_s_ += dt_s;
  render::Frame frame;
  if (!is_finite(hip_mm)) {
    frame = last_;
    frame.force_n = Vec3::Zero();
    frame.status = render::FrameStatus::kNonFinite;
    return frame;
  }
  frame.god_object_mm = hip_mm;
  double deepest_n = -1.0;
  for (std::size_t i = 0; i < models_.size(); ++i) {
    Model& model = *models_[i];
    model.pose_at(now_s_);
    const Vec3 hip = model.to_local(hip_mm);
    const std::uint64_t moves = model.probe->moves();
    const bool touching = model.probe->update(hip);
    counters_.walk_steps += model.probe->moves() - moves;
    if (model.probe->bound_hit()) frame.status = render::FrameStatus::kBoundHit;
    if (!touching) {
      model.state.release();
      continue;
    }
    const Vec3 target = shaded_ ? shaded_god_object(model, hip) : model.probe->god_object().point;
    const auto [local_force, god_object] = answer(model, hip, target);
    const Vec3 force = model.world_from_model.rotate(local_force);
    frame.force_n += force;
    frame.contact = true;
    if (force.norm() > deepest_n) {
      deepest_n = force.norm();
      frame.god_object_mm = model.to_world(god_object);
      frame.model = static_cast<std::int32_t>(i);
    }
  }
  frame.force_n = render::limited(frame.force_n, force_limit_n_);
  counters_.bound_hits += frame.status == render::FrameStatus::kBoundHit;
  last_ = frame;
  return frame;
}

render::FrameCounters MeshGodObject::counters() const noexcept {
  return counters_;
}

render::Description MeshGodObject::describe() const {
  return {
      kName, kSummary, kSource,
      fmt::format(
          "a model: at most {} flights of two Embree queries (each O(log facets)), {} facets and one fan of "
          "{} looked at a flight; on facets that cross others times their number",
          kMaxFlights, kMaxFacetsPerFrame, kMaxFan),
      options_};
}

}  // namespace

render::RendererInfo mesh_godobject_info() {
  render::RendererInfo info;
  info.name = kName;
  info.summary = kSummary;
  info.source = kSource;
  OptionSpec mesh{"mesh", OptionKind::kChoice, "advancing-front",
                  "which mesh: the file's own or a reconstruction"};
  mesh.choices = {"original", "advancing-front"};
  OptionSpec shading{"shading", OptionKind::kChoice, "none",
                     "force shading by interpolated vertex normals, or none"};
  shading.choices = {"none", "interpolated"};
  info.options = {mesh, shading};
  info.make = [](const Options& options) { return std::make_unique<MeshGodObject>(options); };
  return info;
}

}  // namespace palpate::baselines
