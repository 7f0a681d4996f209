// The machine a result was measured on.
#pragma once

#include <cstdint>
#include <string>

namespace palpate::metrics {

struct MachineInfo {
  std::string cpu;  ///< model name, or "unknown"
  int cores = 0;    ///< logical CPUs this process may use
  std::uint64_t memory_bytes = 0;
  std::string kernel;    ///< name, release and architecture
  std::string compiler;  ///< that built this library
};

/// Reads /proc and uname; missing values are "unknown" or 0.
[[nodiscard]] MachineInfo machine_info();

/// The current time, ISO 8601, UTC, to the second.
[[nodiscard]] std::string utc_now();

}  // namespace palpate::metrics
