// A whole device over a link: the example of docs/tutorials/your-device.md, and what fault injection runs
// through.
#pragma once

#include <atomic>
#include <cstdint>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/link.h>
#include "device/simulated/packets.h"

namespace palpate::device {

/// Numbers of a maker's data sheet.
struct PacketDeviceOptions {
  double mm_per_count = 0.01;
  double n_per_count = 0.001;
  DeviceLimits limits{
      3.3, {Vec3::Constant(-100.0), Vec3::Constant(100.0)}, 0.01, 1000.0, 1.0, 0.01, WorkspaceShape::kBox};
};

/// Keeps references to link and clock.
class PacketDevice final : public Device {
 public:
  PacketDevice(Link& link, const Clock& clock, const PacketDeviceOptions& options = {});
  ~PacketDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "sim:packets"; }
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override { return options_.limits; }
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce force) noexcept override;
  bool cut_force() noexcept override;

  /// The command that lets the motors go: for a guard process, which has no device.
  [[nodiscard]] static PacketBytes zero_command() noexcept;

 private:
  void take(const Packet& packet) noexcept;

  Link& link_;
  const Clock& clock_;
  PacketDeviceOptions options_;
  PacketBytes zero_;
  PacketReader reader_;
  DeviceState state_;
  bool open_ = false, has_packet_ = false;
  std::uint16_t received_ = 0, sent_ = 0;
};

}  // namespace palpate::device
