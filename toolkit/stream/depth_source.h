// Opens sources of depth images: folders, cameras, simulated cameras.
//
//   room/            images of a recording with poses, one file a frame, or organised PCD
//   sim:wall         a stock scene under a simulated camera: sim:NAME[:option=value..]
//   openni[:N]       the N-th camera of OpenNI2, through its plug-in
//
// Layouts of folders:
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
#include <optional>
#include <string>

#include <palpate/depth_stream.h>
#include <palpate/read_model.h>
#include <palpate/result.h>

namespace palpate::stream {

struct DepthSourceOptions {
  double unit_mm_per_count = 0.0;        ///< of 16-bit images; 0: the layout's own
  double rate_hz = 0.0;                  ///< of recordings; 0: their own time stamps, or 30
  std::optional<DepthCamera> camera{};   ///< replaces the folder's intrinsics
  const io::Readers* readers = nullptr;  ///< what reads PCD files, kept by the source; null: none are read
};

/// @error names the source, and what would be understood.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_depth_source(const std::string& source,
                                                                     const DepthSourceOptions& options = {});

/// Finds the layout, reads texts and the first image. Images without a pose where others have one are left
/// out and counted in describe().
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::string& folder,
                                                                     const DepthSourceOptions& options);

}  // namespace palpate::stream
