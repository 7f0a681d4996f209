#include "toolkit/core/cache_folder.h"

#include <cstdlib>

namespace palpate {

std::filesystem::path cache_folder() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache != nullptr && *cache == '/')
    return std::filesystem::path(cache) / "palpate";
  if (const char* home = std::getenv("HOME"); home != nullptr && *home != '\0')
    return std::filesystem::path(home) / ".cache" / "palpate";
  return {};
}

}  // namespace palpate
