// UDP datagrams: the link to a device at another machine, and the port that serves one.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include <palpate/device/link.h>

namespace palpate::device {

// A port that receives datagrams from several peers and answers them, to serve a device to other machines.
// UDP: udp_link.h; tests simulate a network.

/// Sender of a datagram: a socket address (IPv4 or IPv6), compared byte by byte.
struct Peer {
  static constexpr std::size_t kMost = 28;  ///< of sockaddr_in6
  std::array<std::uint8_t, kMost> bytes{};
  std::uint8_t size = 0;  ///< 0: nobody

  friend bool operator==(const Peer&, const Peer&) = default;
};

/// For one thread. No call blocks or allocates.
class DatagramPort {
 public:
  DatagramPort() = default;
  DatagramPort(const DatagramPort&) = delete;
  DatagramPort& operator=(const DatagramPort&) = delete;
  virtual ~DatagramPort() = default;

  /// Gives the next datagram, cut to into.size(), and its sender. 0: none is waiting.
  [[nodiscard]] virtual std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept = 0;
  /// False: no buffer space, or the peer is unreachable. A sent datagram may still be lost.
  virtual bool send(std::span<const std::uint8_t> bytes, const Peer& to) noexcept = 0;
};

struct UdpAddress {
  std::string host;
  std::uint16_t port = 0;

  /// Parses "HOST:PORT"; IPv6 addresses need brackets, "[::1]:47800". An Error says what is wrong.
  [[nodiscard]] static Result<UdpAddress> of(const std::string& text);
  [[nodiscard]] std::string text() const;
};

/// Each poll gives one datagram, cut to into.size(); the kernel drops those from other addresses. Any thread
/// may call submit(), also after close(): the first open() makes the socket, which lives as long as the link.
/// Lost datagrams are not resent.
class UdpLink final : public Link {
 public:
  explicit UdpLink(UdpAddress address) : address_(std::move(address)) {}
  ~UdpLink() override;

  /// Resolves the host's address, which may take seconds. Sends nothing, so an absent peer goes unnoticed.
  [[nodiscard]] Status open() override;
  /// Stops receiving; the next open() discards waiting datagrams.
  void close() noexcept override { open_ = false; }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// `gone` if the other machine reports that nobody listens.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

 private:
  UdpAddress address_;
  std::atomic<int> socket_{-1};
  bool open_ = false;
};

class UdpPort final : public DatagramPort {
 public:
  explicit UdpPort(UdpAddress address) : address_(std::move(address)) {}
  ~UdpPort() override;

  /// Listens at one local address; port 0: the system chooses, see address(). An Error if the port is taken
  /// or the address is not local.
  [[nodiscard]] Status open();
  [[nodiscard]] const UdpAddress& address() const noexcept { return address_; }

  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept override;
  bool send(std::span<const std::uint8_t> bytes, const Peer& to) noexcept override;

 private:
  UdpAddress address_;
  int socket_ = -1;
};

}  // namespace palpate::device
