// Datagrams over UDP: the link of a device that stands at another machine, and the port that serves one.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "device/interface/link.h"
#include "device/links/datagram_port.h"

namespace palpate::device {

/// A host's name or address, and a port.
struct UdpAddress {
  std::string host;
  std::uint16_t port = 0;

  /// Of "HOST:PORT"; an IPv6 address stands in brackets, "[::1]:47800". An Error says what is not right.
  [[nodiscard]] static Result<UdpAddress> of(const std::string& text);
  [[nodiscard]] std::string text() const;
};

/// One poll gives one datagram, whole; what is longer than `into` is cut. The kernel drops what comes from
/// another address. submit may be called by any thread, also after close(): the socket is made by the first
/// open() and lives as long as the link. Nothing in it retries: datagrams may be lost.
class UdpLink final : public Link {
 public:
  explicit UdpLink(UdpAddress address) : address_(std::move(address)) {}
  ~UdpLink() override;

  /// Finds the host's address, which may take seconds. Sends nothing, so it does not know whether anybody is
  /// there.
  [[nodiscard]] Status open() override;
  /// From here on nothing is received; what waits is thrown away by the next open().
  void close() noexcept override { open_ = false; }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override;
  /// `gone` where the other machine answers that nobody listens there.
  [[nodiscard]] Polled poll(std::span<std::uint8_t> into) noexcept override;

 private:
  UdpAddress address_;
  std::atomic<int> socket_{-1};
  bool open_ = false;
};

/// A port of this machine.
class UdpPort final : public DatagramPort {
 public:
  explicit UdpPort(UdpAddress address) : address_(std::move(address)) {}
  ~UdpPort() override;

  /// Listens at one address of this machine; port 0: the system chooses one, see address(). An Error where
  /// the port is taken or the address is not this machine's.
  [[nodiscard]] Status open();
  [[nodiscard]] const UdpAddress& address() const noexcept { return address_; }

  [[nodiscard]] std::size_t receive(std::span<std::uint8_t> into, Peer& from) noexcept override;
  bool send(std::span<const std::uint8_t> bytes, const Peer& to) noexcept override;

 private:
  UdpAddress address_;
  int socket_ = -1;
};

}  // namespace palpate::device
