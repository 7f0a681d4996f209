// A WebSocket text connection in its own thread. It serves devices behind a maker's local service. A TextPeer
// handles texts in that thread and may allocate; the servo's thread never touches the socket.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include <palpate/result.h>

namespace palpate::device {

// One HTTP request to a local service, for device settings before a session. Not for frames.

struct HttpRequest {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::string method = "GET", path = "/";
  std::string body;  ///< JSON; empty: none
};

struct HttpAnswer {
  int status = 0;
  std::string body;  ///< at most 64 KB
};

/// Waits at most 2 s. An Error if nobody answers, or the answer is not HTTP, cut short, or longer.
[[nodiscard]] Result<HttpAnswer> http_request(const HttpRequest& request);

/// Handles one connection's texts, in the link's thread.
class TextPeer {
 public:
  TextPeer() = default;
  TextPeer(const TextPeer&) = delete;
  TextPeer& operator=(const TextPeer&) = delete;
  virtual ~TextPeer() = default;

  virtual void take(std::string_view text) noexcept = 0;
  /// Asked after each text and every millisecond for the next text to send. False: none now.
  virtual bool give(std::string& text) noexcept = 0;
  /// Asked once before closing for the last text. False: none.
  virtual bool last(std::string& text) noexcept = 0;
  virtual void disconnected() noexcept = 0;
};

/// A connection that carries texts; the tests have a simulated one.
class TextLink {
 public:
  TextLink() = default;
  TextLink(const TextLink&) = delete;
  TextLink& operator=(const TextLink&) = delete;
  virtual ~TextLink() = default;

  /// Connects; calls `peer` until close() returns.
  [[nodiscard]] virtual Status open(TextPeer& peer) = 0;
  /// Sends the peer's last text, then closes. Safe at any time and repeatedly.
  virtual void close() noexcept = 0;
};

struct ServiceAddress {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::string path = "/";
};

/// Uses Boost.Beast. open() and close() belong to one thread.
class WebSocketLink final : public TextLink {
 public:
  explicit WebSocketLink(ServiceAddress address);
  ~WebSocketLink() override;

  /// Waits up to 3 s for the connection. An Error says why it failed. Texts longer than kMaxText are dropped.
  [[nodiscard]] Status open(TextPeer& peer) override;
  /// Waits up to 100 ms for the last text to leave.
  void close() noexcept override;

  static constexpr std::size_t kMaxText = 65'536;

 private:
  struct State;
  ServiceAddress address_;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
