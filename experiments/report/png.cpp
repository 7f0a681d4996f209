#include "experiments/report/png.h"

#include <nettle/base64.h>
#include <png.h>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace palpate::experiments {
namespace {

std::string written(int width, int height, const std::vector<std::uint8_t>& pixels, unsigned format,
                    unsigned flags) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(std::max(width, 0));
  image.height = static_cast<png_uint_32>(std::max(height, 0));
  image.format = format;
  image.flags = flags;
  if (image.width == 0 || image.height == 0 || PNG_IMAGE_SIZE(image) > pixels.size()) return {};
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
  std::string bytes(size, '\0');
  const bool whole =
      png_image_write_to_memory(&image, bytes.data(), &size, 0, pixels.data(), 0, nullptr) != 0;
  png_image_free(&image);
  bytes.resize(whole ? size : 0);
  return bytes;
}

}  // namespace

std::string png_of(const GreyImage& image) {
  return written(image.width, image.height, image.pixels, PNG_FORMAT_GRAY, 0);
}

std::string colour_png(const ColourImage& image) {
  return written(image.width, image.height, image.rgb, PNG_FORMAT_RGB, PNG_IMAGE_FLAG_FAST);
}

std::string base64(const std::string& bytes) {
  std::string text(BASE64_ENCODE_RAW_LENGTH(bytes.size()), '\0');
  base64_encode_raw(text.data(), bytes.size(),
                    reinterpret_cast<const std::uint8_t*>(bytes.data()));  // NOLINT
  return text;
}

}  // namespace palpate::experiments
