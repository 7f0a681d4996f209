// The Inverse3 over real sockets and the real library, against a service that pretends. Nothing here is asked
// to happen within a time of its own: what is waited for comes, or the test fails after a long patience.
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <mutex>
#include <nlohmann/json.hpp>

#include <palpate/device/force_governor.h>
#include "device/haply/inverse3_device.h"
#include "tests/device/helpers.h"

namespace palpate::device {
namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;
using boost::asio::ip::tcp;
using nlohmann::json;

/// A service as the Inverse3's maker ships it, as far as its public pages tell, on a port of this machine: a
/// WebSocket server that answers commands with states, settings over HTTP, and faults. A thread a connection.
class FakeInverse3Service {
 public:
  enum class Mood { kWell, kNoDevice, kGarbage, kSilent, kStalled, kEndless };

  explicit FakeInverse3Service(Mood mood) : mood_(mood), listener_([this] { listen(); }) {}
  FakeInverse3Service(const FakeInverse3Service&) = delete;
  FakeInverse3Service& operator=(const FakeInverse3Service&) = delete;
  /// Hangs up on everybody.
  ~FakeInverse3Service() {
    ::shutdown(acceptor_.native_handle(), SHUT_RDWR);
    listener_.join();
    for (const int own : descriptors_) ::shutdown(own, SHUT_RDWR);
    for (std::thread& one : talks_) one.join();
    for (const int own : descriptors_) ::close(own);
  }

  [[nodiscard]] std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
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
  void listen() {
    for (;;) {
      boost::system::error_code failed;
      auto socket = std::make_unique<tcp::socket>(io_);
      acceptor_.accept(*socket, failed);
      if (failed) return;
      descriptors_.push_back(::dup(socket->native_handle()));
      talks_.emplace_back([this, raw = socket.get()] { talk(*raw); });
      sockets_.push_back(std::move(socket));
    }
  }
  void talk(tcp::socket& socket) {
    boost::system::error_code failed;
    beast::flat_buffer buffer;
    http::request<http::string_body> asked;
    http::read(socket, buffer, asked, failed);
    if (failed) return;
    if (!beast::websocket::is_upgrade(asked)) return answer(socket, asked);
    beast::websocket::stream<tcp::socket&> web(socket);
    web.accept(asked, failed);
    // A text of 2^62 bytes, of which one comes.
    if (!failed && mood_.load() == Mood::kEndless)
      boost::asio::write(socket, boost::asio::buffer(std::string("\x81\x7f\x40\0\0\0\0\0\0\0{", 11)), failed);
    for (bool owes = true; !failed;) {
      const Mood mood = mood_.load();
      if (owes && mood != Mood::kSilent && mood != Mood::kEndless)
        web.write(boost::asio::buffer(told()), failed);
      buffer.clear();
      if (!failed) web.read(buffer, failed);
      if (!failed) heard(beast::buffers_to_string(buffer.data()));
      // Without commands it would say nothing; so would one that has stalled.
      owes = mood_.load() != Mood::kStalled;
    }
  }
  void answer(tcp::socket& socket, const http::request<http::string_body>& asked) {
    {
      const std::lock_guard lock(mutex_);
      requests_.push_back(std::string(asked.method_string()) + " " + std::string(asked.target()) +
                          (asked.body().empty() ? "" : " " + asked.body()));
    }
    http::response<http::string_body> answer(http::status::ok, 11, R"({"enabled":false})");
    answer.prepare_payload();
    boost::system::error_code failed;
    http::write(socket, answer, failed);
  }

  boost::asio::io_context io_;
  tcp::acceptor acceptor_{io_, {boost::asio::ip::address_v4::loopback(), 0}};
  std::atomic<Mood> mood_;
  std::atomic<std::uint64_t> commands_{0};
  std::atomic<double> gate_{-1.0};
  mutable std::mutex mutex_;
  Vec3 held_n_ = Vec3::Zero();
  std::vector<std::string> requests_;
  std::vector<int> descriptors_;                       // of the sockets, which belong to their threads
  std::vector<std::unique_ptr<tcp::socket>> sockets_;  // this and the next: the listener's
  std::vector<std::thread> talks_;
  std::thread listener_;
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

TEST(Inverse3Service, HttpSaysItsAnswerOrWhyThereIsNone) {
  std::uint16_t port = 0;
  {
    const FakeInverse3Service service(Mood::kWell);
    port = service.port();
    const Result<HttpAnswer> answer = http_request({"127.0.0.1", port, "GET", "/", {}});
    ASSERT_TRUE(ok(answer));
    EXPECT_EQ(answer->status, 200);
    EXPECT_EQ(answer->body, R"({"enabled":false})");
  }
  EXPECT_TRUE(refused(http_request({"127.0.0.1", port, "GET", "/", {}}), "no answer from http://127.0.0.1:"));
}

TEST(Inverse3Service, NoDeviceGarbageAndSilenceAreSaid) {
  const std::pair<Mood, const char*> cases[] = {{Mood::kNoDevice, "no Inverse3"},
                                                {Mood::kGarbage, "not understood"},
                                                {Mood::kSilent, "says nothing"},
                                                {Mood::kEndless, "says nothing"}};
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
      value_of(driver_of(&register_inverse3_driver, "inverse3")
                   .make({"inverse3", {}, {{"service", "127.0.0.1:" + std::to_string(rig.service->port())}}},
                         rig.clock));
  // It gives up after 0.3 s, which is short on a busy machine.
  EXPECT_TRUE(comes([&] { return made.zero(); }));
}

}  // namespace
}  // namespace palpate::device
