// Checks a machine for live sessions: limits, kernel, timer, CPUs, permissions, each with a remedy. Reading
// and judging are separate, so tests can judge other machines' facts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/loop_histogram.h>
#include <palpate/device/scheduling.h>

namespace palpate::experiments {

/// A USB device known by its ids.
struct UsbDevice {
  std::string name;
  std::string vendor, product;  ///< four hexadecimal digits
  std::string node;             ///< under /dev: bus, hidraw or tty node that its driver needs
  bool may_open = false;        ///< for this user
  std::string rule;             ///< udev rule that lets users open it
};

struct SystemFacts {
  static constexpr std::uint64_t kUnlimited = ~std::uint64_t{0};

  device::SchedulingMode tried;  ///< what a thread got that asked for the watchdog's priority
  std::uint64_t rtprio_limit = 0;
  std::uint64_t memlock_limit_bytes = 0;           ///< kUnlimited: no limit
  std::vector<std::string> cpu_governors;          ///< without duplicates; empty: not reported
  bool has_latency_file = false;                   ///< /dev/cpu_dma_latency
  std::int64_t clock_resolution_ns = 0;            ///< of the monotonic clock
  std::string clock_source;                        ///< empty: not reported
  device::DurationStatistics lateness;             ///< of 1 kHz sleeps over 0.1 s
  std::optional<std::int64_t> real_time_share_us;  ///< microseconds per second for real-time threads; -1: all
  double steal_percent = 0.0;                      ///< since boot
  bool virtual_machine = false;
  bool has_usb = false;
  std::vector<UsbDevice> usb;
};

/// Haptic devices on USB, by their ids (device/drivers/all_drivers.h). Opens none.
[[nodiscard]] std::vector<UsbDevice> connected_usb_devices();

/// Reads and measures the facts; takes some 0.1 s. Changes nothing permanently.
[[nodiscard]] SystemFacts read_system_facts();

enum class CheckVerdict : std::uint8_t {
  kFine,
  kWarning,  ///< simulated sessions run; a real device suffers noticeably
  kProblem,  ///< simulated sessions miss their times
};
/// "fine", "warning", "problem".
[[nodiscard]] const char* verdict_name(CheckVerdict verdict) noexcept;

struct Check {
  std::string about;
  CheckVerdict verdict = CheckVerdict::kFine;
  std::string found;
  std::vector<std::string> remedy;  ///< lines to carry out literally; empty if fine
};
[[nodiscard]] std::vector<Check> examine(const SystemFacts& facts);

}  // namespace palpate::experiments
