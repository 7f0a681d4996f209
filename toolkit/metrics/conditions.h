// Under what conditions times were measured: what a reader must know before believing them, and what differs
// where two runs do not agree.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace palpate::metrics {

struct Conditions {
  std::string governor;        ///< of the processor's clock; "not shown" in most virtual machines
  std::string huge_pages;      ///< "always", "madvise", "never", or "not shown"
  std::string processor_sets;  ///< instruction sets that the processor has, of those that matter here
  std::string compiled_for;    ///< those that the program was compiled for
  std::string compiler_flags;
  std::vector<std::pair<std::string, std::string>> libraries;  ///< name and version
  double load_before = 0.0, load_after = 0.0;  ///< processes that wanted to run, mean of a minute
  /// Of the processors' time meanwhile, what the host gave to others.
  std::optional<double> steal_percent;
  std::uint64_t rounds = 0;  ///< that were asked for
  double budget_s = 0.0;     ///< of one renderer's passes: a slow one gets fewer
  std::uint64_t order_seed = 0;
};

/// The machine's part of it, now: all but flags, libraries and what is asked for. Whatever cannot be read is
/// "not shown" or 0.
[[nodiscard]] Conditions conditions_now();

/// Time of all processors since the machine started, in its own ticks.
struct ProcessorTicks {
  std::uint64_t all = 0, stolen = 0;
};
[[nodiscard]] std::optional<ProcessorTicks> processor_ticks();
/// Percent of the ticks in between; nothing where they cannot be read or none went by.
[[nodiscard]] std::optional<double> stolen_percent(const std::optional<ProcessorTicks>& before,
                                                   const std::optional<ProcessorTicks>& after);
/// Mean of a minute; 0 where it cannot be read.
[[nodiscard]] double load_now();

}  // namespace palpate::metrics
