#include "device/live/remote_command.h"

#include <algorithm>
#include <bit>

namespace palpate::device {
namespace {

constexpr std::size_t kOscWord = 4;  // everything is padded to it

/// The rest of a message.
struct OscReader {
  std::span<const std::uint8_t> left;

  /// Text up to its first zero; the padding must be zero.
  std::optional<std::string_view> text() noexcept {
    const auto end = std::find(left.begin(), left.end(), std::uint8_t{0});
    if (end == left.end()) return std::nullopt;
    const auto size = static_cast<std::size_t>(end - left.begin());
    const std::size_t padded = (size / kOscWord + 1) * kOscWord;
    if (padded > left.size()) return std::nullopt;
    const auto rest = left.subspan(size, padded - size);
    if (std::any_of(rest.begin(), rest.end(), [](std::uint8_t byte) { return byte != 0; }))
      return std::nullopt;
    // Bytes as characters, uninterpreted.
    const std::string_view found(reinterpret_cast<const char*>(left.data()), size);
    left = left.subspan(padded);
    return found;
  }
  /// Big-endian.
  std::optional<std::uint32_t> word() noexcept {
    if (left.size() < kOscWord) return std::nullopt;
    std::uint32_t value = 0;
    for (const std::uint8_t byte : left.first(kOscWord)) value = value << 8U | byte;
    left = left.subspan(kOscWord);
    return value;
  }
};

std::optional<OscArgument> argument_of(char type, OscReader& reader) noexcept {
  OscArgument argument;
  if (type == 's') {
    const auto text = reader.text();
    if (!text) return std::nullopt;
    argument.kind = OscArgument::Kind::kText;
    argument.text = *text;
    return argument;
  }
  if (type != 'i' && type != 'f') return std::nullopt;
  const auto word = reader.word();
  if (!word) return std::nullopt;
  if (type == 'f') {
    argument.kind = OscArgument::Kind::kFloat;
    argument.real = std::bit_cast<float>(*word);
  } else {
    argument.integer = std::bit_cast<std::int32_t>(*word);
  }
  return argument;
}

constexpr std::string_view kBundleName("#bundle\0", 8);
constexpr std::size_t kTimeTag = 8;

bool add_messages(std::span<const std::uint8_t> bytes, int depth, std::vector<OscMessage>& messages);

/// The elements after a bundle's head, each with its length.
bool add_elements(OscReader reader, int depth, std::vector<OscMessage>& messages) {
  while (!reader.left.empty()) {
    const auto size = reader.word();
    if (!size || *size == 0 || *size > reader.left.size() || *size % kOscWord != 0) return false;
    if (!add_messages(reader.left.first(*size), depth, messages)) return false;
    reader.left = reader.left.subspan(*size);
  }
  return true;
}

bool add_messages(std::span<const std::uint8_t> bytes, int depth, std::vector<OscMessage>& messages) {
  if (!bytes.empty() && bytes.front() == static_cast<std::uint8_t>(kBundleName.front())) {
    if (depth == kMaxOscDepth || bytes.size() < kBundleName.size() + kTimeTag) return false;
    if (!std::equal(kBundleName.begin(), kBundleName.end(), bytes.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }))
      return false;
    return add_elements({bytes.subspan(kBundleName.size() + kTimeTag)}, depth + 1, messages);
  }
  const std::optional<OscMessage> message = read_osc(bytes);
  if (message) messages.push_back(*message);
  return message.has_value();
}

using RemoteKind = RemoteCommand::Kind;
using OscKind = OscArgument::Kind;

constexpr std::string_view kPrefix = "/palpate/";
// Largest number of a select; more lanes never exist.
constexpr int kMaxNumber = 99;

/// A whole number from 0 to kMaxNumber; tablets send floats.
std::optional<int> number_of(const OscArgument& argument) noexcept {
  if (argument.kind == OscKind::kInteger)
    return argument.integer >= 0 && argument.integer <= kMaxNumber ? std::optional<int>(argument.integer)
                                                                   : std::nullopt;
  if (argument.kind != OscKind::kFloat) return std::nullopt;
  // Checked before the cast.
  if (!(argument.real >= 0.0F && argument.real <= static_cast<float>(kMaxNumber))) return std::nullopt;
  const int whole = static_cast<int>(argument.real);
  return static_cast<float>(whole) == argument.real ? std::optional<int>(whole) : std::nullopt;
}

std::optional<RemoteCommand> selection(const OscMessage& message) {
  if (message.count != 1) return std::nullopt;
  const OscArgument& which = message.arguments.front();
  if (which.kind == OscKind::kText) {
    if (which.text.empty()) return std::nullopt;
    return RemoteCommand{RemoteKind::kSelect, 0, remote_text(which.text)};
  }
  const std::optional<int> number = number_of(which);
  if (!number || *number == 0) return std::nullopt;
  return RemoteCommand{RemoteKind::kSelect, *number, {}};
}

std::optional<RemoteCommand> remark(const OscMessage& message) {
  if (message.count > 1) return std::nullopt;
  if (message.count == 0) return RemoteCommand{RemoteKind::kMark, 0, {}};
  const OscArgument& text = message.arguments.front();
  if (text.kind == OscKind::kText) return RemoteCommand{RemoteKind::kMark, 0, remote_text(text.text)};
  const std::optional<int> pressed = number_of(text);
  if (!pressed) return std::nullopt;
  return RemoteCommand{*pressed == 0 ? RemoteKind::kNone : RemoteKind::kMark, 0, {}};
}

/// A button: without an argument, or pressed and released by a number.
std::optional<RemoteCommand> button(RemoteKind kind, const OscMessage& message) {
  if (message.count > 1) return std::nullopt;
  if (message.count == 0) return RemoteCommand{kind, 0, {}};
  const std::optional<int> pressed = number_of(message.arguments.front());
  if (!pressed) return std::nullopt;
  return RemoteCommand{*pressed == 0 ? RemoteKind::kNone : kind, 0, {}};
}

}  // namespace

