// A model's mesh prepared for rendering: what every mesh renderer builds before its first frame.
#pragma once

#include <memory>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/crossings.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/renderers/free_side.h"
#include "baselines/renderers/mesh_decision.h"
#include "toolkit/core/options.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::baselines {

/// The mesh that frames read. Immutable and shared; not moved after building: the index holds its mesh's
/// address.
struct MeshGeometry {
  /// The model's own faces, where these are felt as they came; null where `mesh` alone has the faces.
  std::shared_ptr<const geometry::TriangleMesh> given;
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
  Crossings crossings;                ///< only where asked for
  PieceSides sides;                   ///< only for a point
  std::vector<Vec3f> vertex_normals;  ///< only with shading; see vertex_normals.h
  double median_edge_mm = 0.0;

  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// One model as one renderer holds it.
struct MeshBody {
  std::shared_ptr<const MeshGeometry> geometry;
  render::ModelPose pose;
  render::SurfaceField surface;  ///< by vertex

  [[nodiscard]] const SurfaceMesh& mesh() const noexcept { return geometry->mesh; }
};

/// The options of every mesh renderer: which mesh, shading, how contacts combine.
[[nodiscard]] std::vector<OptionSpec> mesh_renderer_specs();

/// Everything from the model to what a frame reads as decided, each step a phase of the report. The mesh
/// comes from the context's store where it has one.
[[nodiscard]] Result<std::unique_ptr<MeshBody>> prepare_body(const render::ModelInput& input,
                                                             const MeshDecision& decided,
                                                             const Options& options,
                                                             const render::PrepareContext& context,
                                                             render::PrepareReport& report);

}  // namespace palpate::baselines
