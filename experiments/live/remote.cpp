#include "experiments/live/remote.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <span>
#include <thread>
#include <utility>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

// Longest datagram accepted as a command; Ethernet carries less in one packet.
constexpr std::size_t kMostDatagram = 2048;
// Period for noticing a stop request.
constexpr int kListenLookMs = 50;

sockaddr_in socket_address(const ListenAddress& address) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(address.port);
  inet_pton(AF_INET, address.host.c_str(), &to.sin_addr);
  return to;
}

}  // namespace

Result<ListenAddress> parse_listen(const std::string& text) {
  constexpr NumberRange kPorts{0, 65'535};
  ListenAddress address;
  const std::size_t colon = text.rfind(':');
  if (colon != std::string::npos) address.host = text.substr(0, colon);
  const Result<long long> port =
      read_integer(colon == std::string::npos ? text : text.substr(colon + 1), kPorts);
  in_addr number{};
  if (!port || inet_pton(AF_INET, address.host.c_str(), &number) != 1)
    return Error{fmt::format("--listen {} is neither a port nor ADDRESS:PORT", shown(text)),
                 "write 7700, or 0.0.0.0:7700 for every machine of the network"};
  address.port = static_cast<std::uint16_t>(*port);
  return address;
}

struct RemoteListener::State {
  ~State() {
    if (socket >= 0) ::close(socket);
  }
  void run();
  void take(std::span<const std::uint8_t> bytes);
  void act_on(const std::optional<device::RemoteCommand>& command);

  ListenAddress address;
  Act act;
  int socket = -1;
  std::atomic<std::uint64_t> packets{0}, bad{0}, refused{0}, commands{0};
  std::atomic<bool> ending{false};
  std::thread thread;
};

void RemoteListener::State::act_on(const std::optional<device::RemoteCommand>& command) {
  if (!command) {
    bad.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  if (command->kind == device::RemoteCommand::Kind::kNone) return;
  (act(*command) ? commands : refused).fetch_add(1, std::memory_order_relaxed);
}

void RemoteListener::State::take(std::span<const std::uint8_t> bytes) {
  if (!bytes.empty() && (bytes.front() == '/' || bytes.front() == '#')) {
    const auto messages = device::read_osc_packet(bytes);
    if (!messages) return act_on(std::nullopt);
    for (const device::OscMessage& message : *messages) act_on(device::command_of(message));
    return;
  }
  // Reads the bytes as lines of text.
  std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  bool any = false;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.find_first_not_of(" \t\r") == std::string_view::npos) continue;
    any = true;
    act_on(command_of_json(line));
  }
  if (!any) act_on(std::nullopt);
}

void RemoteListener::State::run() {
  std::array<std::uint8_t, kMostDatagram> buffer;
  pollfd waits{socket, POLLIN, 0};
  while (!ending.load(std::memory_order_acquire)) {
    if (::poll(&waits, 1, kListenLookMs) <= 0) continue;
    // MSG_TRUNC returns the true length, so a truncated datagram is noticed.
    const ssize_t size = ::recv(socket, buffer.data(), buffer.size(), MSG_TRUNC | MSG_DONTWAIT);
    if (size < 0) continue;
    packets.fetch_add(1, std::memory_order_relaxed);
    const auto length = static_cast<std::size_t>(size);
    if (length > buffer.size())
      act_on(std::nullopt);
    else
      take(std::span(buffer).first(length));
  }
}

RemoteListener::RemoteListener(std::unique_ptr<State> state) : state_(std::move(state)) {}

RemoteListener::~RemoteListener() {
  state_->ending.store(true, std::memory_order_release);
  if (state_->thread.joinable()) state_->thread.join();
}

Result<std::unique_ptr<RemoteListener>> RemoteListener::start(const ListenAddress& address, Act act) {
  auto state = std::make_unique<State>();
  state->address = address;
  state->act = std::move(act);
  state->socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in own = socket_address(address);
  socklen_t size = sizeof own;
  // The cast follows the socket API.
  if (state->socket < 0 || ::bind(state->socket, reinterpret_cast<const sockaddr*>(&own), size) != 0 ||
      ::getsockname(state->socket, reinterpret_cast<sockaddr*>(&own), &size) != 0)
    return Error{fmt::format("--listen {}:{}: {}", address.host, address.port, std::strerror(errno)),
                 "give another port, or an address of this machine"};
  state->address.port = ntohs(own.sin_port);
  State& run = *state;
  state->thread = std::thread([&run] { run.run(); });
  return std::unique_ptr<RemoteListener>(new RemoteListener(std::move(state)));
}

std::string RemoteListener::where() const {
  return fmt::format("{}:{}", state_->address.host, state_->address.port);
}

RemoteCounts RemoteListener::counts() const noexcept {
  const auto of = [](const std::atomic<std::uint64_t>& count) {
    return count.load(std::memory_order_relaxed);
  };
  return {of(state_->packets), of(state_->bad), of(state_->refused), of(state_->commands)};
}

}  // namespace palpate::experiments
