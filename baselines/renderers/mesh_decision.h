// What a mesh renderer builds of a model, decided without making a mesh: prepare_body() follows it, `palpate
// plan` prints it.
#pragma once

#include "baselines/mesh/surface_mesh.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/core/options.h"
#include "toolkit/render/surface_field.h"

namespace palpate::baselines {

/// What a kind of probe needs and costs.
struct MeshProbeKind {
  bool crossings = true;   ///< facets that cross others can hold it, where they are looked for
  render::Decision probe;  ///< what goes over the mesh
  // Measured, what to expect (see render::kExpectedOn): 1,002,001 points.
  double frame_us = 0.0;
  double ms_per_million_facets = 0.0;
};

struct MeshDecision {
  MeshSource source;
  bool repairs = false;
  long long smoothing = 0;  ///< rounds
  double keeps = 1.0;       ///< share of the facets after decimation
  bool normals = false;     ///< at the vertices, for shading
  MeshFrame frame = MeshFrame::kLocal;
  bool point = true;       ///< what goes over it has no size: folds can catch it
  bool checks = false;     ///< the mesh is looked at for people: pieces, borders
  bool crossings = false;  ///< facets that cross others are looked for
  render::SurfaceDecision surface;
};

/// What every mesh renderer feels.
inline constexpr render::Features kMeshFeels = render::kAllOfRigidSurfaces | render::Feature::kJointContact;

/// `options`: complete, of mesh_renderer_specs() among others. Errors: decide_mesh(), decide_surface().
[[nodiscard]] Result<MeshDecision> decide_body(const render::ModelInput& input, const Options& options,
                                               const MeshProbeKind& kind);

/// In words, with bytes and times, which are estimates.
[[nodiscard]] render::ModelDecisions said(const render::ModelInput& input, const MeshDecision& decision,
                                          const MeshProbeKind& kind);

}  // namespace palpate::baselines
