// The mesh of a mesh renderer: the file's own or a reconstruction from the points, then repaired, smoothed
// and decimated as its options ask, each a timed phase; and access to it, for --save-mesh.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include "toolkit/render/prepare.h"

namespace palpate::baselines {

/// Options that choose the mesh of every mesh renderer: `mesh` (default `usual`), limits and cache of
/// reconstructions, options of every method.
[[nodiscard]] std::vector<OptionSpec> mesh_source_specs(const std::string& usual = "auto");

/// The mesh that the options select for a model, before it is made.
struct MeshSource {
  std::string name;     ///< "original", or the reconstruction method
  bool made = false;    ///< by a method
  double facets = 0.0;  ///< its own, or about two a point
  render::Decision explanation;
  [[nodiscard]] std::string note() const { return explanation.about + ": " + explanation.reason; }
};
/// `options`: complete, including mesh_source_specs(). An Error if the model lacks the requested own mesh.
[[nodiscard]] Result<MeshSource> decide_mesh(const render::ModelInput& input, const Options& options);

/// Expected time for so many points, where measured.
[[nodiscard]] std::optional<double> expected_ms(const MeshSource& source, std::uint64_t points);

/// The decided mesh, never null or empty. Its steps are phases; a cached mesh gives the times of its making,
/// with a note. Errors: those of reconstruct().
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> mesh_of(const render::ModelInput& input,
                                                                            const MeshSource& source,
                                                                            const Options& options,
                                                                            int threads,
                                                                            render::PreparePhases& phases);

/// Meshes this process took from the cache so far, for telling whether a preparation did.
[[nodiscard]] std::uint64_t meshes_from_cache() noexcept;

/// repair, repair_holes, smooth, decimate; all off by default.
[[nodiscard]] std::vector<OptionSpec> mesh_refine_specs();

/// Applies repair, smoothing and decimation to `source`, in this order, as `options` ask; returns `source`
/// itself if none. Notes give repairs, facets left, and distances from the points and from `source`, both
/// ways, measured in a phase that a pipeline in use would omit.
[[nodiscard]] Result<std::shared_ptr<const geometry::TriangleMesh>> refined(
    std::shared_ptr<const geometry::TriangleMesh> source, const render::ModelInput& input,
    const Options& options, int threads, render::PreparePhases& phases);

/// Implemented by mesh renderers (dynamic_cast from HapticRenderer).
class MeshHolder {
 public:
  MeshHolder() = default;
  MeshHolder(const MeshHolder&) = delete;
  MeshHolder& operator=(const MeshHolder&) = delete;
  virtual ~MeshHolder() = default;
  /// The mesh of model `model` as used after prepare(), model frame, or null. The file's own faces are
  /// returned unchanged; others are assembled on first request, in walking order. Valid until the next
  /// prepare() or the renderer's end. Single-threaded; not for frames.
  [[nodiscard]] virtual const geometry::TriangleMesh* mesh(std::size_t model) const = 0;
};

}  // namespace palpate::baselines
