#include "toolkit/core/simd.h"

#include <cstdlib>
#include <string_view>

namespace palpate {

bool has_avx2() noexcept {
#if defined(__x86_64__)
  static const bool kWide = [] {
    const char* const asked = std::getenv("PALPATE_LANES");
    if (asked != nullptr && std::string_view(asked) == "narrow") return false;
    return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("popcnt") != 0;
  }();
  return kWide;
#else
  return false;
#endif
}

}  // namespace palpate
