// Reports a device's facts for its first user: identity, packet timing, homing, calibration. Commands zero
// force throughout.
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
#include "experiments/live/doctor.h"
#include "experiments/live/session_device.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

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
