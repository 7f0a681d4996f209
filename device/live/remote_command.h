// Commands to a live session, in any transport format. They come from a program or tablet.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace palpate::device {

// Open Sound Control 1.0 over UDP (Wright 2002): messages with an address and arguments of type integer (i),
// float (f) or text (s), and nested bundles with a time tag. Patterns and other types are not supported.

struct OscArgument {
  enum class Kind : std::uint8_t { kInteger, kFloat, kText };
  Kind kind = Kind::kInteger;
  std::int32_t integer = 0;
  float real = 0.0F;      ///< any float value
  std::string_view text;  ///< in the message's bytes
};

struct OscMessage {
  static constexpr std::size_t kMaxArguments = 8;
  std::string_view address;  ///< begins with '/'; in the message's bytes
  std::array<OscArgument, kMaxArguments> arguments{};
  std::size_t count = 0;
};

/// Nothing unless the bytes are exactly one message: rejects a missing address, unterminated text, non-zero
/// padding, unknown or missing types, missing or extra bytes. A missing type list without arguments is
/// accepted. Refers to the bytes. O(bytes), no allocation.
[[nodiscard]] std::optional<OscMessage> read_osc(std::span<const std::uint8_t> bytes) noexcept;

/// Deepest nesting of bundles, which bounds the recursion; no program nests deeper.
inline constexpr int kMaxOscDepth = 8;
/// All messages of a datagram: the message, or those of a bundle in order. Nothing if any part is invalid: a
/// bundle is obeyed whole or not at all. Ignores time tags; the caller acts at once. Refers to the bytes.
/// O(bytes).
[[nodiscard]] std::optional<std::vector<OscMessage>> read_osc_packet(std::span<const std::uint8_t> bytes);

struct RemoteCommand {
  enum class Kind : std::uint8_t {
    kNone,    ///< understood, without effect: a released button
    kNext,    ///< the next renderer
    kSelect,  ///< by number or label
    kCancel,  ///< cancels waiting
    kMark,    ///< a remark, with the time
    kRearm,   ///< arms again after a fault
  };
  Kind kind = Kind::kNone;
  int number = 0;    ///< of kSelect, from 1; 0: by its label
  std::string text;  ///< kSelect: the label; kMark: the remark
};

/// Largest text in bytes; longer ones are cut, because they go into a recording.
inline constexpr std::size_t kMaxRemoteText = 200;
/// Printable and cut; control characters become spaces.
[[nodiscard]] std::string remote_text(std::string_view text);

/// /palpate/switch, /palpate/select NUMBER or LABEL, /palpate/cancel, /palpate/mark [TEXT], /palpate/rearm. A
/// number 0 as the argument of those that need none is a button that was let go. Nothing: another address, or
/// arguments that do not fit.
[[nodiscard]] std::optional<RemoteCommand> command_of(const OscMessage& message);

}  // namespace palpate::device
