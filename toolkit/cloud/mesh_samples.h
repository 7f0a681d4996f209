// Points of a mesh that are not its vertices: anywhere in its facets, or as a scanner would see it. The mesh
// stays the truth, and shares no place with what is made of the points.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::cloud {

struct MeshSampling {
  std::string name;
  std::string summary;
  std::vector<OptionSpec> options;
};

/// random: anywhere, even by area. blue: the same with a least distance of 0.7 spacings. scan: a simulated
/// scanner's rays (scanner.h).
[[nodiscard]] const std::vector<MeshSampling>& mesh_samplings();
[[nodiscard]] const MeshSampling* find_mesh_sampling(std::string_view name);

/// `given` completed by the sampling's defaults.
[[nodiscard]] Result<Options> complete_sampling(const NamedOptions& given);

struct MeshSamples {
  Cloud cloud;                                          ///< without a raster
  std::shared_ptr<const geometry::TriangleMesh> truth;  ///< what was sampled: the mesh, or its subdivision
  std::string spec;                                     ///< the sampling with every option
  double spacing_mm = 0.0;  ///< root of area over points; of a scan the distance of its rays
  double edge_mm = 0.0;     ///< median edge of `truth`
};

/// Options of all: `points`, or `spacing` in median edges of the truth (1 where neither is given);
/// `subdivide`: how often Loop's subdivision smooths the mesh first; `noise` in spacings (along the facet's
/// normal; of a scan along the ray); `seed`. The same points with any number of threads. Errors: a mesh
/// without area, unknown names and options, too many points.
[[nodiscard]] Result<MeshSamples> sample_mesh(std::shared_ptr<const geometry::TriangleMesh> mesh,
                                              const NamedOptions& spec);

}  // namespace palpate::cloud
