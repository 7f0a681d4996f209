// The Inverse3 over real sockets and the real library, against a service that pretends. Nothing here is asked
// to happen within a time of its own: what is waited for comes, or the test fails after a long patience.
#include <libwebsockets.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>

#include <palpate/device/force_governor.h>
#include "device/haply/inverse3_device.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

using nlohmann::json;

/// A service as the Inverse3's maker ships it, as far as its public pages tell, on a port of this machine: a
/// WebSocket server that answers commands with states, settings over HTTP, and faults.
class FakeInverse3Service {
 public:
  enum class Mood { kWell, kNoDevice, kGarbage, kSilent, kStalled };

  explicit FakeInverse3Service(Mood mood) : mood_(mood) {
    static const lws_protocols kProtocols[] = {
        {"fake", &FakeInverse3Service::callback, 0, 4096, 0, nullptr, 0},
        {nullptr, nullptr, 0, 0, 0, nullptr, 0}};
    lws_set_log_level(0, nullptr);
    lws_context_creation_info info{};
    info.port = 0;
    info.iface = "127.0.0.1";
    info.protocols = kProtocols;
    info.gid = -1;
    info.uid = -1;
    info.fd_limit_per_thread = 64;
    info.user = this;
    context_ = lws_create_context(&info);
    if (context_ == nullptr) {
      ADD_FAILURE() << "no server of WebSockets";
      return;
    }
    port_ = lws_get_vhost_listen_port(lws_get_vhost_by_name(context_, "default"));
    thread_ = std::thread([this] {
      while (!ending_.load()) lws_service(context_, 0);
    });
  }
  FakeInverse3Service(const FakeInverse3Service&) = delete;
  FakeInverse3Service& operator=(const FakeInverse3Service&) = delete;
  /// Hangs up on everybody.
  ~FakeInverse3Service() {
    ending_ = true;
    if (context_ != nullptr) lws_cancel_service(context_);
    if (thread_.joinable()) thread_.join();
    if (context_ != nullptr) lws_context_destroy(context_);
  }

  [[nodiscard]] std::uint16_t port() const noexcept { return static_cast<std::uint16_t>(port_); }
  /// From here on.
  void set_mood(Mood mood) noexcept { mood_ = mood; }
  /// What the device holds now: it never lets go by itself.
  [[nodiscard]] Vec3 held_n() const {
    const std::lock_guard lock(mutex_);
    return held_n_;
  }
  [[nodiscard]] std::uint64_t commands() const noexcept { return commands_.load(); }
  /// "METHOD path body" of each, in order.
  [[nodiscard]] std::vector<std::string> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }
  /// Gain of the force gate; below 0: never set.
  [[nodiscard]] double gate() const noexcept { return gate_.load(); }

 private:
  std::string told() const {
    if (mood_.load() == Mood::kGarbage) return "{\"inverse3\": [{\"device_id\": \"04";
    if (mood_.load() == Mood::kNoDevice) return R"({"inverse3":[]})";
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
    if (one.contains("configure")) gate_.store(one["configure"]["force_gate"]["gain"].get<double>());
    if (!one.contains("commands")) return;
    const json& values = one["commands"]["set_cursor_force"]["values"];
    const std::lock_guard lock(mutex_);
    held_n_ = Vec3{values["x"].get<double>(), values["y"].get<double>(), values["z"].get<double>()};
    ++commands_;
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
    const std::lock_guard lock(mutex_);
    requests_.push_back(method + " " + path_ + (body_.empty() ? "" : " " + body_));
  }
  int on(lws* wsi, lws_callback_reasons reason, const char* bytes, std::size_t size) {
    switch (static_cast<int>(reason)) {
      case LWS_CALLBACK_ESTABLISHED:
        owed_ = 1;
        lws_callback_on_writable(wsi);
        return 0;
      case LWS_CALLBACK_RECEIVE:
        heard(std::string(bytes, size));
        // Without commands it would say nothing; so would one that has stalled.
        if (mood_.load() != Mood::kStalled && mood_.load() != Mood::kSilent) owed_ = 1;
        lws_callback_on_writable(wsi);
        return 0;
      case LWS_CALLBACK_SERVER_WRITEABLE: {
        if (mood_.load() == Mood::kSilent || owed_.exchange(0) == 0) return 0;
        const std::string text = told();
        std::vector<unsigned char> out(LWS_PRE + text.size());
        std::memcpy(out.data() + LWS_PRE, text.data(), text.size());
        lws_write(wsi, out.data() + LWS_PRE, text.size(), LWS_WRITE_TEXT);
        return 0;
      }
      case LWS_CALLBACK_HTTP:
        path_.assign(bytes, size);
        body_.clear();
        if (lws_hdr_total_length(wsi, WSI_TOKEN_POST_URI) > 0) return 0;  // its body comes
        note("GET");
        return answer_http(wsi);
      case LWS_CALLBACK_HTTP_BODY:
        body_.append(bytes, size);
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
    auto* const state =
        context != nullptr ? static_cast<FakeInverse3Service*>(lws_context_user(context)) : nullptr;
    return state != nullptr ? state->on(wsi, reason, static_cast<const char*>(in), size) : 0;
  }

  lws_context* context_ = nullptr;
  int port_ = 0;
  std::atomic<Mood> mood_;
  std::atomic<bool> ending_{false};
  std::atomic<std::uint64_t> commands_{0};
  std::atomic<double> gate_{-1.0};
  std::atomic<int> owed_{0};  // states that are to be told
  mutable std::mutex mutex_;
  Vec3 held_n_ = Vec3::Zero();
  std::vector<std::string> requests_;
  std::string path_, body_;
  std::thread thread_;
};

