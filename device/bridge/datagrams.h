// The datagrams of the UDP bridge: how a device at another machine, whose driver runs there, is felt here.
// All numbers little-endian; docs/bridge.md is the description for those who write a far end of their own.
//
//   byte   0-3     4        5     6-7    8-15     16-19     20-23    ..       last 4
//          "PLPB"  version  kind  flags  session  sequence  answers  by kind  CRC-32 of all before
//
// `sequence` counts the datagrams of its sender. `answers` is, in a command, the newest sequence of the far
// end that the host has seen; in a state, the newest command that the far end has accepted. By both each side
// knows how old a datagram is, on its own clock, whatever the network did to it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "device/interface/device.h"

namespace palpate::device {

inline constexpr std::uint8_t kBridgeVersion = 1;
inline constexpr std::uint16_t kBridgePort = 47800;  ///< where nobody says another one

enum class DatagramKind : std::uint8_t {
  kHello = 'H',     ///< host: who is there? Begins a session
  kWelcome = 'W',   ///< far end: limits of its device
  kBusy = 'B',      ///< far end: another session is alive
  kCommand = 'C',   ///< host: a force
  kState = 'S',     ///< far end: a position
  kRelease = 'R',   ///< anybody: zero force now. Needs no session
  kReleased = 'D',  ///< far end: done
};

/// What a far end can do and how it guards.
struct BridgeWelcome {
  static constexpr std::size_t kNameBytes = 32;

  DeviceLimits limits;
  double watchdog_s = 0.0;                    ///< without an accepted command for longer: zero force
  double most_age_s = 0.0;                    ///< a command that answers an older state is refused
  std::array<char, kNameBytes> name_bytes{};  ///< printable ASCII, then zeros

  [[nodiscard]] std::string_view name() const noexcept;
};

struct Datagram {
  // Of a state: its device is homed; forces are obeyed; two bits of ReadStatus.
  static constexpr std::uint16_t kHomed = 1, kObeys = 2, kStatusShift = 4, kStatusMask = 3U << kStatusShift;

  DatagramKind kind = DatagramKind::kHello;
  std::uint16_t flags = 0;
  std::uint64_t session = 0;
  std::uint32_t sequence = 0, answers = 0;
  Vec3 vector = Vec3::Zero();  ///< of a command: force, N; of a state: position, mm
  std::uint32_t buttons = 0;   ///< of a state
  std::uint32_t age_us = 0;    ///< of a state: how old the device's packet was when it was sent
  BridgeWelcome welcome{};     ///< of a welcome

  [[nodiscard]] ReadStatus status() const noexcept {
    return static_cast<ReadStatus>((flags & kStatusMask) >> kStatusShift);
  }
};

inline constexpr std::size_t kMostDatagramBytes = 168;

/// Bytes of one datagram. O(1), no allocation.
class DatagramBytes {
 public:
  explicit DatagramBytes(const Datagram& datagram) noexcept;
  [[nodiscard]] std::span<const std::uint8_t> bytes() const noexcept {
    return std::span(bytes_).first(size_);
  }

 private:
  std::array<std::uint8_t, kMostDatagramBytes> bytes_{};
  std::size_t size_ = 0;
};

/// Nothing where it is none: wrong length, version, kind, CRC, reserved bits that are set, a force or limits
/// that are not finite. Every datagram has one form: what is decoded encodes to the same bytes. Of a state
/// any position passes; the governor judges it. O(bytes), no allocation.
[[nodiscard]] std::optional<Datagram> decoded_datagram(std::span<const std::uint8_t> bytes) noexcept;

/// CRC-32 (polynomial 0x04C11DB7, reflected, as in Ethernet and zip): finds every burst of up to 32 bits and,
/// in datagrams of this length, every change of up to 5 bits (Koopman 2002).
[[nodiscard]] std::uint32_t crc32_of(std::span<const std::uint8_t> bytes) noexcept;

/// Whether `a` was counted after `b`; the difference wraps as the counter.
[[nodiscard]] inline bool counted_after(std::uint32_t a, std::uint32_t b) noexcept {
  return static_cast<std::int32_t>(a - b) > 0;
}

}  // namespace palpate::device
