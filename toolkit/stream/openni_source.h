// Cameras of OpenNI2, through a plug-in: the toolkit itself links no camera's library. The plug-in is C++ of
// the same build, for it hands out a DepthSource.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include <palpate/depth_stream.h>
#include <palpate/result.h>

namespace palpate::stream {

/// "openni" is the first camera, "openni:N" the one of this number.
inline constexpr std::string_view kOpenNiName = "openni", kOpenNiPrefix = "openni:";
[[nodiscard]] inline bool is_openni_name(std::string_view name) noexcept {
  return name == kOpenNiName || name.starts_with(kOpenNiPrefix);
}

inline constexpr const char* kOpenNiModule = "palpate_openni.so";
inline constexpr const char* kOpenNiEntry = "palpate_depth_plugin_entry";

/// The struct whose address the plug-in's entry, extern "C", returns: see load_plugin().
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

/// Loads the plug-in from beside the program, from the library folder, or where the loader looks, and opens a
/// camera. It stays loaded until the program ends.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_openni(const std::string& name);

}  // namespace palpate::stream
