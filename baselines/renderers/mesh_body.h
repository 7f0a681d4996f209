// A model's mesh: what a mesh renderer builds for it (decided before, as `palpate plan` prints it), and the
// result, prepared for frames.
#pragma once

#include <memory>
#include <vector>

#include <palpate/options.h>
#include "baselines/mesh/pieces.h"
#include "baselines/mesh/surface_mesh.h"
#include "baselines/proximity/segment_index.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/model_pose.h"
#include "toolkit/render/surface_field.h"

namespace palpate::baselines {

/// Needs and costs of a kind of probe.
struct MeshProbeKind {
  bool crossings = true;   ///< whether crossing facets can hold it
  render::Decision probe;  ///< moves over the mesh
  // Measured expectations for 1,002,001 points (see render::kReferenceMachine).
  double frame_us = 0.0;
  double ms_per_million_facets = 0.0;
};

struct MeshDecision {
  MeshSource source;
  bool repairs = false;
  long long smoothing = 0;  ///< rounds
  double keeps = 1.0;       ///< share of facets after decimation
  bool normals = false;     ///< at vertices, for shading
  MeshFrame frame = MeshFrame::kLocal;
  bool point = true;       ///< the probe has no size, so folds can catch it
  bool checks = false;     ///< report pieces and borders
  bool crossings = false;  ///< search for crossing facets
  render::SurfaceDecision surface;
};

inline constexpr render::Features kMeshFeatures =
    render::kAllOfRigidSurfaces | render::Feature::kJointContact;

/// `options`: complete, including mesh_renderer_specs(). Errors: those of decide_mesh(), decide_surface().
[[nodiscard]] Result<MeshDecision> decide_body(const render::ModelInput& input, const Options& options,
                                               const MeshProbeKind& kind);

/// Describes the decision with estimated bytes and times.
[[nodiscard]] render::ModelDecisions explanation(const render::ModelInput& input,
                                                 const MeshDecision& decision, const MeshProbeKind& kind);

/// Mesh data read by frames. Immutable, shared, and not movable: the index holds the mesh's address.
struct MeshGeometry {
  /// The model's own faces if used unchanged; null if only `mesh` has the faces.
  std::shared_ptr<const geometry::TriangleMesh> given;
  SurfaceMesh mesh;
  std::unique_ptr<SegmentIndex> index;
  Crossings crossings;                ///< only on request
  PieceOrientation sides;             ///< only for a point
  std::vector<Vec3f> vertex_normals;  ///< only with shading: interpolation_normals()
  double median_edge_mm = 0.0;

  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// One model held by one renderer.
struct MeshBody {
  std::shared_ptr<const MeshGeometry>
      geometry;  ///< null: there is nothing to feel, as before a stream's image
  render::ModelPose pose;
  render::SurfaceField surface;  ///< per vertex

  [[nodiscard]] const SurfaceMesh& mesh() const noexcept { return geometry->mesh; }
};

/// Options of every mesh renderer: mesh, shading, combination of contacts.
[[nodiscard]] std::vector<OptionSpec> mesh_renderer_specs();

/// Builds all that frames read, each step a phase of the report. Uses the context's stored mesh if present.
[[nodiscard]] Result<std::unique_ptr<MeshBody>> prepare_body(const render::ModelInput& input,
                                                             const MeshDecision& decided,
                                                             const Options& options,
                                                             const render::PrepareContext& context,
                                                             render::PrepareReport& report);

// A triangle mesh of a depth image: two facets for each square of four measured pixels on one sheet, with
// what a mesh renderer's frames read.
//
//   std::shared_ptr<const MeshGeometry> mesh = mesh_of_image(patch, origin_mm, false);  // null: no square
//   if (mesh != nullptr) MeshProbe probe(mesh->mesh, *mesh->index, mesh->crossings, mesh->sides);
//
// Neighbours come from the raster and the tree is a fast one: as good as a mesh can be that is made again
// every 33 ms. Squares across a depth edge are left open, so no wall joins a thing to what is behind it.

struct DepthPatch;  // depth_rebuild.h

/// Steepest slope of a sheet against the image plane: that of a surface seen at 80 degrees. Cameras measure
/// little beyond it.
inline constexpr double kSteepest = 5.67;
/// Noise explains differences of two depths up to this many standard deviations of one: four of the
/// difference, whose own is the root of two as large.
inline constexpr double kExplainedSigmas = 5.66;

/// The patch's points and squares.
[[nodiscard]] RasterSheet sheet_of(const DepthPatch& patch);

/// The mesh and its tree; `normals`: with vertex normals for shading. Null without a square, or if the tree
/// cannot be built. One thread, beside the servo's.
[[nodiscard]] std::shared_ptr<const MeshGeometry> mesh_of_image(const DepthPatch& patch,
                                                                const Vec3& origin_mm, bool normals);

}  // namespace palpate::baselines
