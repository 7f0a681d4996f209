// Where datagrams of several peers arrive, and answers go out: what serves a device to other machines stands
// on this. UDP in udp_link.h; a pretended network in the tests.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace palpate::device {

/// Who sent a datagram: an address as the operating system writes it (IPv4 or IPv6), compared byte by byte.
struct Peer {
  static constexpr std::size_t kMost = 28;  ///< of sockaddr_in6
  std::array<std::uint8_t, kMost> bytes{};
  std::uint8_t size = 0;  ///< 0: nobody

  friend bool operator==(const Peer&, const Peer&) = default;
};

/// One thread. Nothing blocks or allocates.
class DatagramPort {
 public:
  DatagramPort() = default;
  DatagramPort(const DatagramPort&) = delete;
  DatagramPort& operator=(const DatagramPort&) = delete;
  virtual ~DatagramPort() = default;

  /// The next datagram, cut to into.size(), and who sent it. 0: none is waiting.
  [[nodiscard]] virtual std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept = 0;
  /// False: there was no room, or the peer is not reachable. A datagram that is sent may be lost all the
  /// same.
  virtual bool send(std::span<const std::uint8_t> bytes, const Peer& to) noexcept = 0;
};

}  // namespace palpate::device
