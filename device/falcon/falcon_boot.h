// Bringing a Falcon to where packets flow: its serial chip, its boot ROM, its firmware.
//
// Between USB and the Falcon's processor stands a serial chip of FTDI's: its settings are control requests,
// and every packet from it begins with two bytes about the line. After power-up the processor is in its boot
// ROM and waits for an image; with one it runs until power-off. Loading takes some seconds, and is tried ten
// times; a Falcon that has firmware is ready in milliseconds.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "device/falcon/falcon_firmware.h"
#include "device/links/control_link.h"
#include "toolkit/core/result.h"

namespace palpate::device {

/// Bytes about the line at the front of each packet from the chip; two of them alone: nothing yet.
inline constexpr std::size_t kFtdiStatusBytes = 2;
/// What is left of a packet of the chip behind them.
[[nodiscard]] inline std::span<const std::uint8_t> ftdi_payload(
    std::span<const std::uint8_t> packet) noexcept {
  return packet.size() > kFtdiStatusBytes ? packet.subspan(kFtdiStatusBytes)
                                          : std::span<const std::uint8_t>();
}

struct FalconBoot {
  /// Where an image is to be had: asked only where no firmware runs.
  std::function<Result<FalconFirmware>()> firmware;
  /// Waits so many ms: sleeps, or moves a virtual clock.
  std::function<void(int ms)> pause;
  /// Flushes the chip's buffer at the end of every reply: up to 1 ms fresher. Untried on a Falcon.
  bool event_character = false;
};

/// What happened, for people and reports.
struct FalconBooted {
  bool was_running = false;  ///< firmware was there already: which one cannot be asked
  std::string firmware;      ///< name of the image that was loaded
  std::string sha256;
  int attempts = 0;  ///< loadings begun
};

/// Over an open link; closes and opens it between attempts. When it returns, packets flow, zero force was
/// commanded, and old bytes may still come.
[[nodiscard]] Result<FalconBooted> boot_falcon(ControlLink& link, const FalconBoot& boot);

}  // namespace palpate::device
