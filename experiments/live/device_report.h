// The facts of a device that its first user sends back: what it is, how its packets come, whether it homes,
// what it is calibrated with. Zero force all the while.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "device/interface/drivers.h"
#include "device/interface/force_governor.h"
#include "device/servo/loop_histogram.h"
#include "device/servo/scheduling.h"
#include "experiments/live/doctor.h"
#include "experiments/live/session_device.h"
#include "toolkit/metrics/result_json.h"

namespace palpate::experiments {

/// Goes up when a key changes its meaning or goes away.
inline constexpr const char* kDeviceReportSchema = "palpate-device-report/1";

struct ReportOptions {
  double seconds = 5.0;
  double rate_hz = 1000.0;
};

/// Durations counted by powers of two: bin k holds those below 2^k ns and not below 2^(k-1).
struct PowerBins {
  static constexpr std::size_t kBins = 41;  ///< up to 18 minutes
  std::array<std::uint64_t, kBins> counts{};
  void count(std::int64_t ns) noexcept;
};

/// What a loop that only looks has seen.
struct DeviceWatch {
  std::uint64_t frames = 0, fresh = 0, nothing_new = 0, garbled = 0, lost = 0;
  device::DurationHistogram exchange, lateness, interval, age;
  PowerBins interval_bins, age_bins;
  std::int64_t longest_gap_ns = 0;
  bool homed_at_start = false, homed_at_end = false;
  std::optional<double> homed_after_s;  ///< only where it was not at the start
  std::uint32_t buttons_seen = 0;
  Vec3 low_mm = Vec3::Zero(), high_mm = Vec3::Zero();
  Vec3 smallest_step_mm = Vec3::Zero();  ///< that is not 0, along each axis; 0: none was seen
  static constexpr std::size_t kMostPackets = 16;
  std::array<device::RawPacket, kMostPackets> packets{};  ///< the first that came
  std::size_t packets_held = 0;
};

/// Looks at an open device for a while, in the calling thread. `frame` commands zero force.
class DeviceLooker {
 public:
  DeviceLooker(device::Device& device, device::ForceGovernor& governor, const Clock& clock)
      : device_(device), governor_(governor), clock_(clock) {}
  /// One frame. No allocation.
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

/// Opens the device, looks, closes; the document as JSON. What a person has to do for homing is said on
/// standard error meanwhile. A device that does not open is a report too, with what was wrong. An Error where
/// the name or the options mean nothing.
struct ReportedDevice {
  std::string json;
  std::optional<Error> not_opened;
};
[[nodiscard]] Result<ReportedDevice> report_device(const DeviceArguments& device,
                                                   const device::Drivers& drivers,
                                                   const ReportOptions& options,
                                                   const metrics::DocumentHead& head);

}  // namespace palpate::experiments
