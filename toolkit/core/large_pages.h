// Memory for large arrays that are read here and there: in large pages where the system has them.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace palpate {

/// Asks the system to back [p, p + bytes) with large pages. Only advice: nothing depends on the answer.
void advise_large_pages(void* p, std::size_t bytes) noexcept;

/// An allocator for arrays that a frame reads at scattered places. A page of 4 kB is one entry in the
/// processor's address cache, which holds some 1500 of them, 6 MB; a model of a million points has 48 MB.
/// Large arrays are therefore aligned to 2 MB and large pages asked for; small ones come from the heap, as
/// their elements are aligned.
template <class T>
struct LargePageAllocator {
  using value_type = T;
  static constexpr std::size_t kPage = std::size_t{2} << 20;
  /// Two pages: below, rounding up to whole pages would waste much.
  static constexpr std::size_t kFromBytes = 2 * kPage;

  LargePageAllocator() = default;
  template <class U>
  explicit(false) LargePageAllocator(const LargePageAllocator<U>&) noexcept {}

  [[nodiscard]] T* allocate(std::size_t n) {
    if (n > static_cast<std::size_t>(-1) / sizeof(T)) throw std::bad_array_new_length();
    const std::size_t bytes = n * sizeof(T);
    if (bytes < kFromBytes) return static_cast<T*>(::operator new (bytes, std::align_val_t{alignof(T)}));
    void* p = ::operator new (bytes, std::align_val_t{kPage});
    advise_large_pages(p, bytes);
    return static_cast<T*>(p);
  }
  void deallocate(T* p, std::size_t n) noexcept {
    if (n * sizeof(T) < kFromBytes)
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
using LargeVector = std::vector<T, LargePageAllocator<T>>;

}  // namespace palpate
