#include "device/links/udp_link.h"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>

#include <palpate/options.h>

namespace palpate::device {
namespace {

struct FreeAddresses {
  void operator()(addrinfo* list) const noexcept { ::freeaddrinfo(list); }
};
using Addresses = std::unique_ptr<addrinfo, FreeAddresses>;

/// Resolves a host; `passive`: for listening.
Result<Addresses> addresses_of(const UdpAddress& address, bool passive) {
  addrinfo wanted{};
  wanted.ai_socktype = SOCK_DGRAM;
  wanted.ai_flags = AI_NUMERICSERV | (passive ? AI_PASSIVE : 0);
  addrinfo* found = nullptr;
  const int wrong =
      ::getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &wanted, &found);
  if (wrong != 0)
    return Error{"no host " + address.host + ": " + ::gai_strerror(wrong),
                 "check its name, or give its address in numbers"};
  return Addresses(found);
}

/// A non-blocking socket that child programs do not inherit.
int datagram_socket(const addrinfo& at) noexcept {
  return ::socket(at.ai_family, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

Error refused(const UdpAddress& address, const char* what, const char* remedy) {
  return {std::string(what) + " " + address.text() + ": " + std::strerror(errno), remedy, "", 0};
}

}  // namespace

Result<UdpAddress> UdpAddress::of(const std::string& text) {
  constexpr NumberRange kPorts{0, 65535};
  const char* const form = "write HOST:PORT, with an IPv6 address in brackets: [::1]:47800";
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0) return Error{"'" + text + "' has no port", form};
  UdpAddress address;
  address.host = text.substr(0, colon);
  if (address.host.size() > 2 && address.host.front() == '[' && address.host.back() == ']')
    address.host = address.host.substr(1, address.host.size() - 2);
  else if (address.host.find_first_of("[]:") != std::string::npos)
    return Error{"'" + text + "' is no host and port", form};
  const Result<long long> port = read_integer(text.substr(colon + 1), kPorts);
  if (!port) return Error{"'" + text + "': the port " + port.error().what, form};
  address.port = static_cast<std::uint16_t>(*port);
  return address;
}

std::string UdpAddress::text() const {
  const bool six = host.find(':') != std::string::npos;
  return (six ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

UdpLink::~UdpLink() {
  if (const int fd = socket_.load(); fd >= 0) ::close(fd);
}

Status UdpLink::open() {
  if (socket_.load() < 0) {
    Result<Addresses> found = addresses_of(address_, false);
    if (!found) return std::move(found).error();
    int fd = -1;
    for (const addrinfo* at = found->get(); at != nullptr && fd < 0; at = at->ai_next) {
      fd = datagram_socket(*at);
      if (fd < 0 || ::connect(fd, at->ai_addr, at->ai_addrlen) == 0) continue;
      const int why = errno;
      ::close(fd);
      errno = why;
      fd = -1;
    }
    if (fd < 0) return refused(address_, "no way to", "check the network");
    socket_.store(fd);
  }
  open_ = true;
  // Discards an earlier session's datagrams and refusal. Bounded by the kernel's buffer.
  constexpr int kMaxLeft = 10'000;
  std::array<std::uint8_t, 1> byte{};
  for (int i = 0; i < kMaxLeft; ++i)
    if (::recv(socket_.load(), byte.data(), byte.size(), MSG_DONTWAIT) < 0 && errno != ECONNREFUSED) break;
  return Done{};
}

bool UdpLink::submit(std::span<const std::uint8_t> bytes) noexcept {
  const int fd = socket_.load(std::memory_order_acquire);
  if (fd < 0) return false;
  // An error of an earlier datagram is reported once, instead of sending; the second try sends.
  constexpr int kTries = 2;
  for (int i = 0; i < kTries; ++i)
    if (::send(fd, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL) ==
        static_cast<ssize_t>(bytes.size()))
      return true;
  return false;
}

Polled UdpLink::poll(std::span<std::uint8_t> into) noexcept {
  if (!open_) return {0, true};
  const ssize_t size =
      ::recv(socket_.load(std::memory_order_relaxed), into.data(), into.size(), MSG_DONTWAIT);
  if (size >= 0) return {static_cast<std::size_t>(size), false};
  return {0, errno == ECONNREFUSED};
}

UdpPort::~UdpPort() {
  if (socket_ >= 0) ::close(socket_);
}

Status UdpPort::open() {
  Result<Addresses> found = addresses_of(address_, true);
  if (!found) return std::move(found).error();
  const addrinfo& at = **found;
  const int fd = datagram_socket(at);
  if (fd < 0 || ::bind(fd, at.ai_addr, at.ai_addrlen) != 0) {
    Error error = refused(address_, "cannot listen at", "give another port, or an address of this machine");
    if (fd >= 0) ::close(fd);
    return error;
  }
  sockaddr_storage own{};
  socklen_t size = sizeof own;
  if (::getsockname(fd, reinterpret_cast<sockaddr*>(&own), &size) == 0)
    address_.port = ntohs(own.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6*>(&own)->sin6_port
                                                    : reinterpret_cast<const sockaddr_in*>(&own)->sin_port);
  socket_ = fd;
  return Done{};
}

std::size_t UdpPort::receive(std::span<std::uint8_t> into, Peer& from) noexcept {
  sockaddr_storage sender{};
  // A refusal of an earlier answer is reported once, instead of a datagram.
  constexpr int kTries = 2;
  for (int i = 0; i < kTries; ++i) {
    socklen_t length = sizeof sender;
    const ssize_t size = ::recvfrom(socket_, into.data(), into.size(), MSG_DONTWAIT,
                                    reinterpret_cast<sockaddr*>(&sender), &length);
    if (size < 0 && errno == ECONNREFUSED) continue;
    if (size < 0 || length > Peer::kMost) return 0;
    from = {};
    from.size = static_cast<std::uint8_t>(length);
    std::memcpy(from.bytes.data(), &sender, length);
    return static_cast<std::size_t>(size);
  }
  return 0;
}

bool UdpPort::send(std::span<const std::uint8_t> bytes, const Peer& to) noexcept {
  sockaddr_storage address{};
  std::memcpy(&address, to.bytes.data(), to.size);
  return ::sendto(socket_, bytes.data(), bytes.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address), to.size) == static_cast<ssize_t>(bytes.size());
}

}  // namespace palpate::device
