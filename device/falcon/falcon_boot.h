// Starts a Falcon up to its packet exchange: serial chip, boot ROM, firmware.
//
// An FTDI serial chip sits between USB and the Falcon's processor: control requests set it up, and its
// packets begin with two status bytes. After power-up the processor waits in its boot ROM for an image, which
// runs until power-off. Loading takes some seconds and is tried ten times; a Falcon with running firmware is
// ready in milliseconds.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include <palpate/device/link.h>
#include <palpate/result.h>

namespace palpate::device {

// Checks the Falcon's firmware, a file from the user (none may be shipped), before any byte is sent. Boot
// stream of TI's C2000 family, as in their boot loader guides:
//
//   bytes   0-1    2-17            18-21        from 22: blocks                          end
//           AA 08  eight reserved  entry point  word count, address of 32 bits, words    a count of 0
//
// A word is two bytes, the lower first; a 32-bit number is two words, the upper first.

/// Largest file read: a hundred times the largest known image.
inline constexpr std::uint64_t kFalconMostFirmwareBytes = std::uint64_t{1} << 20;

struct FalconFirmware {
  std::vector<std::uint8_t> bytes;
  std::string path;
  std::string sha256;
  std::string name;  ///< of a known image, else "unknown image"
  std::uint32_t entry = 0;
  std::size_t blocks = 0, words = 0;
};

/// Checks key, blocks, addresses that the processor has, and the end. An Error names the byte. O(bytes).
[[nodiscard]] Result<FalconFirmware> check_falcon_firmware(std::vector<std::uint8_t> bytes);
/// The same for a file, with its name in every Error.
[[nodiscard]] Result<FalconFirmware> read_falcon_firmware(const std::string& path);

/// Search places for images, in this order.
struct FalconFirmwarePlaces {
  std::string file;                            ///< named by the user; excludes the others
  std::string variable;                        ///< PALPATE_FALCON_FIRMWARE; excludes the others
  std::vector<std::filesystem::path> folders;  ///< *.bin in each
};
/// From the environment: folders palpate/falcon of $XDG_DATA_HOME (or ~/.local/share) and /usr/local/share,
/// and /lib/firmware/novint.
[[nodiscard]] FalconFirmwarePlaces falcon_firmware_places(const std::string& file);
/// The first image found. Within a folder known images come first, the recommended one before the rest, then
/// by name. Invalid files count only if nothing else is found: as the Error. Without any file the Error says
/// what is missing and where to put it.
[[nodiscard]] Result<FalconFirmware> find_falcon_firmware(const FalconFirmwarePlaces& places);

/// Line status bytes at the front of each packet; alone they mean no data.
inline constexpr std::size_t kFtdiStatusBytes = 2;
[[nodiscard]] inline std::span<const std::uint8_t> ftdi_payload(
    std::span<const std::uint8_t> packet) noexcept {
  return packet.size() > kFtdiStatusBytes ? packet.subspan(kFtdiStatusBytes)
                                          : std::span<const std::uint8_t>();
}

struct FalconBoot {
  /// Gives an image; called only if no firmware runs.
  std::function<Result<FalconFirmware>()> firmware;
  /// Waits some ms: sleeps, or moves a virtual clock.
  std::function<void(int ms)> pause;
  /// Flushes the chip's buffer at each reply's end: up to 1 ms fresher. Untried on a Falcon.
  bool event_character = false;
};

/// Result of a boot, for people and reports.
struct FalconBooted {
  bool was_running = false;  ///< firmware was already running; its version cannot be asked
  std::string firmware;      ///< name of the loaded image
  std::string sha256;
  int attempts = 0;
};

/// Uses an open link, closed and opened between attempts. On return packets flow and zero force was
/// commanded; old bytes may still arrive.
[[nodiscard]] Result<FalconBooted> boot_falcon(ControlLink& link, const FalconBoot& boot);

}  // namespace palpate::device
