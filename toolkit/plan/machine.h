// What this machine takes for a read that has to wait for memory: measured once, in less than a second, and
// kept in the cache folder under the processor's name and Palpate's version.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/core/progress.h"

namespace palpate::plan {

/// A read whose address the one before it brought, somewhere in so many bytes.
struct MachineRead {
  double bytes = 0.0;
  double ns = 0.0;
};

struct Machine {
  std::string cpu;
  std::vector<MachineRead> reads;  ///< bytes ascending
  bool from_cache = false;

  /// Between the measured sizes along the logarithm; beyond them as at the nearest.
  [[nodiscard]] double read_ns(double bytes) const noexcept;
};

/// From the cache, unless `anew`; else measured, and kept where a cache folder can be had. `version`: of the
/// program. A cached file that is not right is measured again. Times are the thread's own.
[[nodiscard]] Machine this_machine_measured(const std::string& version, bool anew, Progress* progress);

/// "Intel Xeon ..: a read of 16 kB 1.2 ns, of 1 MB 4 ns, of 64 MB 95 ns"
[[nodiscard]] std::string text(const Machine& machine);

}  // namespace palpate::plan
