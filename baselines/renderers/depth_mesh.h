// A triangle mesh of a depth image: two facets for each square of four measured pixels on one sheet, with
// what a mesh renderer's frames read.
//
//   std::shared_ptr<const MeshGeometry> mesh = mesh_of_image(patch, origin_mm, false);  // null: no square
//   if (mesh != nullptr) MeshProbe probe(mesh->mesh, *mesh->index, mesh->crossings, mesh->sides);
//
// Neighbours come from the raster and the tree is a fast one: as good as a mesh can be that is made again
// every 33 ms. Squares across a depth edge are left open, so no wall joins a thing to what is behind it.
#pragma once

#include <memory>

#include <palpate/vec.h>
#include "baselines/mesh/surface_mesh.h"
#include "baselines/renderers/depth_rebuild.h"
#include "baselines/renderers/mesh_body.h"

namespace palpate::baselines {

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
