#include "baselines/renderers/mesh_source.h"

#include <fmt/format.h>

#include <atomic>
#include <utility>

#include "baselines/reconstruct/reconstruct.h"

namespace palpate::baselines {
namespace {

std::atomic<std::uint64_t> recorded_meshes{0};

constexpr double kBytesPerGb = 1e9;
constexpr const char* kAuto = "auto";
constexpr const char* kOriginal = "original";
/// What `auto` makes where the model brings no faces: the fastest of those that go through every point.
constexpr const char* kMadeByDefault = "advancing-front";

bool has_faces(const render::ModelInput& input) {
  return input.original_mesh != nullptr && !input.original_mesh->empty();
}

/// A surface that goes through its points has some two facets for each (Euler).
constexpr double kFacetsPerPoint = 2.0;
/// Advancing front of 1,002,001 points less what the mesh renderer does with the mesh (table 7 of reproduce).
constexpr double kMadeMsPerMillion = 35'000.0;

}  // namespace

std::vector<OptionSpec> mesh_source_specs(const std::string& usual) {
  OptionSpec mesh{"mesh",
                  OptionKind::kChoice,
                  usual,
                  fmt::format("which mesh: the file's own or a reconstruction; auto: the file's own where it "
                              "has faces, else {}",
                              kMadeByDefault),
                  {kAuto, kOriginal}};
  for (const Method& method : methods()) mesh.choices.push_back(method.name);
  const std::vector<OptionCondition> made = {{"mesh", {kOriginal}, true}};
  std::vector<OptionSpec> specs = {
      std::move(mesh),
      {"mesh_time_limit_s",
       OptionKind::kNumber,
       "120",
       "a reconstruction may take so long; 0: no limit",
       {},
       0.0,
       1e9,
       made},
      {"mesh_memory_limit_gb",
       OptionKind::kNumber,
       "0",
       "a reconstruction may use so much memory; 0: three quarters of the machine's",
       {},
       0.0,
       1e6,
       made},
      {"mesh_cache",
       OptionKind::kFlag,
       "true",
       "take a reconstruction from the cache, and keep it there",
       {},
       0,
       0,
       made}};
  for (OptionSpec& spec : all_method_options("mesh")) specs.push_back(std::move(spec));
  return specs;
}

Result<MeshSource> decide_mesh(const render::ModelInput& input, const Options& options) {
  const std::string& asked = options.text("mesh");
  MeshSource source;
  source.name = asked != kAuto ? asked : has_faces(input) ? kOriginal : kMadeByDefault;
  source.made = source.name != kOriginal;
  if (!source.made && !has_faces(input))
    return Error{fmt::format("model '{}' brings no mesh of its own", input.name),
                 "take a reconstruction, for example mesh=advancing-front",
                 {},
                 0};
  source.facets = source.made ? kFacetsPerPoint * static_cast<double>(input.cloud->size())
                              : static_cast<double>(input.original_mesh->triangles.size());
  std::string reason = "as given";
  if (asked == kAuto)
    reason = source.made
                 ? fmt::format("{}, since the model brings no faces of its own (auto)", source.name)
                 : fmt::format("the model's own {} faces (auto)", input.original_mesh->triangles.size());
  source.said = {"mesh", source.name, std::move(reason), asked != kAuto};
  return source;
}

std::optional<double> expected_ms(const MeshSource& source, std::uint64_t points) {
  if (!source.made) return 0.0;
  if (source.name != kMadeByDefault) return std::nullopt;
  return kMadeMsPerMillion * 1e-6 * static_cast<double>(points);
}

Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                              const MeshSource& source,
                                                              const Options& options, int threads,
                                                              render::PreparePhases& phases) {
  if (!source.said.given) phases.note(source.note());
  if (!source.made) return input.original_mesh;
  const std::string& name = source.name;
  const Result<const Method*> method = find_method(name);
  if (!method) return method.error();
  std::optional<MeshCache> cache;
  if (options.flag("mesh_cache")) cache = MeshCache::standard();
  ReconstructRequest request;
  request.method = name;
  request.options = own_options(**method, options);
  request.limits.time_s = options.number("mesh_time_limit_s");
  request.limits.memory_bytes =
      static_cast<std::size_t>(options.number("mesh_memory_limit_gb") * kBytesPerGb);
  request.threads = threads;
  request.cache = cache ? &*cache : nullptr;
  Result<Reconstruction> made = reconstruct(request, *input.cloud, phases.progress());
  if (!made) return std::move(made).error();
  for (render::PreparePhase& phase : made->made.phases)
    phases.add({fmt::format("{}: {}", name, phase.name), phase.ms});
  for (std::string& note : made->made.notes) phases.note(std::move(note));
  if (made->recorded) {
    ++recorded_meshes;
    phases.note(fmt::format("{}: from the cache; its times are those of {}, on {} threads", name,
                            made->made_on, made->threads));
  }
  return std::make_shared<const geometry::TriangleMesh>(std::move(made->mesh));
}

std::uint64_t meshes_from_cache() noexcept {
  return recorded_meshes;
}

}  // namespace palpate::baselines
