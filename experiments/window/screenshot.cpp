#include "experiments/window/screenshot.h"

#include <epoxy/gl.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/core/atomic_file.h"

namespace palpate::experiments {

ColourImage read_window(int width_px, int height_px) {
  ColourImage image;
  if (width_px <= 0 || height_px <= 0) return image;
  image.width = width_px;
  image.height = height_px;
  const std::size_t row = 3 * static_cast<std::size_t>(width_px);
  std::vector<std::uint8_t> from_below(row * static_cast<std::size_t>(height_px));
  glBindFramebuffer(GL_READ_FRAMEBUFFER, 0);
  glReadBuffer(GL_BACK);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  glReadPixels(0, 0, width_px, height_px, GL_RGB, GL_UNSIGNED_BYTE, from_below.data());
  image.rgb.reserve(from_below.size());
  for (std::size_t y = static_cast<std::size_t>(height_px); y-- > 0;) {
    const auto begin = from_below.begin() + static_cast<std::ptrdiff_t>(y * row);
    image.rgb.insert(image.rgb.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  }
  return image;
}

Status write_png(const ColourImage& image, const std::string& path) {
  const std::string bytes = colour_png(image);
  if (bytes.empty()) return Error{"there is no picture to write", "open the window first", path, 0};
  return write_file(path, bytes);
}

}  // namespace palpate::experiments
