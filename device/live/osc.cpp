#include "device/live/osc.h"

#include <algorithm>
#include <bit>

namespace palpate::device {
namespace {

constexpr std::size_t kOscWord = 4;  // everything is padded to it

/// What is left of a message.
struct OscReader {
  std::span<const std::uint8_t> left;

  /// A text up to its first zero; the rest of its words must be zero too.
  std::optional<std::string_view> text() noexcept {
    const auto end = std::find(left.begin(), left.end(), std::uint8_t{0});
    if (end == left.end()) return std::nullopt;
    const auto size = static_cast<std::size_t>(end - left.begin());
    const std::size_t padded = (size / kOscWord + 1) * kOscWord;
    if (padded > left.size()) return std::nullopt;
    const auto rest = left.subspan(size, padded - size);
    if (std::any_of(rest.begin(), rest.end(), [](std::uint8_t byte) { return byte != 0; }))
      return std::nullopt;
    // Bytes as characters: what they mean is the sender's.
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

/// The elements behind a bundle's head, each after its length.
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
    if (depth == kMostOscDepth || bytes.size() < kBundleName.size() + kTimeTag) return false;
    if (!std::equal(kBundleName.begin(), kBundleName.end(), bytes.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; }))
      return false;
    return add_elements({bytes.subspan(kBundleName.size() + kTimeTag)}, depth + 1, messages);
  }
  const std::optional<OscMessage> message = read_osc(bytes);
  if (message) messages.push_back(*message);
  return message.has_value();
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
  if (!types || !types->starts_with(',') || types->size() - 1 > OscMessage::kMostArguments)
    return std::nullopt;
  for (const char type : types->substr(1)) {
    const auto argument = argument_of(type, reader);
    if (!argument) return std::nullopt;
    message.arguments[message.count++] = *argument;
  }
  if (!reader.left.empty()) return std::nullopt;
  return message;
}

}  // namespace palpate::device
