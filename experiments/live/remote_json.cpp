#include "experiments/live/remote.h"

#include <nlohmann/json.hpp>

namespace palpate::experiments {
namespace {

using RemoteKind = device::RemoteCommand::Kind;

std::optional<device::RemoteCommand> selection_of(const nlohmann::json& object) {
  const auto which = object.find("renderer");
  if (which == object.end()) return std::nullopt;
  constexpr std::int64_t kMostLaneNumber = 99;
  if (which->is_number_integer()) {
    const auto number = which->get<std::int64_t>();
    if (number < 1 || number > kMostLaneNumber) return std::nullopt;
    return device::RemoteCommand{RemoteKind::kSelect, static_cast<int>(number), {}};
  }
  if (!which->is_string()) return std::nullopt;
  std::string label = device::remote_text(which->get_ref<const std::string&>());
  if (label.empty()) return std::nullopt;
  return device::RemoteCommand{RemoteKind::kSelect, 0, std::move(label)};
}

std::optional<device::RemoteCommand> remark_of(const nlohmann::json& object) {
  const auto text = object.find("text");
  if (text == object.end()) return device::RemoteCommand{RemoteKind::kMark, 0, {}};
  if (!text->is_string()) return std::nullopt;
  return device::RemoteCommand{RemoteKind::kMark, 0,
                               device::remote_text(text->get_ref<const std::string&>())};
}

/// Greatest nesting of brackets, which is the parser's recursion depth.
int depth_of(std::string_view line) {
  int depth = 0, deepest = 0;
  for (const char c : line) {
    if (c == '{' || c == '[') deepest = std::max(deepest, ++depth);
    if (c == '}' || c == ']') --depth;
  }
  return deepest;
}

}  // namespace

std::optional<device::RemoteCommand> command_of_json(std::string_view line) {
  constexpr int kDeepest = 16;  // a command has one
  if (depth_of(line) > kDeepest) return std::nullopt;
  const nlohmann::json object = nlohmann::json::parse(line, nullptr, false);
  if (!object.is_object()) return std::nullopt;
  const auto asked = object.find("do");
  if (asked == object.end() || !asked->is_string()) return std::nullopt;
  const std::string& what = asked->get_ref<const std::string&>();
  if (what == "switch") return device::RemoteCommand{RemoteKind::kNext, 0, {}};
  if (what == "cancel") return device::RemoteCommand{RemoteKind::kCancel, 0, {}};
  if (what == "rearm") return device::RemoteCommand{RemoteKind::kRearm, 0, {}};
  if (what == "select") return selection_of(object);
  if (what == "mark") return remark_of(object);
  return std::nullopt;
}

}  // namespace palpate::experiments
