// Counts allocations of any kind (operator new, malloc, Eigen, libraries) by this thread or by all, while
// armed.
#pragma once

#include <cstdint>

namespace palpate::house {

/// Counts from construction; count() is the number of blocks since. One instance at a time.
class AllocationCount {
 public:
  enum class Threads { kAll, kThisOne };
  explicit AllocationCount(Threads threads = Threads::kAll) noexcept;
  ~AllocationCount();
  AllocationCount(const AllocationCount&) = delete;
  AllocationCount& operator=(const AllocationCount&) = delete;
  [[nodiscard]] std::uint64_t count() const noexcept;
};

}  // namespace palpate::house
