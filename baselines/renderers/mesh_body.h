// A model's mesh prepared for rendering: what every mesh renderer builds before its first frame.
#pragma once

#include <memory>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/crossings.h"
#include "baselines/proximity/segment_index.h"
#include "toolkit/core/options.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::baselines {

/// Not moved after building: the index holds its mesh's address.
struct MeshBody {
  std::shared_ptr<const geometry::TriangleMesh> source;
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
  Crossings crossings;                ///< only where asked for
  std::vector<Vec3f> vertex_normals;  ///< only with shading; see vertex_normals.h
  double median_edge_mm = 0.0;
  render::ModelPose pose;
  render::SurfaceField surface;

  [[nodiscard]] std::size_t bytes() const noexcept;
};

struct MeshBodyNeeds {
  bool crossings = true;
  bool normals = false;
};

/// The options of every mesh renderer: which mesh, shading, how contacts combine.
[[nodiscard]] std::vector<OptionSpec> mesh_renderer_specs();
[[nodiscard]] bool wants_shading(const Options& options);

/// Everything from the model to what a frame reads, each step a phase of the report.
[[nodiscard]] Result<std::unique_ptr<MeshBody>> prepare_body(const render::ModelInput& input,
                                                             const Options& options,
                                                             const MeshBodyNeeds& needs,
                                                             const render::PrepareContext& context,
                                                             render::PrepareReport& report);

}  // namespace palpate::baselines
