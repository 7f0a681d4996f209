#include "device/links/service_link.h"

#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <thread>
#include <utility>

namespace palpate::device {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using Failure = boost::system::error_code;

constexpr std::chrono::seconds kHttpPatience{2}, kConnectPatience{3};
constexpr std::chrono::milliseconds kAskEvery{1};  // the peer, for unsolicited texts
constexpr std::chrono::milliseconds kLastPatience{100};
constexpr std::uint64_t kMaxAnswer = 65'536;

/// Runs what `begin` begins to its end, or the socket's time limit.
template <class Begin>
Failure finish(asio::io_context& io, const Begin& begin) {
  Failure failed;
  begin([&failed](Failure why, const auto&...) { failed = why; });
  io.restart();
  io.run();
  return failed;
}

Failure connect(asio::io_context& io, beast::tcp_stream& socket, const std::string& host, std::uint16_t port,
                std::chrono::seconds patience) {
  Failure failed;
  const auto found = asio::ip::tcp::resolver(io).resolve(host, std::to_string(port), failed);
  if (failed) return failed;
  socket.expires_after(patience);
  return finish(io, [&](auto then) { socket.async_connect(found, then); });
}

std::string why(Failure failed, std::chrono::seconds patience) {
  return failed == beast::error::timeout ? "no answer in " + std::to_string(patience.count()) + " s"
                                         : failed.message();
}

constexpr const char* kServiceRemedy = "start the maker's service, or name its host and port";

}  // namespace

Result<HttpAnswer> http_request(const HttpRequest& request) {
  constexpr unsigned kHttp11 = 11;
  const std::string host = request.host + ":" + std::to_string(request.port);
  http::request<http::string_body> asked(http::string_to_verb(request.method), request.path, kHttp11,
                                         request.body);
  asked.set(http::field::host, host);
  asked.set(http::field::accept, "application/json");
  if (!request.body.empty()) asked.set(http::field::content_type, "application/json");
  asked.keep_alive(false);
  asked.prepare_payload();
  http::response_parser<http::string_body> answer;
  answer.body_limit(kMaxAnswer);
  beast::flat_buffer buffer;
  asio::io_context io;
  beast::tcp_stream socket(io);
  Failure failed = connect(io, socket, request.host, request.port, kHttpPatience);
  if (!failed) failed = finish(io, [&](auto then) { http::async_write(socket, asked, then); });
  if (!failed) failed = finish(io, [&](auto then) { http::async_read(socket, buffer, answer, then); });
  if (failed)
    return Error{"no answer from http://" + host + request.path + ": " + why(failed, kHttpPatience),
                 kServiceRemedy};
  return HttpAnswer{static_cast<int>(answer.get().result_int()), answer.get().body()};
}

/// Used only by the link's thread while it runs, except `ending`.
struct WebSocketLink::State {
  explicit State(TextPeer& to) : peer(to) {}

  TextPeer& peer;
  asio::io_context io;
  beast::websocket::stream<beast::tcp_stream> socket{io};
  beast::flat_buffer in;
  bool too_long = false;  // the message is discarded
  std::string out;
  bool writing = false;
  std::atomic<bool> ending{false};
  std::thread thread;

  /// Reads until the service hangs up.
  void read() {
    // Without a limit room is made for all that a frame announces, up to 2^63 bytes.
    constexpr std::size_t kPiece = 4096;
    socket.async_read_some(in, kPiece, [this](Failure failed, std::size_t) {
      if (failed) return;
      too_long = too_long || in.size() > kMaxText;
      if (socket.is_message_done() && !std::exchange(too_long, false)) {
        peer.take({static_cast<const char*>(in.data().data()), in.size()});
        in.clear();
        ask();
      } else if (too_long || socket.is_message_done()) {
        in.clear();
      }
      read();
    });
  }
  /// Not once it ends: nothing may follow the last text, nor take its turn.
  void ask() {
    if (writing || ending.load() || !peer.give(out)) return;
    writing = true;
    socket.async_write(asio::buffer(out), [this](Failure, std::size_t) { writing = false; });
  }
  void run() {
    io.restart();
    read();
    while (!ending.load() && !io.stopped()) {
      ask();
      io.run_for(kAskEvery);
    }
    const auto until = std::chrono::steady_clock::now() + kLastPatience;
    while (writing && io.run_one_until(until) > 0) {
    }
    if (!writing && !io.stopped() && peer.last(out)) {
      socket.async_write(asio::buffer(out), [this](Failure, std::size_t) {
        socket.async_close(beast::websocket::close_code::normal, [](Failure) {});
      });
      io.run_until(until);
    }
    peer.disconnected();
  }
};

WebSocketLink::WebSocketLink(ServiceAddress address) : address_(std::move(address)) {}

WebSocketLink::~WebSocketLink() {
  close();
}

Status WebSocketLink::open(TextPeer& peer) {
  close();
  auto state = std::make_unique<State>(peer);
  const std::string host = address_.host + ":" + std::to_string(address_.port);
  beast::tcp_stream& tcp = beast::get_lowest_layer(state->socket);
  Failure failed = connect(state->io, tcp, address_.host, address_.port, kConnectPatience);
  // Else a command waits until the service has confirmed the one before, 40 ms in the worst case.
  if (!failed) tcp.socket().set_option(asio::ip::tcp::no_delay(true), failed);
  if (!failed)
    failed = finish(state->io,
                    [&](auto then) { state->socket.async_handshake(host, address_.path, std::move(then)); });
  if (failed) {
    peer.disconnected();
    return Error{"no service at ws://" + host + address_.path + " (" + why(failed, kConnectPatience) + ")",
                 kServiceRemedy};
  }
  tcp.expires_never();
  state->socket.read_message_max(0);  // longer ones are dropped, and the connection kept
  state_ = std::move(state);
  state_->thread = std::thread([raw = state_.get()] { raw->run(); });
  return Done{};
}

void WebSocketLink::close() noexcept {
  if (!state_) return;
  state_->ending.store(true);
  if (state_->thread.joinable()) state_->thread.join();
  state_.reset();
}

}  // namespace palpate::device
