// Writes meshes and clouds. Every file is complete or absent (AtomicFile).
//
// First:
//   if (auto wrote = palpate::io::write_cloud("felt.ply", cloud); !wrote) return failed(wrote.error());
#pragma once

#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/result.h>

namespace palpate::io {

/// Writes binary little-endian PLY: double x y z in mm, faces of three int indices, and the comment "unit
/// mm", which read_model takes as the unit.
Status write_mesh_ply(const std::string& path, const geometry::TriangleMesh& mesh);

/// Writes binary little-endian PLY: double x y z in mm, a float per property, the comment "unit mm", and a
/// raster whose rows run one way as obj_info num_cols and num_rows. read_model reads all of it.
Status write_cloud_ply(const std::string& path, const cloud::Cloud& cloud);

/// Writes text that read_model reads: a comment, the column names (x_mm, y_mm, z_mm, properties), and a row
/// per point, separated by commas or blanks, with the fewest digits that read back to the same bits.
Status write_cloud_text(const std::string& path, const cloud::Cloud& cloud, char separator);

/// Extensions of write_cloud(), without the dot.
[[nodiscard]] const std::vector<std::string>& cloud_extensions();
/// Chooses PLY or text by the extension; the Error for others lists the extensions.
Status write_cloud(const std::string& path, const cloud::Cloud& cloud);

/// True if the first lines say that the functions above wrote the file.
[[nodiscard]] bool is_written_by_palpate(const std::string& path);

}  // namespace palpate::io
