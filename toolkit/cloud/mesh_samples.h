// Samples points on a mesh, at random or as a scanner. The mesh stays the truth and shares no vertex with the
// points.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::cloud {

struct MeshSampling {
  std::string name;
  std::string summary;
  std::vector<OptionSpec> options;
};

/// random: uniform by area. blue: the same with a least distance of 0.7 spacings. scan: a simulated scanner's
/// rays (scanner.h).
[[nodiscard]] const std::vector<MeshSampling>& mesh_samplings();
[[nodiscard]] const MeshSampling* find_mesh_sampling(std::string_view name);

/// `given` completed by the sampling's defaults.
[[nodiscard]] Result<Options> complete_sampling(const NamedOptions& given);

struct MeshSamples {
  Cloud cloud;                                          ///< without a raster
  std::shared_ptr<const geometry::TriangleMesh> truth;  ///< the sampled mesh or its subdivision
  std::string spec;                                     ///< the sampling with every option
  double spacing_mm = 0.0;  ///< sqrt(area / points); for a scan the distance of rays
  double edge_mm = 0.0;     ///< median edge of `truth`
};

/// Options of all: `points`, or `spacing` in median edges of the truth (default 1); `subdivide`: rounds of
/// Loop subdivision first; `noise` in spacings (along the facet's normal, or a scan's ray); `seed`.
/// Independent of the number of threads. Errors: a mesh without area, unknown names and options, too many
/// points.
[[nodiscard]] Result<MeshSamples> sample_mesh(std::shared_ptr<const geometry::TriangleMesh> mesh,
                                              const NamedOptions& spec);

}  // namespace palpate::cloud
