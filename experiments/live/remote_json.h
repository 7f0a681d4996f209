// The commands of device/live/remote_command.h as lines of JSON.
#pragma once

#include <optional>
#include <string_view>

#include "device/live/remote_command.h"

namespace palpate::experiments {

/// {"do": "switch"}, {"do": "select", "renderer": 2 or "cloud"}, {"do": "cancel"},
/// {"do": "mark", "text": "..."} and {"do": "rearm"}; other keys are left alone. Nothing: no JSON, or none of
/// these. Whatever the bytes, it answers.
[[nodiscard]] std::optional<device::RemoteCommand> command_of_json(std::string_view line);

}  // namespace palpate::experiments
