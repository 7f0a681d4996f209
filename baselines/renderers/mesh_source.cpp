#include "baselines/renderers/mesh_source.h"

#include <fmt/format.h>

#include <utility>

#include "baselines/reconstruct/advancing_front.h"

namespace palpate::baselines {

std::vector<OptionSpec> mesh_source_specs() {
  return {{"mesh",
           OptionKind::kChoice,
           "advancing-front",
           "which mesh: the file's own or a reconstruction",
           {"original", "advancing-front"}}};
}

Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                              const Options& options,
                                                              render::PreparePhases& phases) {
  if (options.text("mesh") == "original") {
    if (input.original_mesh == nullptr || input.original_mesh->empty())
      return Error{fmt::format("model '{}' brings no mesh of its own", input.name),
                   "take a reconstruction, for example mesh=advancing-front",
                   {},
                   0};
    return input.original_mesh;
  }
  phases.begin("advancing front (CGAL)");
  ReconstructionReport found;
  auto made = advancing_front(*input.cloud, phases.progress(), &found);
  if (!made.ok()) return std::move(made).error();
  phases.end();
  phases.note(fmt::format("advancing front: Delaunay {:.0f} ms, front {:.0f} ms, {} duplicate points",
                          found.triangulation_ms, found.front_ms, found.duplicates));
  return std::make_shared<const geometry::TriangleMesh>(std::move(made).value());
}

}  // namespace palpate::baselines
