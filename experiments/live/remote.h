// Session requests over UDP: OSC messages and JSON lines, by default from this machine only.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <palpate/result.h>
#include "device/live/remote_command.h"

namespace palpate::experiments {

struct ListenAddress {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;  ///< 0: any free port
};
/// Parses "7700", "192.168.1.5:7700" or "0.0.0.0:7700": numeric IPv4, no host names. Errors describe the
/// fault.
[[nodiscard]] Result<ListenAddress> parse_listen(const std::string& text);

struct RemoteCounts {
  std::uint64_t packets = 0;   ///< datagrams received
  std::uint64_t bad = 0;       ///< messages that are no command
  std::uint64_t refused = 0;   ///< commands that name nothing present or come at a wrong time
  std::uint64_t commands = 0;  ///< passed on
};

/// Listens in its own thread until destroyed. A flood costs only that thread's time.
class RemoteListener {
 public:
  /// Called in the listener's thread; false: refused.
  using Act = std::function<bool(const device::RemoteCommand&)>;
  /// Errors: an address of another machine, a port in use.
  [[nodiscard]] static Result<std::unique_ptr<RemoteListener>> start(const ListenAddress& address, Act act);
  ~RemoteListener();
  RemoteListener(const RemoteListener&) = delete;
  RemoteListener& operator=(const RemoteListener&) = delete;

  /// Address with the port in use: "127.0.0.1:7700".
  [[nodiscard]] std::string where() const;
  [[nodiscard]] RemoteCounts counts() const noexcept;

 private:
  struct State;
  explicit RemoteListener(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Parses {"do": "switch"}, {"do": "select", "renderer": 2 or "cloud"}, {"do": "cancel"}, {"do": "mark",
/// "text": "..."} and {"do": "rearm"}, ignoring other keys. Empty if it is not JSON or none of these. Safe
/// for any bytes.
[[nodiscard]] std::optional<device::RemoteCommand> command_of_json(std::string_view line);

}  // namespace palpate::experiments
