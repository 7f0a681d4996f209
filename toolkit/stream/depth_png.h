// Depth images as PNG files of one 16-bit grey channel, as RGB-D recordings keep them. Hostile files are
// bounded before anything is taken for them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate::stream {

/// Longest side of an image: four times that of the largest depth cameras, and 128 MB as counts.
inline constexpr std::uint32_t kMaxImageSide = 8192;

/// Counts of a camera, row by row. Its vector keeps its memory from image to image.
struct DepthImage {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<std::uint16_t> counts;
};

/// Width and height that a file must have; 0: any up to kMaxImageSide.
struct ImageSize {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
};

/// Decodes a PNG file. Sizes are checked against `expected` and against what so many bytes can unpack to. An
/// Error names no file.
[[nodiscard]] Status read_depth_png(std::span<const std::byte> file, ImageSize expected, DepthImage& image);

}  // namespace palpate::stream
