// Pictures as PNG, to be put into a page or a file.
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

/// Rows from the top, three bytes a pixel: red, green, blue.
struct ColourImage {
  int width = 0, height = 0;
  std::vector<std::uint8_t> rgb;

  [[nodiscard]] const std::uint8_t* at(int x, int y) const noexcept {
    constexpr std::size_t kBytes = 3;
    return &rgb[kBytes * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                          static_cast<std::size_t>(x))];
  }
};

/// The bytes of a PNG file (ISO/IEC 15948), 8 bits grey; empty where the image is.
[[nodiscard]] std::string png_of(const GreyImage& image);
/// 8 bits a colour, packed quickly: a window writes one between two frames.
[[nodiscard]] std::string colour_png(const ColourImage& image);

/// RFC 4648, with padding.
[[nodiscard]] std::string base64(const std::string& bytes);

}  // namespace palpate::experiments
