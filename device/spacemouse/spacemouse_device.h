// A 3Dconnexion device that moves the HIP without force feedback: its push is a speed, integrated in the
// servo's thread. Forces are shown and recorded, not felt.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include <palpate/clock.h>
#include <palpate/device/device.h>
#include <palpate/device/drivers.h>
#include <palpate/device/link.h>

namespace palpate::device {

// Reports and models of 3Dconnexion devices. Source: spacenavd and the makers' ids (facts).
//
//   number 1     X, Y, Z, int16 little-endian (7 bytes), newer ones with Rx, Ry, Rz after them (13)
//   number 2     Rx, Ry, Rz (7)
//   number 3     buttons, a bit each, up to 6 bytes
//   number 0x17  battery

struct SpaceMouseModel {
  std::uint16_t vendor, product;
  const char* name;
  bool axes_as_is;  ///< otherwise axes become (x, -z, -y)
};
/// All supported models; excludes keyboards and CadMouse, which share the maker's id.
[[nodiscard]] std::span<const SpaceMouseModel> spacemouse_models() noexcept;
/// nullptr: not supported.
[[nodiscard]] const SpaceMouseModel* spacemouse_model(std::uint16_t vendor, std::uint16_t product) noexcept;

// Multi-axis controller of the generic desktop page; distinguishes it from keyboards of the same id.
inline constexpr std::uint16_t kSpaceMousePage = 0x01, kSpaceMouseUsage = 0x08;

struct SpaceMouseReport {
  enum class Kind : std::uint8_t { kAxes, kTurns, kButtons, kOther };
  Kind kind = Kind::kOther;
  std::array<std::int16_t, 3> axes{}, turns{};
  bool has_turns = false;
  std::uint32_t buttons = 0;
};
/// Nothing if the length does not fit the number. Unknown numbers give kOther.
[[nodiscard]] std::optional<SpaceMouseReport> decoded_spacemouse(
    std::span<const std::uint8_t> bytes) noexcept;

struct SpaceMouseOptions {
  double v_max_mm_per_s = 150.0;  ///< at full push
  double dead_zone = 0.05;        ///< share of full push without motion: 0 to below 1
  double curve = 1.7;             ///< exponent beyond it: 1 is linear, 1.5 to 2 is fine near rest
  double half_extent_mm = 100.0;  ///< the HIP stays in a cube about the middle
  double force_max_n = 3.3;       ///< limit of shown forces: that of a small force device
};

/// An Error for a number not finite or out of range.
[[nodiscard]] Status check_spacemouse(const SpaceMouseOptions& options);

/// Speed (mm/s) for one axis's counts.
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
  /// Always fresh while connected, also when silent at rest. Lost after 100 ms of silence while pushed; then
  /// the HIP stands still until the next report.
  [[nodiscard]] DeviceState read() noexcept override;
  void send(GovernedForce) noexcept override {}

  static constexpr int kMaxPolls = 16;

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

/// "spacemouse". Options: path, serial, v_max_mm_per_s, dead_zone, curve, half_extent_mm, force_max_n.
void register_spacemouse_driver(Drivers& drivers);

}  // namespace palpate::device
