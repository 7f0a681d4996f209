#include "baselines/renderers/mesh_godobject.h"

#include <fmt/format.h>

#include "baselines/mesh/mesh_report.h"
#include "baselines/mesh_holder.h"
#include "baselines/renderers/mesh_probe.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/render/summed_models.h"
#include "toolkit/render/surface_response.h"

namespace palpate::baselines {
namespace {

constexpr const char* kName = "mesh-godobject";
constexpr const char* kSummary =
    "god object on a triangle mesh, up to three constraints solved within a frame";
constexpr const char* kSource = "Zilles and Salisbury 1995 (the thesis's [70]), entries by Embree";

/// A model's mesh with everything a frame reads; not moved after building.
class Model {
 public:
  std::shared_ptr<const geometry::TriangleMesh> source;
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
  Crossings crossings;
  std::unique_ptr<MeshProbe> probe;
  std::vector<Vec3f> vertex_normals;  ///< only with shading; per welded vertex, for side 0 of its first facet
  render::ModelPose place;
  render::SurfaceField surface;

  [[nodiscard]] render::ModelPose& pose() noexcept { return place; }
  void reset(const Vec3& h) noexcept {
    probe->reset(h);
    state_.release();
  }
  [[nodiscard]] render::ModelAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    const std::uint64_t moves = probe->moves();
    const bool touching = probe->update(h);
    counters.walk_steps += probe->moves() - moves;
    render::ModelAnswer answer;
    answer.bound_hit = probe->bound_hit();
    if (!touching) {
      state_.release();
      return answer;
    }
    const Vec3 target = vertex_normals.empty() ? probe->god_object().point : shaded_god_object(h);
    const auto [force, god_object] =
        render::respond_uniform(state_, surface, h, target - h, mesh.origin_mm());
    answer.contact = true;
    answer.force_n = force;
    answer.god_object = god_object;
    return answer;
  }

 private:
  [[nodiscard]] Vec3 shaded_god_object(const Vec3& hip) const noexcept;

  render::SurfaceState state_;
};

/// Two passes (Ruspini 1997): the HIP is projected on the plane through the god object whose normal is
/// interpolated from the facet's corners, and that point on the facet's own plane.
Vec3 Model::shaded_god_object(const Vec3& hip) const noexcept {
  const SurfacePosition& at = probe->god_object();
  const Facet& f = mesh.facet(facet_of(at.half));
  const Vec3 n = mesh.normal(at.half);
  Vec3 blend = Vec3::Zero();
  for (std::uint32_t i = 0; i < 3; ++i) {
    // The weight of corner i: the area opposite to it.
    const double area = (f.corner[after(i)] - at.point).cross(f.corner[before(i)] - at.point).norm();
    const Vec3 corner_normal = vertex_normals[f.vertex[i]].cast<double>();
    blend += corner_normal * (corner_normal.dot(n) < 0.0 ? -area : area);
  }
  const double size = blend.norm();
  if (!(size > 0.0) || n == Vec3::Zero()) return at.point;
  blend /= size;
  const Vec3 first = hip + blend * blend.dot(at.point - hip);
  return first - n * n.dot(first - at.point);
}

class MeshGodObject final : public render::HapticRenderer, public MeshHolder {
 public:
  explicit MeshGodObject(const Options& options)
      : options_(options), shaded_(options.text("shading") == "interpolated") {}

  Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                        const render::PrepareContext& context) override;
  void reset(const Vec3& hip_mm) noexcept override { models_.reset(hip_mm); }
  render::Frame step(const Vec3& hip_mm, double dt_s) noexcept override { return models_.step(hip_mm, dt_s); }
  render::FrameCounters counters() const noexcept override { return models_.counters(); }
  render::Description describe() const override;
  const geometry::TriangleMesh* mesh(std::size_t model) const noexcept override {
    return model < models_.size() ? models_[model].source.get() : nullptr;
  }

 private:
  Status prepare_model(const render::ModelInput& input, const render::PrepareContext& context,
                       render::PrepareReport& report);

  Options options_;
  bool shaded_;
  render::SummedModels<Model> models_;
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
  models_.clear(scene.force_limit_n);
  for (const render::ModelInput& input : scene.models)
    if (Status done = prepare_model(input, context, report); !done.ok()) return std::move(done).error();
  report.notes.push_back(shaded_ ? "shading by interpolated vertex normals (two passes, Ruspini 1997)"
                                 : "shading off");
  return report;
}

Status MeshGodObject::prepare_model(const render::ModelInput& input, const render::PrepareContext& context,
                                    render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  auto model = std::make_unique<Model>();
  auto source = mesh_of(input, options_, phases);
  if (!source.ok()) return std::move(source).error();
  model->source = std::move(source).value();
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
  model->place = render::ModelPose(input, model->mesh.origin_mm());
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
  models_.add(std::move(model));
  return Done{};
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
  OptionSpec shading{"shading", OptionKind::kChoice, "none",
                     "force shading by interpolated vertex normals, or none"};
  shading.choices = {"none", "interpolated"};
  info.options = mesh_source_specs();
  info.options.push_back(std::move(shading));
  info.make = [](const Options& options) { return std::make_unique<MeshGodObject>(options); };
  return info;
}

}  // namespace palpate::baselines
