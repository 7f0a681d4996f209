#include "experiments/report/png.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace palpate::experiments {
namespace {

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (const int shift : {24, 16, 8, 0})
    bytes += static_cast<char>(static_cast<unsigned char>(value >> shift));
  return bytes;
}

const Bytef* data_of(const std::string& bytes) {
  return reinterpret_cast<const Bytef*>(bytes.data());  // NOLINT: bytes are bytes
}

std::string chunk(const std::string& kind, const std::string& data) {
  const std::string both = kind + data;
  const auto sum = static_cast<std::uint32_t>(::crc32(0, data_of(both), static_cast<uInt>(both.size())));
  return big_endian(static_cast<std::uint32_t>(data.size())) + both + big_endian(sum);
}

/// A picture of `bytes` a pixel, each of its own filter row.
struct Rows {
  int width, height;
  std::size_t bytes;
  char colour_type;  // of the header
  int level;         // of zlib
};

std::string packed_png(const Rows& image, const std::vector<std::uint8_t>& pixels) {
  if (image.width <= 0 || image.height <= 0) return {};
  const std::size_t row_bytes = image.bytes * static_cast<std::size_t>(image.width);
  std::string rows;
  for (std::size_t at = 0; at + row_bytes <= pixels.size(); at += row_bytes) {
    rows += '\1';  // the filter Sub: each byte less that of the pixel before it
    for (std::size_t i = 0; i < row_bytes; ++i) {
      const std::uint8_t before = i < image.bytes ? std::uint8_t{0} : pixels[at + i - image.bytes];
      rows += static_cast<char>(static_cast<std::uint8_t>(pixels[at + i] - before));
    }
  }
  uLongf size = ::compressBound(static_cast<uLong>(rows.size()));
  std::string packed(size, '\0');
  if (::compress2(reinterpret_cast<Bytef*>(packed.data()), &size, data_of(rows),  // NOLINT: bytes are bytes
                  static_cast<uLong>(rows.size()), image.level) != Z_OK)
    return {};
  packed.resize(size);
  // Depth 8, the colour type, deflate, adaptive filters, not interlaced.
  const std::string header = big_endian(static_cast<std::uint32_t>(image.width)) +
                             big_endian(static_cast<std::uint32_t>(image.height)) +
                             std::string({8, image.colour_type, 0, 0, 0});
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + chunk("IDAT", packed) + chunk("IEND", {});
}

}  // namespace

std::string png_of(const GreyImage& image) {
  constexpr char kGrey = 0;
  return packed_png({image.width, image.height, 1, kGrey, Z_BEST_COMPRESSION}, image.pixels);
}

std::string colour_png(const ColourImage& image) {
  constexpr char kColours = 2;
  return packed_png({image.width, image.height, 3, kColours, Z_BEST_SPEED}, image.rgb);
}

std::string base64(const std::string& bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  constexpr std::size_t kGroup = 3;
  constexpr unsigned kSix = 0x3Fu;
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += kGroup) {
    std::uint32_t group = 0;
    const std::size_t have = std::min(kGroup, bytes.size() - i);
    for (std::size_t k = 0; k < kGroup; ++k)
      group = group << 8u | (k < have ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    const std::array<char, 4> four = {kDigits[group >> 18u & kSix], kDigits[group >> 12u & kSix],
                                      have > 1 ? kDigits[group >> 6u & kSix] : '=',
                                      have > 2 ? kDigits[group & kSix] : '='};
    text.append(four.data(), four.size());
  }
  return text;
}

}  // namespace palpate::experiments