using Mood = FakeInverse3Service::Mood;

struct ServiceRig {
  explicit ServiceRig(Mood mood = Mood::kWell) : service(std::make_unique<FakeInverse3Service>(mood)) {
    Inverse3Options options;
    options.service = {"127.0.0.1", service->port(), "/"};
    options.open_tries = 500;
    device =
        std::make_unique<Inverse3Device>(std::make_unique<WebSocketLink>(options.service), clock, options);
  }
  /// Frames at about 1 kHz with this force wanted.
  void frame(const Vec3& wanted_n) {
    last = device->read();
    device->send(governor->govern(clock.now_s(), last, wanted_n));
    ::usleep(500);
  }
  /// Frames with this force wanted until it is so.
  template <class Condition>
  bool felt_until(const Vec3& wanted_n, const Condition& seen) {
    return comes([&] {
      frame(wanted_n);
      return seen();
    });
  }
  void arm() {
    governor.emplace(ForceGovernor::create(device->limits(), patient_governor()).value());
    governor->arm(clock.now_s());
  }
  MonotonicClock clock;
  std::unique_ptr<FakeInverse3Service> service;
  std::unique_ptr<Inverse3Device> device;
  std::optional<ForceGovernor> governor;
  DeviceState last;
};

TEST(Inverse3Service, IsFeltAndLetGo) {
  ServiceRig rig;
  ASSERT_TRUE(ok(rig.device->open()));
  EXPECT_EQ(rig.service->gate(), 0.3);
  const std::vector<std::string> requests = rig.service->requests();
  ASSERT_GE(requests.size(), 2u);
  EXPECT_EQ(requests[0], R"(POST /inverse3/049D/config/torque_scaling {"enabled":true})");
  EXPECT_EQ(requests[1], "GET /inverse3/049D/config/torque_scaling");
  rig.arm();
  const Vec3 wanted_n{0.5, 0, -0.25};
  EXPECT_TRUE(rig.felt_until(wanted_n, [&] { return (rig.service->held_n() - wanted_n).norm() < 1e-4; }));
  EXPECT_LT((rig.last.position_mm - Vec3{1, 0, 0}).norm(), 1e-9);
  EXPECT_TRUE(rig.felt_until(wanted_n, [&] { return rig.service->commands() > 10; }));
  EXPECT_TRUE(rig.device->cut_force());
  EXPECT_TRUE(comes([&] { return rig.service->held_n().isZero(0.0); })) << "from any thread";
  EXPECT_TRUE(rig.felt_until(wanted_n, [&] { return !rig.service->held_n().isZero(0.0); }));
  rig.device->close();
  EXPECT_TRUE(comes([&] { return rig.service->held_n().isZero(0.0); })) << "closing lets go";
}

