// Requests over UDP while a session runs: OSC messages and lines of JSON, from this machine alone unless
// another address is given.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "device/live/remote_command.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

struct ListenAddress {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;  ///< 0: one that is free
  [[nodiscard]] bool is_loopback() const { return host.starts_with("127."); }
};
/// "7700", "192.168.1.5:7700" or "0.0.0.0:7700": numbers of IPv4, no names. Errors say what is wrong.
[[nodiscard]] Result<ListenAddress> parse_listen(const std::string& text);

struct RemoteCounts {
  std::uint64_t packets = 0;   ///< datagrams that came
  std::uint64_t bad = 0;       ///< messages in them that are no command
  std::uint64_t refused = 0;   ///< commands that name nothing there, or come at a wrong time
  std::uint64_t commands = 0;  ///< that were passed on
};

/// Listens in a thread of its own until it is destroyed. A flood costs that thread's time alone.
class RemoteListener {
 public:
  /// In the listener's thread; false: refused.
  using Act = std::function<bool(const device::RemoteCommand&)>;
  /// Errors: the address is not this machine's, or the port is taken.
  [[nodiscard]] static Result<std::unique_ptr<RemoteListener>> start(const ListenAddress& address, Act act);
  ~RemoteListener();
  RemoteListener(const RemoteListener&) = delete;
  RemoteListener& operator=(const RemoteListener&) = delete;

  /// With the port that was given or found: "127.0.0.1:7700".
  [[nodiscard]] std::string where() const;
  [[nodiscard]] RemoteCounts counts() const noexcept;

 private:
  struct State;
  explicit RemoteListener(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace palpate::experiments
