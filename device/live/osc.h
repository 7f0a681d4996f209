// One message of Open Sound Control 1.0, as programs and tablets send it over UDP: an address and arguments
// that are whole numbers (i), single floats (f) or texts (s). Source: the OSC 1.0 specification (Wright
// 2002). Bundles, patterns and other types are not understood: nobody switches by them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

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

}  // namespace palpate::device
