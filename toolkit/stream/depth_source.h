// Opens what gives depth images, whatever it is: a folder of a recording, a camera, or a simulated one.
//
//   room/            images with poses in the layout of TUM RGB-D, Open3D or tsdf-fusion, or organised PCD
//   sim:wall         a stock scene under a simulated camera: sim:NAME[:option=value..]
//   openni[:N]       the N-th camera of OpenNI2, through its plug-in
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

}  // namespace palpate::stream
