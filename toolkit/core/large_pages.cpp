#include "toolkit/core/large_pages.h"

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace palpate {

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
