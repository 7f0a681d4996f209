// Machine and conditions of a measurement, for comparing runs.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

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

struct MeasurementConditions {
  std::string governor;        ///< of the processor clock; "not shown" in most virtual machines
  std::string huge_pages;      ///< "always", "madvise", "never", or "not shown"
  std::string processor_sets;  ///< relevant instruction sets of the processor
  std::string compiled_for;    ///< those compiled for
  std::string compiler_flags;
  std::vector<std::pair<std::string, std::string>> libraries;  ///< name and version
  double load_before = 0.0, load_after = 0.0;                  ///< runnable processes, one-minute mean
  /// Processor time that the host gave to others meanwhile.
  std::optional<double> steal_percent;
  std::uint64_t rounds = 0;  ///< requested
  double budget_s = 0.0;     ///< for one renderer's passes: a slow one gets fewer
  std::uint64_t order_seed = 0;
};

/// The machine's current conditions, without flags, libraries and requests. Unreadable values are "not shown"
/// or 0.
[[nodiscard]] MeasurementConditions current_conditions();

/// Time of all processors since boot, in ticks.
struct ProcessorTicks {
  std::uint64_t all = 0, stolen = 0;
};
[[nodiscard]] std::optional<ProcessorTicks> processor_ticks();
/// Percent of the ticks in between; nothing if unreadable or none passed.
[[nodiscard]] std::optional<double> stolen_percent(const std::optional<ProcessorTicks>& before,
                                                   const std::optional<ProcessorTicks>& after);
/// One-minute mean; 0 if unreadable.
[[nodiscard]] double load_now();

}  // namespace palpate::metrics
