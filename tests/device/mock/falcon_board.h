// A Falcon as its USB cable sees it: FTDI's serial chip with its latency timer, a boot ROM that echoes, and
// firmware that answers packets. Time comes in with each call. Used by tests over a link without hardware and
// over the real libusb.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include <palpate/device/link.h>
#include <palpate/vec.h>
#include "device/falcon/falcon_packets.h"

namespace palpate::device {

/// What goes wrong, while it is set.
struct FalconFaults {
  bool silent = false;        ///< no replies, though the chip lives
  bool garbled = false;       ///< a byte of each reply is wrong
  bool lost_homing = false;   ///< one leg's flag drops
  std::array<int, 3> jump{};  ///< counts added
  int deaf_for = 0;           ///< so many commands are not answered
  int wrong_echoes = 0;       ///< so many loadings go wrong, at byte `wrong_at`
  std::size_t wrong_at = 100;
  bool mute_rom = false;    ///< the boot ROM never answers
  bool zero_first = false;  ///< its answer begins with 00, as on some hosts
  bool dead_image = false;  ///< the image is loaded, and does nothing
};

class FalconBoard {
 public:
  enum class Stage : std::uint8_t { kRom, kGreeted, kLoading, kRunning };

  // What the host does.
  void control(const ControlRequest& request, std::int64_t now_ns);
  void out(std::span<const std::uint8_t> bytes, std::int64_t now_ns);
  /// The next IN packet: status bytes and what has come, or the status bytes alone when the timer expired;
  /// nothing while the chip has no reason to send.
  [[nodiscard]] std::optional<std::vector<std::uint8_t>> in(std::int64_t now_ns);
  /// Whether in() would give one.
  [[nodiscard]] bool due(std::int64_t now_ns) const;

  // What tests set and see.
  FalconFaults faults;
  std::array<int, 3> counts{};  ///< of the legs
  std::uint8_t buttons = 0, homed = 0;
  std::size_t most_per_packet = 62;  ///< payload: fewer tears replies
  /// What comes instead of a reply; empty: it does itself.
  std::function<std::vector<std::vector<std::uint8_t>>(std::vector<std::uint8_t>)> instead{};
  /// Called with each command that was taken.
  std::function<void(const FalconBoard&)> commanded{};
  bool echo_motors = false;  ///< replies carry the motors' commands: which answers which
  void run_firmware() { stage_ = Stage::kRunning; }
  void power_cycle();
  /// All legs, at the pose of these counts.
  void home(const std::array<int, 3>& at) { counts = at, homed = FalconReply::kAllLegs; }
  [[nodiscard]] Stage stage() const { return stage_; }
  [[nodiscard]] const FalconCommand& held() const { return held_; }
  [[nodiscard]] bool holds_force() const { return held_.motors != std::array<int, 3>{}; }
  [[nodiscard]] std::uint64_t commands() const { return commands_; }
  [[nodiscard]] std::uint64_t refused() const { return refused_; }  ///< bytes that made no command
  [[nodiscard]] const std::vector<std::uint8_t>& loaded() const { return loaded_; }
  [[nodiscard]] int resets() const { return resets_; }
  [[nodiscard]] std::uint16_t latency_ms() const { return latency_ms_; }
  [[nodiscard]] bool event_character() const { return event_character_; }

 private:
  void reset();
  void take(std::uint8_t byte, std::int64_t now_ns);
  void take_loading(std::uint8_t byte);
  void take_packet(std::uint8_t byte);
  void answer(std::span<const std::uint8_t> bytes);
  [[nodiscard]] bool image_is_whole() const;

  Stage stage_ = Stage::kRom;
  std::uint16_t baud_ = 0, latency_ms_ = 16;
  bool dtr_ = false, event_character_ = false;
  std::deque<std::uint8_t> to_host_;
  std::int64_t sent_ns_ = 0;  // when the last IN packet went out
  std::vector<std::uint8_t> received_, loaded_;
  FalconCommand held_;
  std::uint64_t commands_ = 0, refused_ = 0;
  int resets_ = 0;
};

/// Encoder counts of leg angles, possibly fractional.
[[nodiscard]] Vec3 falcon_counts_of_angles(const Vec3& angles_rad);
/// Counts of the legs at a place of the device frame.
[[nodiscard]] std::array<int, 3> falcon_counts_at(const Vec3& device_mm);

/// An image that any Falcon would take and none could run: for tests.
[[nodiscard]] std::vector<std::uint8_t> made_up_image(std::size_t blocks = 3, std::size_t words = 200);

}  // namespace palpate::device
