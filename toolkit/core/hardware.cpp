#include "toolkit/core/hardware.h"

#include <cstdlib>
#include <string_view>

#if defined(__linux__)
#include <sys/mman.h>
#endif

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

void advise_large_pages(void* p, std::size_t bytes) noexcept {
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  // Fails without system support; pages then stay small.
  (void)::madvise(p, bytes, MADV_HUGEPAGE);
#else
  (void)p;
  (void)bytes;
#endif
}

}  // namespace palpate
