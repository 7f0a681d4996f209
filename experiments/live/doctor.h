// Checks a machine for live sessions: limits, kernel, timer, CPUs, permissions, each with a remedy. Reading
// and judging are separate, so tests can judge other machines' facts.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/drivers.h>
#include <palpate/device/force_governor.h>
#include <palpate/device/loop_histogram.h>
#include <palpate/device/scheduling.h>
#include "experiments/live/session_device.h"
#include "toolkit/metrics/result_json.h"

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

// Reports a device's facts for its first user: identity, packet timing, homing, calibration. Commands zero
// force throughout.

/// Increases when a key is redefined or removed.
inline constexpr const char* kDeviceReportSchema = "palpate-device-report/1";

struct ReportOptions {
  double seconds = 5.0;
  double rate_hz = 1000.0;
};

/// Histogram of durations by powers of two: bin k counts [2^(k-1), 2^k) ns.
struct PowerBins {
  static constexpr std::size_t kBins = 41;  ///< up to 18 minutes
  std::array<std::uint64_t, kBins> counts{};
  void count(std::int64_t ns) noexcept;
};

/// Measurements of a zero-force loop.
struct DeviceWatch {
  std::uint64_t frames = 0, fresh = 0, nothing_new = 0, garbled = 0, lost = 0;
  device::DurationHistogram exchange, lateness, interval, age;
  PowerBins interval_bins, age_bins;
  std::int64_t longest_gap_ns = 0;
  bool homed_at_start = false, homed_at_end = false;
  std::optional<double> homed_after_s;  ///< empty if it was homed at the start
  std::uint32_t buttons_seen = 0;
  Vec3 low_mm = Vec3::Zero(), high_mm = Vec3::Zero();
  Vec3 smallest_step_mm = Vec3::Zero();  ///< smallest nonzero step per axis; 0: none seen
  static constexpr std::size_t kMostPackets = 16;
  std::array<device::RawPacket, kMostPackets> packets{};  ///< the first packets received
  std::size_t packets_held = 0;
};

/// Observes an open device in the calling thread. `frame` commands zero force.
class DeviceObserver {
 public:
  DeviceObserver(device::Device& device, device::ForceGovernor& governor, const Clock& clock)
      : device_(device), governor_(governor), clock_(clock) {}
  /// Runs one frame. Does not allocate.
  void frame(std::int64_t due_ns) noexcept;
  [[nodiscard]] const DeviceWatch& watch() const noexcept { return watch_; }

 private:
  void took(const device::DeviceState& state, std::int64_t now_ns) noexcept;

  device::Device& device_;
  device::ForceGovernor& governor_;
  const Clock& clock_;
  DeviceWatch watch_;
  std::int64_t first_ns_ = 0, fresh_ns_ = 0;
  Vec3 before_mm_ = Vec3::Zero();
};

/// Opens the device, observes and closes it; returns the document as JSON. Homing instructions go to standard
/// error. A device that does not open still gives a report with the cause. Error: invalid name or options.
struct ReportedDevice {
  std::string json;
  std::optional<Error> not_opened;
};
[[nodiscard]] Result<ReportedDevice> report_device(const DeviceArguments& device,
                                                   const device::Drivers& drivers,
                                                   const ReportOptions& options,
                                                   const metrics::DocumentHead& head);

}  // namespace palpate::experiments
