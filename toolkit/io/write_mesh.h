// Writing meshes and clouds. Every file is whole or absent (AtomicFile).
#pragma once

#include <string>
#include <vector>

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

/// Text that read_model takes back: a comment, the names of the columns (x_mm, y_mm, z_mm, the properties'),
/// and a row for each point with the fewest digits that read back to the same bits; between commas or blanks.
Status write_cloud_text(const std::string& path, const cloud::Cloud& cloud, char separator);

/// Endings of write_cloud(), without the dot.
[[nodiscard]] const std::vector<std::string>& cloud_endings();
/// The format by the ending: PLY, or text; an Error names the endings.
Status write_cloud(const std::string& path, const cloud::Cloud& cloud);

/// Whether a file is one that the functions above wrote: it says so in its first lines.
[[nodiscard]] bool is_written_by_palpate(const std::string& path);

}  // namespace palpate::io
