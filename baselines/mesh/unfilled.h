// Arrays whose elements are left unset when they are made: for what is filled at once, by several threads.
#pragma once

#include <memory>
#include <new>
#include <utility>
#include <vector>

#include "toolkit/core/large_pages.h"

namespace palpate::baselines {

/// LargePageAllocator that leaves elements unset where a vector would zero them. Zeroing would read and write
/// the whole array once more, on one thread, and that thread would be given all of its pages.
template <class T>
struct UnfilledAllocator : LargePageAllocator<T> {
  using value_type = T;
  UnfilledAllocator() = default;
  template <class U>
  explicit(false) UnfilledAllocator(const UnfilledAllocator<U>&) noexcept {}
  template <class U>
  void construct(U* place) noexcept {
    ::new (static_cast<void*>(place)) U;
  }
  template <class U, class... Values>
  void construct(U* place, Values&&... values) {
    ::new (static_cast<void*>(place)) U(std::forward<Values>(values)...);
  }
  template <class U>
  bool operator==(const UnfilledAllocator<U>&) const noexcept {
    return true;
  }
};

template <class T>
using UnfilledVector = std::vector<T, UnfilledAllocator<T>>;

}  // namespace palpate::baselines
