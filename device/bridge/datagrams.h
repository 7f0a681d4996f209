// Datagrams of the UDP bridge to a distant device. The driver runs at the other machine. Numbers are
// little-endian; docs/reference/documents.md describes them for those who write a far end.
//
//   byte   0-3     4        5     6-7    8-15     16-19     20-23    ..       last 4
//          "PLPB"  version  kind  flags  session  sequence  answers  by kind  CRC-32 of all before
//
// `sequence` counts the sender's datagrams. `answers` is the newest far-end sequence seen by the host (in a
// command), or the newest accepted command (in a state). From both each side knows a datagram's age on its
// own clock.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include <palpate/device/device.h>

namespace palpate::device {

inline constexpr std::uint8_t kBridgeVersion = 1;
inline constexpr std::uint16_t kBridgePort = 47800;  ///< default

enum class DatagramKind : std::uint8_t {
  kHello = 'H',     ///< host: asks for a far end; begins a session
  kWelcome = 'W',   ///< far end: limits of its device
  kBusy = 'B',      ///< far end: serves another session
  kCommand = 'C',   ///< host: a force
  kState = 'S',     ///< far end: a position
  kRelease = 'R',   ///< anybody: zero force now; needs no session
  kReleased = 'D',  ///< far end: done
};

struct BridgeWelcome {
  static constexpr std::size_t kNameBytes = 32;

  DeviceLimits limits;
  double watchdog_s = 0.0;                    ///< zero force after this time without an accepted command
  double max_age_s = 0.0;                     ///< commands that answer an older state are refused
  std::array<char, kNameBytes> name_bytes{};  ///< printable ASCII, then zeros

  [[nodiscard]] std::string_view name() const noexcept;
};

struct Datagram {
  // Flags of a state: homed, forces obeyed, two bits of ReadStatus.
  static constexpr std::uint16_t kHomed = 1, kObeys = 2, kStatusShift = 4, kStatusMask = 3U << kStatusShift;

  DatagramKind kind = DatagramKind::kHello;
  std::uint16_t flags = 0;
  std::uint64_t session = 0;
  std::uint32_t sequence = 0, answers = 0;
  Vec3 vector = Vec3::Zero();  ///< force (N) of a command, position (mm) of a state
  std::uint32_t buttons = 0;   ///< of a state
  std::uint32_t age_us = 0;    ///< of a state: age of the device's packet when sent
  BridgeWelcome welcome{};     ///< of a welcome

  [[nodiscard]] ReadStatus status() const noexcept {
    return static_cast<ReadStatus>((flags & kStatusMask) >> kStatusShift);
  }
};

inline constexpr std::size_t kMaxDatagramBytes = 168;

class DatagramBytes {
 public:
  explicit DatagramBytes(const Datagram& datagram) noexcept;
  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept {
    return std::span(bytes_).first(size_);
  }

 private:
  std::array<std::uint8_t, kMaxDatagramBytes> bytes_{};
  std::size_t size_ = 0;
};

/// Nothing for a wrong length, version, kind or CRC, set reserved bits, or a non-finite force or limit. A
/// decoded datagram encodes to the same bytes. The governor checks positions. O(bytes), no allocation.
[[nodiscard]] std::optional<Datagram> decoded_datagram(std::span<const std::uint8_t> bytes) noexcept;

/// CRC-32 (polynomial 0x04C11DB7, reflected, as in Ethernet and zip). Detects bursts of up to 32 bits and, at
/// this length, changes of up to 5 bits (Koopman 2002).
[[nodiscard]] std::uint32_t crc32_of(std::span<const std::uint8_t> bytes) noexcept;

/// Whether `a` is later than `b`; the difference wraps like the counter.
[[nodiscard]] inline bool counted_after(std::uint32_t a, std::uint32_t b) noexcept {
  return static_cast<std::int32_t>(a - b) > 0;
}

/// Ring of send times by sequence number. 1024 entries are 128 ms at 8 kHz, far beyond any accepted age.
class SentTimes {
 public:
  void note(std::uint32_t sequence, std::int64_t now_ns) noexcept {
    slots_[sequence % kSlots] = {sequence, now_ns, true};
  }
  /// Nothing if never sent or no longer held.
  [[nodiscard]] std::optional<std::int64_t> age_ns(std::uint32_t sequence,
                                                   std::int64_t now_ns) const noexcept {
    const Slot& slot = slots_[sequence % kSlots];
    if (!slot.used || slot.sequence != sequence) return std::nullopt;
    return now_ns - slot.at_ns;
  }

 private:
  static constexpr std::size_t kSlots = 1024;
  struct Slot {
    std::uint32_t sequence = 0;
    std::int64_t at_ns = 0;
    bool used = false;
  };
  std::array<Slot, kSlots> slots_{};
};

}  // namespace palpate::device
