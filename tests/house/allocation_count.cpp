#include "tests/house/allocation_count.h"

#include <atomic>
#include <cerrno>
#include <cstddef>

// Sanitizers replace malloc and offer a hook. Otherwise this wraps glibc's functions: a definition in the
// program precedes the library's for every caller, shared libraries included.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define PALPATE_SANITIZER_HOOKS 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define PALPATE_SANITIZER_HOOKS 1
#endif
#endif

namespace {
std::atomic<bool> armed{false};
std::atomic<bool> one_thread{false};
std::atomic<std::uint64_t> counted{0};
thread_local bool this_thread = false;  // this thread counts

void note() noexcept {
  if (!armed.load(std::memory_order_relaxed)) return;
  if (one_thread.load(std::memory_order_relaxed) && !this_thread) return;
  counted.fetch_add(1, std::memory_order_relaxed);
}
}  // namespace

#ifdef PALPATE_SANITIZER_HOOKS
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void*, std::size_t),
                                                         void (*on_free)(const volatile void*));
namespace {
void on_malloc(const volatile void*, std::size_t) {
  note();
}
void on_free(const volatile void*) {}
[[maybe_unused]] const int installed = __sanitizer_install_malloc_and_free_hooks(on_malloc, on_free);
}  // namespace
#else
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* block, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

void* malloc(std::size_t size) {
  note();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note();
  return __libc_calloc(count, size);
}
void* realloc(void* block, std::size_t size) {
  note();
  return __libc_realloc(block, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** block, std::size_t alignment, std::size_t size) {
  note();
  *block = __libc_memalign(alignment, size);
  return *block == nullptr ? ENOMEM : 0;
}
}
#endif

namespace palpate::house {

AllocationCount::AllocationCount(Threads threads) noexcept {
  counted = 0;
  this_thread = true;
  one_thread = threads == Threads::kThisOne;
  armed = true;
}
AllocationCount::~AllocationCount() {
  armed = false;
  this_thread = false;
}
std::uint64_t AllocationCount::count() const noexcept {
  return counted;
}

}  // namespace palpate::house
