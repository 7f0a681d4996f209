// Allocators: large pages for scattered reads, uninitialised elements.
#pragma once

#include <cstddef>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>
#include <vector>

namespace palpate {

/// Advises the system to back [p, p + bytes) with large pages; nothing depends on it.
void advise_large_pages(void* p, std::size_t bytes) noexcept;
/// Gives whole pages of [p, p + bytes) back to the system, where it can: for what is done with of an array
/// that is still being read. Reading there gives any value afterwards.
void discard_pages(void* p, std::size_t bytes) noexcept;
/// Gives what is freed, but held by the allocator, back to the system where it can: threads free many vectors
/// that are too small to go back by themselves. Some milliseconds.
void return_freed_memory() noexcept;

/// An allocator for arrays that frames read at scattered places. The address cache holds some 1500 pages of 4
/// kB (6 MB), and a model of a million points has 48 MB. Large arrays are aligned to 2 MB with large pages
/// requested; small ones come from the heap, aligned for their elements.
template <class T>
struct LargePageAllocator {
  using value_type = T;
  static constexpr std::size_t kPage = std::size_t{2} << 20;
  /// Two pages; for less, rounding up to whole pages would waste much.
  static constexpr std::size_t kMinLargeBytes = 2 * kPage;

  LargePageAllocator() = default;
  template <class U>
  explicit(false) LargePageAllocator(const LargePageAllocator<U>&) noexcept {}

  [[nodiscard]] T* allocate(std::size_t n) {
    if (n > static_cast<std::size_t>(-1) / sizeof(T)) throw std::bad_array_new_length();
    const std::size_t bytes = n * sizeof(T);
    if (bytes < kMinLargeBytes) return static_cast<T*>(::operator new (bytes, std::align_val_t{alignof(T)}));
    void* p = ::operator new (bytes, std::align_val_t{kPage});
    advise_large_pages(p, bytes);
    return static_cast<T*>(p);
  }
  void deallocate(T* p, std::size_t n) noexcept {
    if (n * sizeof(T) < kMinLargeBytes)
      ::operator delete (p, std::align_val_t{alignof(T)});
    else
      ::operator delete (p, std::align_val_t{kPage});
  }
  template <class U>
  bool operator==(const LargePageAllocator<U>&) const noexcept {
    return true;
  }
};

template <class T>
using LargePageVector = std::vector<T, LargePageAllocator<T>>;

/// Leaves elements added by resize(n) uninitialised, so each is written once, and the page fault falls to the
/// writing thread. Reading before writing gives any value.
template <class T, class Base>
struct UninitializedAllocator : Base {
  template <class U>
  struct rebind {
    using other = UninitializedAllocator<U, typename std::allocator_traits<Base>::template rebind_alloc<U>>;
  };
  UninitializedAllocator() = default;
  template <class U, class OtherBase>
  explicit(false) UninitializedAllocator(const UninitializedAllocator<U, OtherBase>& other) noexcept
      : Base(other) {}

  template <class U>
  void construct(U* at) noexcept {
    static_assert(std::is_trivially_destructible_v<U>);
    if constexpr (!std::is_trivially_copyable_v<U>)
      ::new (static_cast<void*>(at)) U;  // Eigen's vectors leave themselves unset
  }
  template <class U, class... Args>
  void construct(U* at, Args&&... args) {
    std::construct_at(at, std::forward<Args>(args)...);
  }
};

template <class T>
using UninitializedVector = std::vector<T, UninitializedAllocator<T, std::allocator<T>>>;
/// The same in large pages, see LargePageAllocator.
template <class T>
using LargePageUninitializedVector = std::vector<T, UninitializedAllocator<T, LargePageAllocator<T>>>;

/// Frees what a vector holds: `v = {}` would keep its memory.
template <class Vector>
void release_memory(Vector& v) noexcept {
  Vector().swap(v);
}

}  // namespace palpate
