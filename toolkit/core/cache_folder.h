// The folder for data that can be made or fetched again.
#pragma once

#include <filesystem>

namespace palpate {

/// $XDG_CACHE_HOME/palpate, or ~/.cache/palpate; empty if neither variable is set. Does not create it.
[[nodiscard]] std::filesystem::path cache_folder();

}  // namespace palpate
