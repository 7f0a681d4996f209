// Where Palpate keeps what it can make or fetch again.
#pragma once

#include <filesystem>

namespace palpate {

/// $XDG_CACHE_HOME/palpate, or ~/.cache/palpate, or empty where neither variable is set. Not made here.
[[nodiscard]] std::filesystem::path cache_folder();

}  // namespace palpate
