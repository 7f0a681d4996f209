// A 3Dconnexion device as a way to move the HIP without a force device: what it is pushed by is a speed,
// which is integrated here, in the servo's thread. It has no motors: renderers run, and the force that would
// be felt is shown and recorded, not felt.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "device/interface/device.h"
#include "device/interface/link.h"
#include "device/spacemouse/spacemouse_reports.h"
#include "toolkit/core/clock.h"

namespace palpate::device {

struct SpaceMouseOptions {
  double v_max_mm_per_s = 150.0;  ///< at full push
  double dead_zone = 0.05;        ///< of full push, in which nothing moves: 0 to below 1
  double curve = 1.7;             ///< exponent beyond it: 1 is straight, 1.5 to 2 is fine near rest
  double half_extent_mm = 100.0;  ///< the HIP stays in a cube about the middle
  double force_max_n = 3.3;       ///< up to which the force is shown: a small force device's
};

/// Each finite, and in its range.
[[nodiscard]] Status check_spacemouse(const SpaceMouseOptions& options);

/// Speed for one axis's value in counts, mm/s.
[[nodiscard]] double spacemouse_speed(double counts, const SpaceMouseOptions& options) noexcept;

/// Keeps a reference to the clock.
class SpaceMouseDevice final : public Device {
 public:
  SpaceMouseDevice(std::unique_ptr<Link> link, const Clock& clock, const SpaceMouseModel& model,
                   const SpaceMouseOptions& options = {});
  ~SpaceMouseDevice() override { close(); }

  [[nodiscard]] std::string name() const override { return "spacemouse"; }
  [[nodiscard]] Status open() override;
  void close() noexcept override;
  [[nodiscard]] DeviceLimits limits() const noexcept override;
  /// Always fresh while it is there: it is silent at rest, and the position is known all the same. Lost where
  /// it is silent for 100 ms while pushed: then it also stands still, until it is heard of again.
  [[nodiscard]] DeviceState read() noexcept override;
  /// Nothing to send to.
  void send(GovernedForce) noexcept override {}

  static constexpr int kMostPolls = 16;

 private:
  void take(const SpaceMouseReport& report, std::int64_t now_ns) noexcept;

  std::unique_ptr<Link> link_;
  const Clock& clock_;
  SpaceMouseModel model_;
  SpaceMouseOptions options_;
  DeviceState state_;
  Vec3 velocity_mm_s_ = Vec3::Zero();
  std::int64_t moved_ns_ = 0, heard_ns_ = 0;
  bool open_ = false, gone_ = false, silent_ = false;
  std::uint32_t malformed_in_a_row_ = 0;
};

}  // namespace palpate::device
