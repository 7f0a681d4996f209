// Counts what is allocated while armed, by any thread or this one alone, and by whatever means: operator new,
// malloc, Eigen, libraries.
#pragma once

#include <cstdint>

namespace palpate::house {

/// Starts counting at construction; count() is the number of blocks asked for since. One at a time.
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
