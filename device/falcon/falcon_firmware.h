// The Falcon's firmware: a file that the user brings (none may be shipped), judged before a byte of it is
// sent. It is a boot stream of TI's C2000 family, as their boot loader guides describe it:
//
//   bytes   0-1    2-17            18-21        from 22: blocks                          end
//           AA 08  eight reserved  entry point  word count, address of 32 bits, words    a count of 0
//
// A word is two bytes, the lower first; a number of 32 bits is two words, the upper first.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::device {

/// The largest file that is read: a hundred times the largest known image.
inline constexpr std::uint64_t kFalconMostFirmwareBytes = std::uint64_t{1} << 20;

struct FalconFirmware {
  std::vector<std::uint8_t> bytes;
  std::string path;
  std::string sha256;
  std::string name;  ///< of a known image; "unknown image" else
  std::uint32_t entry = 0;
  std::size_t blocks = 0, words = 0;
};

/// Walks the stream: key, blocks, addresses that the processor has, nothing after the end. The Error says at
/// which byte. O(bytes).
[[nodiscard]] Result<FalconFirmware> check_falcon_firmware(std::vector<std::uint8_t> bytes);
/// The same of a file, with its name in every Error.
[[nodiscard]] Result<FalconFirmware> read_falcon_firmware(const std::string& path);

/// Where images are looked for, in this order.
struct FalconFirmwarePlaces {
  std::string file;                            ///< named by the user: this or none
  std::string variable;                        ///< PALPATE_FALCON_FIRMWARE: this or none
  std::vector<std::filesystem::path> folders;  ///< *.bin in each
};
/// From the environment: the folders palpate/falcon of $XDG_DATA_HOME (or ~/.local/share) and of
/// /usr/local/share, and /lib/firmware/novint.
[[nodiscard]] FalconFirmwarePlaces falcon_firmware_places(const std::string& file);
/// The first that is found. Within a folder known images come first, the one that others recommend before the
/// rest, then by name; a file that is no image is passed over, unless nothing else is found: then it is the
/// Error. With nothing at all the Error says what is missing and where to put it.
[[nodiscard]] Result<FalconFirmware> find_falcon_firmware(const FalconFirmwarePlaces& places);

}  // namespace palpate::device