TEST(Inverse3Service, OneThatIsNotThereIsSaid) {
  std::uint16_t free_port = 0;
  { free_port = FakeInverse3Service(Mood::kWell).port(); }
  const MonotonicClock clock;
  Inverse3Options options;
  options.service = {"127.0.0.1", free_port, "/"};
  Inverse3Device device(std::make_unique<WebSocketLink>(options.service), clock, options);
  EXPECT_TRUE(refused(device.open(), "no service at ws://127.0.0.1:"));
  EXPECT_EQ(device.read().status, ReadStatus::kLost);
}

TEST(Inverse3Service, NoDeviceGarbageAndSilenceAreSaid) {
  const std::pair<Mood, const char*> cases[] = {
      {Mood::kNoDevice, "no Inverse3"}, {Mood::kGarbage, "not understood"}, {Mood::kSilent, "says nothing"}};
  for (const auto& [mood, said] : cases) {
    ServiceRig rig(mood);
    EXPECT_TRUE(refused(rig.device->open(), said));
  }
}

TEST(Inverse3Service, EveryFaultInASessionIsSeen) {
  ServiceRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.arm();
  const auto comes_to_read = [&](ReadStatus status) {
    return rig.felt_until(Vec3::Zero(), [&] { return rig.last.status == status; });
  };
  EXPECT_TRUE(comes_to_read(ReadStatus::kFresh));
  rig.service->set_mood(Mood::kGarbage);
  EXPECT_TRUE(comes_to_read(ReadStatus::kGarbled));
  rig.service->set_mood(Mood::kWell);
  EXPECT_TRUE(comes_to_read(ReadStatus::kFresh));
  rig.service->set_mood(Mood::kNoDevice);
  EXPECT_TRUE(comes_to_read(ReadStatus::kLost));
  rig.service->set_mood(Mood::kWell);
  EXPECT_TRUE(comes_to_read(ReadStatus::kFresh));
  rig.service->set_mood(Mood::kStalled);
  for (int quiet = 0; quiet < 20; quiet = rig.last.status == ReadStatus::kNothingNew ? quiet + 1 : 0)
    rig.frame(Vec3::Zero());
  rig.service->set_mood(Mood::kWell);
  EXPECT_TRUE(comes_to_read(ReadStatus::kFresh)) << "it is asked again";
  rig.service.reset();
  EXPECT_TRUE(comes_to_read(ReadStatus::kLost)) << "the service is gone";
  EXPECT_FALSE(rig.device->cut_force());
}

TEST(Inverse3Service, OpensAgainAfterTheServiceCameBack) {
  ServiceRig rig;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(rig.device->open()) << i;
    EXPECT_TRUE(comes([&] { return rig.device->read().status == ReadStatus::kFresh; }));
    rig.device->close();
  }
}

TEST(Inverse3Service, TheGuardsHandleOfItsOwnLetsGo) {
  ServiceRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.arm();
  EXPECT_TRUE(rig.felt_until(Vec3{0.5, 0, 0}, [&] { return rig.service->held_n().x() > 0.4; }));
  const auto made =
      driver_of(&register_inverse3_driver, "inverse3")
          .make({"inverse3", {}, {{"service", "127.0.0.1:" + std::to_string(rig.service->port())}}},
                rig.clock);
  ASSERT_TRUE(made);
  // It gives up after 0.3 s, which is short on a busy machine.
  EXPECT_TRUE(comes([&] { return made->zero(); }));
}

}  // namespace
}  // namespace palpate::device
