// What a program or a tablet asks of a live session over the network, whatever form it came in.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "device/live/osc.h"

namespace palpate::device {

struct RemoteCommand {
  enum class Kind : std::uint8_t {
    kNone,    ///< understood, and nothing to do: a button that was let go
    kNext,    ///< the next renderer
    kSelect,  ///< the one of this number or label
    kCancel,  ///< nothing waits any more
    kMark,    ///< a remark, with the time
    kRearm,   ///< armed again after a fault
  };
  Kind kind = Kind::kNone;
  int number = 0;    ///< of kSelect, from 1; 0: by its label
  std::string text;  ///< of kSelect the label, of kMark the remark
};

/// Texts are cut to so many bytes: they go into a recording.
inline constexpr std::size_t kMostRemoteText = 200;
/// Printable, and not longer: control characters become spaces.
[[nodiscard]] std::string remote_text(std::string_view text);

/// /palpate/switch, /palpate/select NUMBER or LABEL, /palpate/cancel, /palpate/mark [TEXT], /palpate/rearm. A
/// number 0 as the argument of those that need none is a button that was let go. Nothing: another address, or
/// arguments that do not fit.
[[nodiscard]] std::optional<RemoteCommand> command_of(const OscMessage& message);

}  // namespace palpate::device
