// Organised PCD files as depth images: the camera that a cloud's rows and columns imply, and its depths.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::stream {

/// Points of one image in the camera's frame, row by row; not finite where nothing was seen.
struct OrganisedPoints {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<Vec3> points_mm;
};

/// Reads a PCD file by the reader of `readers`; null: an Error. The Error names the file.
[[nodiscard]] Result<OrganisedPoints> read_organised_pcd(const std::string& file, const io::Readers* readers);

/// Focal lengths and centre by least squares over x/z and y/z of all points. An Error where the points do not
/// lie on the rays of one pinhole.
[[nodiscard]] Result<DepthCamera> camera_of(const OrganisedPoints& points);

/// Each point's z; an Error where the size is not the camera's.
[[nodiscard]] Status depths_of(const OrganisedPoints& points, const DepthCamera& camera,
                               std::vector<float>& depth_mm);

}  // namespace palpate::stream
