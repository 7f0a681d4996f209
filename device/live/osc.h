// Open Sound Control 1.0, as programs and tablets send it over UDP: a message, which is an address and
// arguments that are whole numbers (i), single floats (f) or texts (s); or a bundle of messages and bundles
// with a time tag. Source: the OSC 1.0 specification (Wright 2002). Patterns and other types are not
// understood: nobody switches by them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace palpate::device {

struct OscArgument {
  enum class Kind : std::uint8_t { kInteger, kFloat, kText };
  Kind kind = Kind::kInteger;
  std::int32_t integer = 0;
  float real = 0.0F;      ///< may be anything that a float can be
  std::string_view text;  ///< in the message's bytes
};

struct OscMessage {
  static constexpr std::size_t kMostArguments = 8;
  std::string_view address;  ///< begins with '/'; in the message's bytes
  std::array<OscArgument, kMostArguments> arguments{};
  std::size_t count = 0;
};

/// Nothing where the bytes are not exactly one such message: not begun by an address, a text without its end,
/// padding that is not zero, an unknown or missing type, bytes missing or left over. Senders that leave out
/// the types of a message without arguments are understood. Refers to the bytes. O(bytes), no allocation.
[[nodiscard]] std::optional<OscMessage> read_osc(std::span<const std::uint8_t> bytes) noexcept;

/// Bundles within bundles, at most: reading goes down with them, and nobody's program nests deeper.
inline constexpr int kMostOscDepth = 8;
/// All messages of what came in one piece: of a message itself, of a bundle those within it in their order.
/// Nothing where any part is not understood, for a bundle is obeyed whole or not at all. Time tags, the one
/// for "at once" or any other, are passed over: who reads is to act at once. Refers to the bytes. O(bytes).
[[nodiscard]] std::optional<std::vector<OscMessage>> read_osc_packet(std::span<const std::uint8_t> bytes);

}  // namespace palpate::device
