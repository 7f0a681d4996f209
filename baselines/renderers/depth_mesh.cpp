#include "baselines/renderers/mesh_body.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "baselines/renderers/depth_rebuild.h"

namespace palpate::baselines {

RasterSheet sheet_of(const DepthPatch& patch) {
  const render::PixelWindow& window = patch.window;
  const stream::DepthCamera& camera = patch.rays.camera();
  const auto columns = static_cast<std::size_t>(window.columns());
  const auto rows = static_cast<std::size_t>(window.rows());
  RasterSheet sheet;
  sheet.columns = columns;
  sheet.at_mm.resize(columns * rows);
  sheet.measured.assign(columns * rows, 0);
  sheet.square.assign(columns * rows, 0);
  std::vector<double> depth(columns * rows);
  std::size_t i = 0;
  for (int row = window.first_row; row < window.last_row; ++row)
    for (int column = window.first_column; column < window.last_column; ++column, ++i) {
      const std::size_t pixel = patch.rays.index(column, row);
      depth[i] = patch.depth_mm(pixel);
      if (!(depth[i] > 0.0)) continue;
      sheet.measured[i] = 1;
      sheet.at_mm[i] = patch.at(pixel, depth[i]);
    }
  // On one sheet: both measured, with depths as near as slope and noise explain.
  const auto joined = [&](std::size_t a, std::size_t b, double focal_px) {
    const double nearer = std::min(depth[a], depth[b]);
    return nearer > 0.0 && std::abs(depth[a] - depth[b]) <=
                               kSteepest * nearer / focal_px + kExplainedSigmas * camera.noise_at_mm(nearer);
  };
  for (std::size_t row = 0; row + 1 < rows; ++row)
    for (std::size_t column = 0; column + 1 < columns; ++column) {
      const std::size_t a = row * columns + column, b = a + 1, d = a + columns, e = d + 1;
      sheet.square[a] = joined(a, b, camera.fx_px) && joined(d, e, camera.fx_px) &&
                                joined(a, d, camera.fy_px) && joined(b, e, camera.fy_px)
                            ? 1
                            : 0;
    }
  return sheet;
}

std::shared_ptr<const MeshGeometry> mesh_of_image(const DepthPatch& patch, const Vec3& origin_mm,
                                                  bool normals) {
  auto made = std::make_shared<MeshGeometry>();
  made->mesh = SurfaceMesh::of_raster(sheet_of(patch), origin_mm);
  if (made->mesh.facets().empty()) return nullptr;
  made->sides = PieceOrientation::open_sheet();
  if (normals) made->vertex_normals = interpolation_normals(made->mesh);
  Result<SegmentIndex> index = SegmentIndex::build(made->mesh, 1, TreeQuality::kFast);
  if (!index.ok()) return nullptr;
  made->index = std::make_unique<SegmentIndex>(std::move(index).value());
  return made;
}

}  // namespace palpate::baselines
