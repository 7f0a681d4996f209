// Writing meshes and clouds. Every file is whole or absent (AtomicFile).
#pragma once

#include <string>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::io {

/// Binary little-endian PLY: double x y z in mm, faces of three int indices, and the comment "unit mm" that
/// read_model takes as the file's own statement.
Status write_mesh_ply(const std::string& path, const geometry::TriangleMesh& mesh);

/// Binary little-endian PLY: double x y z in mm, a float for each property of the cloud, the comment "unit
/// mm", and a raster whose rows run one way as obj_info num_cols and num_rows, all of which read_model takes
/// back.
Status write_cloud_ply(const std::string& path, const cloud::Cloud& cloud);

}  // namespace palpate::io
