// What parallel work runs on: for those who say under what conditions they measured.
#pragma once

#include <string>
#include <utility>

namespace palpate {

/// Its name and version, as it is loaded.
[[nodiscard]] std::pair<std::string, std::string> parallel_library();

}  // namespace palpate
