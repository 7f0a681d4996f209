#include "toolkit/core/hardware.h"

#if defined(__linux__)
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>
#endif

#include <cstdint>
#include <cstdlib>
#include <string_view>

#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include <palpate/clock.h>
#include "toolkit/core/simd.h"

namespace palpate {

PageFaults thread_page_faults() noexcept {
#if defined(__linux__)
  rusage usage{};
  if (::getrusage(RUSAGE_THREAD, &usage) == 0)
    return {static_cast<std::uint64_t>(usage.ru_minflt), static_cast<std::uint64_t>(usage.ru_majflt)};
#endif
  return {};
}

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

void discard_pages(void* p, std::size_t bytes) noexcept {
#if defined(__linux__)
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  const std::size_t before = (page - reinterpret_cast<std::uintptr_t>(p) % page) % page;
  if (before < bytes)
    (void)::madvise(static_cast<char*>(p) + before, (bytes - before) / page * page, MADV_DONTNEED);
#else
  (void)p;
  (void)bytes;
#endif
}

void return_freed_memory() noexcept {
#if defined(__GLIBC__)
  (void)::malloc_trim(0);
#endif
}

}  // namespace palpate
