// Grey pictures as PNG, to be put into a page.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace palpate::experiments {

/// Rows from the top, a byte a pixel: 0 black, 255 white.
struct GreyImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;
};

/// The bytes of a PNG file (ISO/IEC 15948), 8 bits grey; empty where the image is.
[[nodiscard]] std::string png_of(const GreyImage& image);

/// RFC 4648, with padding.
[[nodiscard]] std::string base64(const std::string& bytes);

}  // namespace palpate::experiments
