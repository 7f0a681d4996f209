// Folders of depth images as recordings have them, and small images with a known truth.
#pragma once

#include <fmt/format.h>
#include <png.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "toolkit/stream/depth_codec.h"

namespace palpate::test {

inline void write_text(const std::string& file, const std::string& text) {
  std::filesystem::create_directories(std::filesystem::path(file).parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

/// A PNG file in memory; `format` PNG_FORMAT_LINEAR_Y: 16-bit grey.
inline std::string png_of(const void* pixels, std::uint32_t width, std::uint32_t height,
                          std::uint32_t format = PNG_FORMAT_LINEAR_Y) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = width;
  png.height = height;
  png.format = format;
  png_alloc_size_t bytes = 0;
  if (png_image_write_to_memory(&png, nullptr, &bytes, 0, pixels, 0, nullptr) == 0)
    throw std::runtime_error(png.message);
  std::string file(bytes, '\0');
  if (png_image_write_to_memory(&png, file.data(), &bytes, 0, pixels, 0, nullptr) == 0)
    throw std::runtime_error(png.message);
  file.resize(bytes);
  return file;
}

inline stream::DepthImage image_of(std::uint32_t width, std::uint32_t height,
                                   const std::function<std::uint16_t(std::uint32_t, std::uint32_t)>& count) {
  stream::DepthImage image{width, height, {}};
  for (std::uint32_t v = 0; v < height; ++v)
    for (std::uint32_t u = 0; u < width; ++u) image.counts.push_back(count(u, v));
  return image;
}

inline std::string png_of(const stream::DepthImage& image) {
  return png_of(image.counts.data(), image.width, image.height);
}

/// Every pixel other, with holes.
inline stream::DepthImage ramp(std::uint32_t width, std::uint32_t height, std::uint16_t first = 1000) {
  return image_of(width, height, [=](std::uint32_t u, std::uint32_t v) {
    return static_cast<std::uint16_t>((u + v) % 7 == 0 ? 0 : first + u + 3 * v);
  });
}

inline std::span<const std::byte> bytes_of(const std::string& text) {
  return std::as_bytes(std::span(text));
}

/// A 4 x 4 matrix of a pose that is moved only, as the files print it.
inline std::string pose_text(double x_m, double y_m, double z_m) {
  return fmt::format("1 0 0 {}\n0 1 0 {}\n0 0 1 {}\n0 0 0 1\n", x_m, y_m, z_m);
}

}  // namespace palpate::test
