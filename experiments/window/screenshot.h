// Pictures of the window as files.
#pragma once

#include <string>

#include "experiments/report/png.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

/// What is in the back buffer of the default framebuffer now. Needs a current OpenGL context.
[[nodiscard]] ColourImage read_window(int width_px, int height_px);
/// A PNG file, whole or not at all. An Error names it.
[[nodiscard]] Status write_png(const ColourImage& image, const std::string& path);

}  // namespace palpate::experiments
