#include "device/links/service_link.h"

#include <libwebsockets.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <thread>
#include <vector>

namespace palpate::device {
namespace {

constexpr lws_usec_t kAskEveryUs = 1000;  // polls the peer for unsolicited texts
constexpr std::chrono::seconds kConnectPatience{3};
constexpr std::chrono::milliseconds kLastPatience{100};
constexpr int kLwsGoOn = 0, kLwsClose = -1;
// A few sockets suffice; unbounded, the library allocates for every file a process may open.
constexpr unsigned kMaxSockets = 16;

}  // namespace

/// Used only by the link's thread while it runs, except atomic and locked members.
struct WebSocketLink::State {
  /// The library hands back a pointer to the first member.
  struct Timer {
    lws_sorted_usec_list_t list;
    State* owner;
  };
  Timer timer{{}, this};
  TextPeer* peer = nullptr;
  lws_context* context = nullptr;
  lws* socket = nullptr;
  std::string text;                // fragments so far
  bool too_long = false;           // the message is discarded
  std::vector<unsigned char> out;  // the library's prefix, then the text
  std::string outgoing;
  bool last_sent = false;
  std::atomic<bool> ending{false};
  std::thread thread;

  std::mutex mutex;  // guards the result that open() waits for
  std::condition_variable changed;
  enum class Connection { kTrying, kMade, kFailed } connection = Connection::kTrying;
  std::string why;

  void settle(Connection to, std::string reason) {
    const std::lock_guard lock(mutex);
    if (connection != Connection::kTrying) return;
    connection = to;
    why = std::move(reason);
    changed.notify_all();
  }
  void receive(lws* wsi, const char* bytes, std::size_t size) {
    if (lws_is_first_fragment(wsi) != 0) {
      text.clear();
      too_long = false;
    }
    too_long = too_long || text.size() + size > kMaxText;
    if (!too_long) text.append(bytes, size);
    if (lws_is_final_fragment(wsi) == 0 || lws_remaining_packet_payload(wsi) != 0) return;
    if (!too_long) peer->take(text);
    lws_callback_on_writable(wsi);
  }
  int write(lws* wsi) {
    const bool is_last = ending.load();
    if (is_last && last_sent) return kLwsClose;
    if (!(is_last ? peer->last(outgoing) : peer->give(outgoing))) return is_last ? kLwsClose : kLwsGoOn;
    last_sent = is_last;
    out.resize(LWS_PRE + outgoing.size());
    std::memcpy(out.data() + LWS_PRE, outgoing.data(), outgoing.size());
    const int written = lws_write(wsi, out.data() + LWS_PRE, outgoing.size(), LWS_WRITE_TEXT);
    if (written < static_cast<int>(outgoing.size())) return kLwsClose;
    // The library may hold part of it: closes at the next writable callback.
    if (is_last) lws_callback_on_writable(wsi);
    return kLwsGoOn;
  }
  static void asked(lws_sorted_usec_list_t* list);
  [[nodiscard]] bool connect(const ServiceAddress& address);
  void run();
  static int callback(lws* wsi, lws_callback_reasons reason, void* user, void* in, std::size_t size);
};

int WebSocketLink::State::callback(lws* wsi, lws_callback_reasons reason, void* /*user*/, void* in,
                                   std::size_t size) {
  auto* const state = static_cast<State*>(lws_context_user(lws_get_context(wsi)));
  if (state == nullptr) return kLwsGoOn;
  const auto* const bytes = static_cast<const char*>(in);
  // The library has more reasons than a text client needs.
  // NOLINTNEXTLINE(clang-diagnostic-switch-enum)
  switch (static_cast<int>(reason)) {
    case LWS_CALLBACK_CLIENT_ESTABLISHED:
      state->settle(Connection::kMade, {});
      lws_callback_on_writable(wsi);
      return kLwsGoOn;
    case LWS_CALLBACK_CLIENT_RECEIVE:
      state->receive(wsi, bytes, size);
      return kLwsGoOn;
    case LWS_CALLBACK_CLIENT_WRITEABLE:
      return state->write(wsi);
    case LWS_CALLBACK_CLIENT_CONNECTION_ERROR:
      state->socket = nullptr;
      state->settle(Connection::kFailed, bytes != nullptr ? std::string(bytes, size) : "refused");
      state->peer->disconnected();
      return kLwsGoOn;
    case LWS_CALLBACK_CLIENT_CLOSED:
      state->socket = nullptr;
      state->peer->disconnected();
      return kLwsGoOn;
    default:
      return kLwsGoOn;
  }
}

void WebSocketLink::State::asked(lws_sorted_usec_list_t* list) {
  State& state = *reinterpret_cast<Timer*>(list)->owner;
  if (state.socket != nullptr) lws_callback_on_writable(state.socket);
  lws_sul_schedule(state.context, 0, list, &asked, kAskEveryUs);
}

bool WebSocketLink::State::connect(const ServiceAddress& address) {
  static const lws_protocols kProtocols[] = {{"texts", &State::callback, 0, 4096, 0, nullptr, 0},
                                             {nullptr, nullptr, 0, 0, 0, nullptr, 0}};
  lws_set_log_level(0, nullptr);
  lws_context_creation_info info{};
  info.port = CONTEXT_PORT_NO_LISTEN;
  info.protocols = kProtocols;
  info.gid = -1;
  info.uid = -1;
  info.fd_limit_per_thread = kMaxSockets;
  info.user = this;
  context = lws_create_context(&info);
  if (context == nullptr) return false;
  lws_client_connect_info to{};
  to.context = context;
  to.address = address.host.c_str();
  to.port = address.port;
  to.path = address.path.c_str();
  to.host = to.address;
  to.origin = to.address;
  to.protocol = nullptr;
  to.local_protocol_name = kProtocols[0].name;
  // Set by the library before any callback; cleared here by the callback that ends the connection.
  to.pwsi = &socket;
  return lws_client_connect_via_info(&to) != nullptr;
}

void WebSocketLink::State::run() {
  const auto never = std::chrono::steady_clock::time_point::max();
  auto until = never;
  lws_sul_schedule(context, 0, &timer.list, &asked, kAskEveryUs);
  while (socket != nullptr && std::chrono::steady_clock::now() < until) {
    if (ending.load() && until == never) until = std::chrono::steady_clock::now() + kLastPatience;
    lws_service(context, 0);
  }
}

WebSocketLink::WebSocketLink(ServiceAddress address) : address_(std::move(address)) {}

WebSocketLink::~WebSocketLink() {
  close();
}

Status WebSocketLink::open(TextPeer& peer) {
  close();
  state_ = std::make_unique<State>();
  State& state = *state_;
  state.peer = &peer;
  state.thread = std::thread([this, &state] {
    if (state.connect(address_)) state.run();
    state.settle(State::Connection::kFailed, "the connection could not be begun");
    if (state.context != nullptr) lws_context_destroy(state.context);
  });
  std::string why;
  {
    std::unique_lock lock(state.mutex);
    const bool told = state.changed.wait_for(lock, kConnectPatience,
                                             [&] { return state.connection != State::Connection::kTrying; });
    if (told && state.connection == State::Connection::kMade) return Done{};
    why = told ? state.why : "no answer in 3 s";
  }
  close();
  return Error{"no service at ws://" + address_.host + ":" + std::to_string(address_.port) + address_.path +
                   " (" + why + ")",
               "start the maker's service, or name its host and port"};
}

void WebSocketLink::close() noexcept {
  if (!state_) return;
  state_->ending.store(true);
  if (state_->thread.joinable()) state_->thread.join();
  state_.reset();
}

}  // namespace palpate::device
