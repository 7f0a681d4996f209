// Texts over a WebSocket, in a thread of its own: for devices behind a local service of their maker. What
// happens to the texts is the business of a TextPeer, which runs in that thread and may parse and allocate;
// the servo's thread never meets the socket.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "toolkit/core/result.h"

namespace palpate::device {

/// What is done with the texts of one connection. Every call comes from the link's thread.
class TextPeer {
 public:
  TextPeer() = default;
  TextPeer(const TextPeer&) = delete;
  TextPeer& operator=(const TextPeer&) = delete;
  virtual ~TextPeer() = default;

  /// A whole text.
  virtual void take(std::string_view text) noexcept = 0;
  /// Asked after each text and every millisecond: the next one to send. False: none now.
  virtual bool give(std::string& text) noexcept = 0;
  /// Before the link closes, once: the last text. False: none.
  virtual bool last(std::string& text) noexcept = 0;
  /// The other side is gone.
  virtual void disconnected() noexcept = 0;
};

/// A connection that carries texts; a pretended one in the tests.
class TextLink {
 public:
  TextLink() = default;
  TextLink(const TextLink&) = delete;
  TextLink& operator=(const TextLink&) = delete;
  virtual ~TextLink() = default;

  /// Connects; `peer` is called until close() returns.
  [[nodiscard]] virtual Status open(TextPeer& peer) = 0;
  /// Sends the peer's last text, then ends. Safe at any time, twice too.
  virtual void close() noexcept = 0;
};

struct ServiceAddress {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::string path = "/";
};

/// Over libwebsockets. One thread opens and closes.
class WebSocketLink final : public TextLink {
 public:
  explicit WebSocketLink(ServiceAddress address);
  ~WebSocketLink() override;

  /// Waits up to 3 s for the connection. An Error says why there is none. Texts of over kMostText are
  /// dropped.
  [[nodiscard]] Status open(TextPeer& peer) override;
  /// Waits up to 100 ms for the last text to leave.
  void close() noexcept override;

  static constexpr std::size_t kMostText = 65'536;

 private:
  struct State;
  ServiceAddress address_;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
