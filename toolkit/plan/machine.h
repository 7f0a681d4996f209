// The machine's memory latency: measured once, in less than a second, and cached by processor name and
// Palpate version.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <palpate/progress.h>

namespace palpate::plan {

/// A dependent read somewhere in this many bytes.
struct ReadLatency {
  double bytes = 0.0;
  double ns = 0.0;
};

struct Machine {
  std::string cpu;
  std::vector<ReadLatency> reads;  ///< bytes ascending
  bool from_cache = false;

  /// Interpolated along the logarithm; constant beyond the measured sizes.
  [[nodiscard]] double read_ns(double bytes) const noexcept;
};

/// From the cache unless `anew`; else measured and cached if possible. `version`: of the program. Invalid
/// cache files are replaced. Thread time.
[[nodiscard]] Machine measure_machine(const std::string& version, bool anew, Progress* progress);

/// "Intel Xeon ..: a read of 16 kB 1.2 ns, of 1 MB 4 ns, of 64 MB 95 ns"
[[nodiscard]] std::string text(const Machine& machine);

}  // namespace palpate::plan
