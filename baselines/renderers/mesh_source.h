// Which mesh a mesh renderer gets: the file's own, or one reconstructed from the points.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/render/renderer.h"

namespace palpate::baselines {

/// The options that choose the mesh, the same for every mesh renderer: `mesh`, which is `usual` where nothing
/// is said, the limits and the cache of a reconstruction, and the options of every method.
[[nodiscard]] std::vector<OptionSpec> mesh_source_specs(const std::string& usual = "auto");

/// Which mesh the options mean for a model: told without making it.
struct MeshSource {
  std::string name;     ///< "original", or the method that makes it
  bool made = false;    ///< by a method
  double facets = 0.0;  ///< its own, or some two a point
  render::Decision said;
  [[nodiscard]] std::string note() const { return said.about + ": " + said.reason; }
};
/// `options`: complete, of mesh_source_specs() among others. Errors: the model brings no mesh of its own.
[[nodiscard]] Result<MeshSource> decide_mesh(const render::ModelInput& input, const Options& options);

/// What making such a mesh of so many points takes, where it was measured.
[[nodiscard]] std::optional<double> expected_ms(const MeshSource& source, std::uint64_t points);

/// The mesh as decided, never null or empty. The steps of making it are phases, with the times of the day it
/// was made where it comes from the cache, and a note says so. Errors: those of reconstruct().
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                                            const MeshSource& source,
                                                                            const Options& options,
                                                                            int threads,
                                                                            render::PreparePhases& phases);

/// How many meshes this process has taken from the cache so far: who measures preparation asks before and
/// after.
[[nodiscard]] std::uint64_t meshes_from_cache() noexcept;

}  // namespace palpate::baselines