std::optional<std::vector<OscMessage>> read_osc_packet(std::span<const std::uint8_t> bytes) {
  std::vector<OscMessage> messages;
  if (!add_messages(bytes, 0, messages)) return std::nullopt;
  return messages;
}

std::optional<OscMessage> read_osc(std::span<const std::uint8_t> bytes) noexcept {
  OscReader reader{bytes};
  const auto address = reader.text();
  if (!address || !address->starts_with('/')) return std::nullopt;
  OscMessage message;
  message.address = *address;
  if (reader.left.empty()) return message;
  const auto types = reader.text();
  if (!types || !types->starts_with(',') || types->size() - 1 > OscMessage::kMaxArguments)
    return std::nullopt;
  for (const char type : types->substr(1)) {
    const auto argument = argument_of(type, reader);
    if (!argument) return std::nullopt;
    message.arguments[message.count++] = *argument;
  }
  if (!reader.left.empty()) return std::nullopt;
  return message;
}

std::string remote_text(std::string_view text) {
  std::string kept(text.substr(0, kMaxRemoteText));
  // Avoids cutting inside a UTF-8 character, which has at most three bytes after its first. Bytes that are no
  // UTF-8 are cut anywhere: a text of nothing but later bytes must not become empty.
  constexpr unsigned kTopBits = 0xC0, kGoesOn = 0x80;
  constexpr std::size_t kMostLaterBytes = 3;
  const auto goes_on = [&](char c) { return (static_cast<unsigned char>(c) & kTopBits) == kGoesOn; };
  if (kept.size() < text.size() && goes_on(text[kept.size()])) {
    std::size_t later = 0;
    while (later < kMostLaterBytes && goes_on(kept[kept.size() - 1 - later])) ++later;
    const char first = kept[kept.size() - 1 - later];
    if ((static_cast<unsigned char>(first) & kTopBits) == kTopBits) kept.resize(kept.size() - 1 - later);
  }
  constexpr unsigned char kFirstPrintable = 0x20, kDelete = 0x7F;
  std::replace_if(
      kept.begin(), kept.end(),
      [](char c) {
        const auto byte = static_cast<unsigned char>(c);
        return byte < kFirstPrintable || byte == kDelete;
      },
      ' ');
  return kept;
}

std::optional<RemoteCommand> command_of(const OscMessage& message) {
  if (!message.address.starts_with(kPrefix)) return std::nullopt;
  const std::string_view what = message.address.substr(kPrefix.size());
  if (what == "switch") return button(RemoteKind::kNext, message);
  if (what == "cancel") return button(RemoteKind::kCancel, message);
  if (what == "rearm") return button(RemoteKind::kRearm, message);
  if (what == "select") return selection(message);
  if (what == "mark") return remark(message);
  return std::nullopt;
}

}  // namespace palpate::device
