// Large arrays whose elements are first written by the threads that make them.
#pragma once

#include <cstddef>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

#include "toolkit/core/large_pages.h"

namespace palpate {

/// Leaves the elements that resize(n) adds unset, so that whoever writes one first does so once, and the
/// system's work of giving a page falls to the thread that writes it. For types that may be copied as bytes;
/// what is read before it was written is anything.
template <class T, class Base>
struct UnsetAllocator : Base {
  template <class U>
  struct rebind {
    using other = UnsetAllocator<U, typename std::allocator_traits<Base>::template rebind_alloc<U>>;
  };
  UnsetAllocator() = default;
  template <class U, class OtherBase>
  explicit(false) UnsetAllocator(const UnsetAllocator<U, OtherBase>& other) noexcept : Base(other) {}

  template <class U>
  void construct(U*) noexcept {
    static_assert(std::is_trivially_copyable_v<U> && std::is_trivially_destructible_v<U>);
  }
  template <class U, class... Args>
  void construct(U* at, Args&&... args) {
    std::construct_at(at, std::forward<Args>(args)...);
  }
};

template <class T>
using UnsetVector = std::vector<T, UnsetAllocator<T, std::allocator<T>>>;
/// The same in large pages, see large_pages.h.
template <class T>
using LargeUnsetVector = std::vector<T, UnsetAllocator<T, LargePageAllocator<T>>>;

}  // namespace palpate
