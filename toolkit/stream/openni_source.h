// Cameras of OpenNI2, through a plug-in: the toolkit itself links no camera's library. The plug-in is C++ of
// the same build, for it hands out a DepthSource.
#pragma once

#include <memory>
#include <string>

#include <palpate/depth_stream.h>
#include <palpate/result.h>

namespace palpate::stream {

inline constexpr const char* kOpenNiModule = "palpate_openni.so";
inline constexpr const char* kOpenNiEntry = "palpate_open_depth_source";

/// The plug-in's entry, extern "C": opens the camera of "openni" or "openni:N". Null: the first `size` bytes
/// of `error` say why, ended by 0. Whoever calls it owns the source.
using OpenNiEntry = DepthSource* (*)(const char* name, char* error, std::size_t size);

/// Loads the plug-in from beside the program, from the library folder, or where the loader looks, and opens a
/// camera. It stays loaded until the program ends.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_openni(const std::string& name);

}  // namespace palpate::stream
