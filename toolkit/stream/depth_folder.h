// Recordings as folders of files, one a frame, read one after another as they are asked for.
//
//   TUM RGB-D     depth.txt with times and files, groundtruth.txt; 5000 counts a metre
//   tsdf-fusion   frame-NNNNNN.depth.png and .pose.txt; 1000 counts a metre
//   Open3D        depth/*.png or *.png, trajectory.log; 1000 counts a metre
//   PCD           organised *.pcd, in the order of their names; the camera follows from the points
//
// Intrinsics stand in camera-intrinsics.txt, camera_intrinsic.json, camera.json or intrinsic.json; without,
// they are those of the first Kinect, scaled to the image. Without poses the camera stands still.
#pragma once

#include <memory>
#include <string>

#include <palpate/depth_stream.h>
#include <palpate/result.h>
#include "toolkit/stream/depth_source.h"

namespace palpate::stream {

/// Finds the layout, reads texts and the first image. Images without a pose where others have one are left
/// out and counted in describe().
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::string& folder,
                                                                     const DepthSourceOptions& options);

}  // namespace palpate::stream
