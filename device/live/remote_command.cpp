#include "device/live/remote_command.h"

#include <algorithm>

namespace palpate::device {
namespace {

using RemoteKind = RemoteCommand::Kind;
using OscKind = OscArgument::Kind;

constexpr std::string_view kPrefix = "/palpate/";
// A select's number; more lanes than that there never are.
constexpr int kMostNumber = 99;

/// A whole number from 0 to kMostNumber; tablets send floats.
std::optional<int> number_of(const OscArgument& argument) noexcept {
  if (argument.kind == OscKind::kInteger)
    return argument.integer >= 0 && argument.integer <= kMostNumber ? std::optional<int>(argument.integer)
                                                                    : std::nullopt;
  if (argument.kind != OscKind::kFloat) return std::nullopt;
  // Before the cast: a float may be anything.
  if (!(argument.real >= 0.0F && argument.real <= static_cast<float>(kMostNumber))) return std::nullopt;
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

/// A button: without an argument, or pressed and let go by a number.
std::optional<RemoteCommand> button(RemoteKind kind, const OscMessage& message) {
  if (message.count > 1) return std::nullopt;
  if (message.count == 0) return RemoteCommand{kind, 0, {}};
  const std::optional<int> pressed = number_of(message.arguments.front());
  if (!pressed) return std::nullopt;
  return RemoteCommand{*pressed == 0 ? RemoteKind::kNone : kind, 0, {}};
}

}  // namespace

std::string remote_text(std::string_view text) {
  std::string kept(text.substr(0, kMostRemoteText));
  // A cut within a character of UTF-8 would leave half of it.
  constexpr unsigned kTopBits = 0xC0, kGoesOn = 0x80;
  const auto goes_on = [&](char c) { return (static_cast<unsigned char>(c) & kTopBits) == kGoesOn; };
  if (kept.size() < text.size() && goes_on(text[kept.size()])) {
    while (!kept.empty() && goes_on(kept.back())) kept.pop_back();
    if (!kept.empty()) kept.pop_back();
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
