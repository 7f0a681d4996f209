#include "tests/device/fake_inverse3_service.h"

#include <gtest/gtest.h>
#include <libwebsockets.h>

#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

namespace palpate::device {

using nlohmann::json;

struct FakeInverse3Service::State {
  lws_context* context = nullptr;
  int port = 0;
  std::atomic<Mood> mood{Mood::kWell};
  std::atomic<bool> ending{false};
  std::atomic<std::uint64_t> commands{0};
  std::atomic<double> gate{-1.0};
  std::atomic<int> owed{0};  // states that are to be told
  mutable std::mutex mutex;
  Vec3 held_n = Vec3::Zero();
  std::vector<std::string> requests;
  std::string path, body;
  std::thread thread;

  std::string told() const {
    if (mood.load() == Mood::kGarbage) return "{\"inverse3\": [{\"device_id\": \"04";
    if (mood.load() == Mood::kNoDevice) return R"({"inverse3":[]})";
    return json{{"inverse3",
                 {{{"device_id", "049D"},
                   {"config", {{"torque_scaling", {{"enabled", true}}}}},
                   {"state", {{"cursor_position", {{"x", 0.001}, {"y", -0.1}, {"z", 0.2}}}}}}}}}
        .dump();
  }
  void heard(const std::string& text) {
    const json command = json::parse(text, nullptr, false);
    if (!command.is_object()) return;
    const json& one = command["inverse3"][0];
    if (one.contains("configure")) gate.store(one["configure"]["force_gate"]["gain"].get<double>());
    if (!one.contains("commands")) return;
    const json& values = one["commands"]["set_cursor_force"]["values"];
    const std::lock_guard lock(mutex);
    held_n = Vec3{values["x"].get<double>(), values["y"].get<double>(), values["z"].get<double>()};
    ++commands;
  }
  int answer_http(lws* wsi) {
    std::array<unsigned char, LWS_PRE + 1024> buffer;
    unsigned char *at = buffer.data() + LWS_PRE, *begin = at, *end = buffer.data() + buffer.size();
    const std::string text = R"({"enabled":false})";
    if (lws_add_http_common_headers(wsi, HTTP_STATUS_OK, "application/json", text.size(), &at, end) != 0 ||
        lws_finalize_write_http_header(wsi, begin, &at, end) != 0)
      return 1;
    std::memcpy(begin, text.data(), text.size());
    lws_write(wsi, begin, text.size(), LWS_WRITE_HTTP_FINAL);
    return lws_http_transaction_completed(wsi) != 0 ? -1 : 0;
  }
  void note(const std::string& method) {
    const std::lock_guard lock(mutex);
    requests.push_back(method + " " + path + (body.empty() ? "" : " " + body));
  }
  int on(lws* wsi, lws_callback_reasons reason, const char* bytes, std::size_t size) {
    switch (static_cast<int>(reason)) {
      case LWS_CALLBACK_ESTABLISHED:
        owed = 1;
        lws_callback_on_writable(wsi);
        return 0;
      case LWS_CALLBACK_RECEIVE:
        heard(std::string(bytes, size));
        // Without commands it would say nothing; so would one that has stalled.
        if (mood.load() != Mood::kStalled && mood.load() != Mood::kSilent) owed = 1;
        lws_callback_on_writable(wsi);
        return 0;
      case LWS_CALLBACK_SERVER_WRITEABLE: {
        if (mood.load() == Mood::kSilent || owed.exchange(0) == 0) return 0;
        const std::string text = told();
        std::vector<unsigned char> out(LWS_PRE + text.size());
        std::memcpy(out.data() + LWS_PRE, text.data(), text.size());
        lws_write(wsi, out.data() + LWS_PRE, text.size(), LWS_WRITE_TEXT);
        return 0;
      }
      case LWS_CALLBACK_HTTP:
        path.assign(bytes, size);
        body.clear();
        if (lws_hdr_total_length(wsi, WSI_TOKEN_POST_URI) > 0) return 0;  // its body comes
        note("GET");
        return answer_http(wsi);
      case LWS_CALLBACK_HTTP_BODY:
        body.append(bytes, size);
        return 0;
      case LWS_CALLBACK_HTTP_BODY_COMPLETION:
        note("POST");
        return answer_http(wsi);
      default:
        return lws_callback_http_dummy(wsi, reason, nullptr, const_cast<char*>(bytes), size);
    }
  }
  static int callback(lws* wsi, lws_callback_reasons reason, void* /*user*/, void* in, std::size_t size) {
    lws_context* const context = lws_get_context(wsi);
    auto* const state = context != nullptr ? static_cast<State*>(lws_context_user(context)) : nullptr;
    return state != nullptr ? state->on(wsi, reason, static_cast<const char*>(in), size) : 0;
  }
};

FakeInverse3Service::FakeInverse3Service(Mood mood) : state_(std::make_unique<State>()) {
  static const lws_protocols kProtocols[] = {{"fake", &State::callback, 0, 4096, 0, nullptr, 0},
                                             {nullptr, nullptr, 0, 0, 0, nullptr, 0}};
  state_->mood = mood;
  lws_set_log_level(0, nullptr);
  lws_context_creation_info info{};
  info.port = 0;
  info.iface = "127.0.0.1";
  info.protocols = kProtocols;
  info.gid = -1;
  info.uid = -1;
  info.fd_limit_per_thread = 64;
  info.user = state_.get();
  state_->context = lws_create_context(&info);
  if (state_->context == nullptr) {
    ADD_FAILURE() << "no server of WebSockets";
    return;
  }
  state_->port = lws_get_vhost_listen_port(lws_get_vhost_by_name(state_->context, "default"));
  state_->thread = std::thread([state = state_.get()] {
    while (!state->ending.load()) lws_service(state->context, 0);
  });
}

FakeInverse3Service::~FakeInverse3Service() {
  state_->ending = true;
  if (state_->context != nullptr) lws_cancel_service(state_->context);
  if (state_->thread.joinable()) state_->thread.join();
  if (state_->context != nullptr) lws_context_destroy(state_->context);
}

std::uint16_t FakeInverse3Service::port() const noexcept {
  return static_cast<std::uint16_t>(state_->port);
}

void FakeInverse3Service::set_mood(Mood mood) noexcept {
  state_->mood = mood;
}

Vec3 FakeInverse3Service::held_n() const {
  const std::lock_guard lock(state_->mutex);
  return state_->held_n;
}

std::uint64_t FakeInverse3Service::commands() const noexcept {
  return state_->commands.load();
}

std::vector<std::string> FakeInverse3Service::requests() const {
  const std::lock_guard lock(state_->mutex);
  return state_->requests;
}

double FakeInverse3Service::gate() const noexcept {
  return state_->gate.load();
}

}  // namespace palpate::device
