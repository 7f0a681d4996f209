// Saves pictures of the window as files.
#pragma once

#include <string>

#include <palpate/result.h>
#include "experiments/report/png.h"

namespace palpate::experiments {

/// Reads the default framebuffer's back buffer. Needs a current OpenGL context.
[[nodiscard]] ColourImage read_window(int width_px, int height_px);
/// Writes a complete PNG file or none. An Error names it.
[[nodiscard]] Status write_png(const ColourImage& image, const std::string& path);

}  // namespace palpate::experiments
