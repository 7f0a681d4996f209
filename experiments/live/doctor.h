// What a machine gives to a live session: limits, kernel, timer, CPUs, permissions; read, judged, each with
// its remedy. Reading and judging are apart, so that judgements are tested on machines that are not here.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "device/servo/loop_histogram.h"
#include "device/servo/scheduling.h"

namespace palpate::experiments {

/// A device on the USB that is known by its ids.
struct UsbDevice {
  std::string name;
  std::string vendor, product;  ///< four hexadecimal digits
  std::string node;             ///< under /dev: of the bus, a hidraw or a tty, as its driver needs it
  bool may_open = false;        ///< this user
  std::string rule;             ///< of udev, that lets users open it
};

struct SystemFacts {
  static constexpr std::uint64_t kUnlimited = ~std::uint64_t{0};

  device::SchedulingMode tried;  ///< what a thread obtained that asked for the watchdog's priority
  std::uint64_t rtprio_limit = 0;
  std::uint64_t memlock_limit_bytes = 0;           ///< kUnlimited: none
  std::vector<std::string> cpu_governors;          ///< without repetition; empty: the machine tells none
  bool has_latency_file = false;                   ///< /dev/cpu_dma_latency
  std::int64_t clock_resolution_ns = 0;            ///< of the monotonic clock
  std::string clock_source;                        ///< empty: not told
  device::DurationStatistics lateness;             ///< of a tenth of a second of sleeps at 1 kHz
  std::optional<std::int64_t> real_time_share_us;  ///< of a second, for real-time threads; -1: all
  double steal_percent = 0.0;                      ///< since the machine started
  bool virtual_machine = false;
  bool has_usb = false;
  std::vector<UsbDevice> usb;
};

/// Haptic devices that the system sees on USB, by their ids (device/drivers/known_usb.h). Opens none.
[[nodiscard]] std::vector<UsbDevice> connected_usb_devices();

/// Reads them, and tries: some 0.1 s. Changes nothing that lasts.
[[nodiscard]] SystemFacts read_system_facts();

enum class CheckVerdict : std::uint8_t {
  kFine,
  kWarning,  ///< a simulated session runs; a device would be felt to suffer
  kProblem,  ///< a simulated session does not run in time
};
/// "fine", "warning", "problem".
[[nodiscard]] const char* verdict_name(CheckVerdict verdict) noexcept;

struct Check {
  std::string about;
  CheckVerdict verdict = CheckVerdict::kFine;
  std::string found;
  std::vector<std::string> remedy;  ///< lines, to be done as they stand; empty where it is fine
};
[[nodiscard]] std::vector<Check> examine(const SystemFacts& facts);

}  // namespace palpate::experiments
