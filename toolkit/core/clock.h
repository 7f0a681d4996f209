// Wall-clock measurement for preparation phases and frames. Never decides anything.
#pragma once

#include <chrono>
#include <cstdint>

namespace palpate {

/// Nanoseconds on a monotonic clock with an arbitrary start.
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Measures from its construction.
class Stopwatch {
 public:
  [[nodiscard]] double ms() const noexcept { return static_cast<double>(monotonic_ns() - start_ns_) * 1e-6; }
  void restart() noexcept { start_ns_ = monotonic_ns(); }

 private:
  std::int64_t start_ns_ = monotonic_ns();
};

}  // namespace palpate
