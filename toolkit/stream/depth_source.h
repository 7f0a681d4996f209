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

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

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

/// Opens a source. Images of a folder without a pose where others have one are left out and counted in
/// describe(). @error names the source, and what would be understood.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_depth_source(const std::string& source,
                                                                     const DepthSourceOptions& options = {});

// OpenNI2: the toolkit itself links no camera's library. The plug-in is C++ of the same build, for it hands
// out a DepthSource. It is loaded from beside the program, from the library folder, or where the loader
// looks.

/// "openni" is the first camera, "openni:N" the one of this number.
inline constexpr std::string_view kOpenNiName = "openni", kOpenNiPrefix = "openni:";
[[nodiscard]] inline bool is_openni_name(std::string_view name) noexcept {
  return name == kOpenNiName || name.starts_with(kOpenNiPrefix);
}

inline constexpr const char* kOpenNiModule = "palpate_openni.so";
inline constexpr const char* kOpenNiEntry = "palpate_depth_plugin_entry";

/// Returned by address by the plug-in's entry, which is extern "C": see load_plugin().
struct OpenNiPlugin {
  std::uint32_t abi = 0;   ///< kOpenNiAbi
  std::uint32_t size = 0;  ///< of this struct
  /// Opens the camera of "openni" or "openni:N". Null: the first `bytes` of `error` say why, ended by 0.
  /// Whoever calls it owns the source.
  DepthSource* (*open)(const char* name, char* error, std::size_t bytes) = nullptr;
};
/// A number that increases with DepthSource's functions, and the sizes of what crosses: a plug-in of another
/// build is refused where it would be read wrongly.
inline constexpr std::uint32_t kOpenNiAbi = (1U << 24) | (sizeof(DepthCamera) << 12) | sizeof(DepthFrame);

}  // namespace palpate::stream
