// The Inverse3 over real sockets and the real library, against a service that pretends. Nothing here is asked
// to happen within a time of its own: what is waited for comes, or the test fails after a long patience.
#include <gtest/gtest.h>

#include <unistd.h>

#include "device/haply/inverse3_device.h"
#include "device/haply/inverse3_driver.h"
#include "device/interface/force_governor.h"
#include "tests/device/fake_inverse3_service.h"

namespace palpate::device {
namespace {

using Mood = FakeInverse3Service::Mood;

/// Until it is so; false after 20 s.
template <class Condition>
bool comes(const Condition& condition) {
  const Stopwatch watch;
  constexpr double kPatienceMs = 20'000.0;
  while (!condition()) {
    if (watch.ms() > kPatienceMs) return false;
    ::usleep(500);
  }
  return true;
}

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
  void arm() {
    GovernorOptions patient;  // the machine may be busy: what is tested here is not its speed
    patient.late_zero_s = patient.latch_late_s = patient.silence_s = 20.0;
    patient.soft_start_s = 0.05;
    governor.emplace(ForceGovernor::create(device->limits(), patient).value());
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
  const Status opened = rig.device->open();
  ASSERT_TRUE(opened) << opened.error().message();
  EXPECT_EQ(rig.service->gate(), 0.3);
  const std::vector<std::string> requests = rig.service->requests();
  ASSERT_GE(requests.size(), 2u);
  EXPECT_EQ(requests[0], R"(POST /inverse3/049D/config/torque_scaling {"enabled":true})");
  EXPECT_EQ(requests[1], "GET /inverse3/049D/config/torque_scaling");
  rig.arm();
  EXPECT_TRUE(comes([&] {
    rig.frame(Vec3{0.5, 0, -0.25});
    return (rig.service->held_n() - Vec3{0.5, 0, -0.25}).norm() < 1e-4;
  }));
  EXPECT_LT((rig.last.position_mm - Vec3{1, 0, 0}).norm(), 1e-9);
  EXPECT_TRUE(comes([&] {
    rig.frame(Vec3{0.5, 0, -0.25});
    return rig.service->commands() > 10;
  }));
  EXPECT_TRUE(rig.device->cut_force());
  EXPECT_TRUE(comes([&] { return rig.service->held_n().isZero(0.0); })) << "from any thread";
  EXPECT_TRUE(comes([&] {
    rig.frame(Vec3{0.5, 0, -0.25});
    return !rig.service->held_n().isZero(0.0);
  }));
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
  const Status opened = device.open();
  ASSERT_FALSE(opened);
  EXPECT_NE(opened.error().message().find("no service at ws://127.0.0.1:"), std::string::npos)
      << opened.error().message();
  EXPECT_EQ(device.read().status, ReadStatus::kLost);
}

TEST(Inverse3Service, NoDeviceGarbageAndSilenceAreSaid) {
  const std::pair<Mood, const char*> cases[] = {
      {Mood::kNoDevice, "no Inverse3"}, {Mood::kGarbage, "not understood"}, {Mood::kSilent, "says nothing"}};
  for (const auto& [mood, says] : cases) {
    ServiceRig rig(mood);
    const Status opened = rig.device->open();
    ASSERT_FALSE(opened) << says;
    EXPECT_NE(opened.error().message().find(says), std::string::npos) << opened.error().message();
  }
}

TEST(Inverse3Service, EveryFaultInASessionIsSeen) {
  ServiceRig rig;
  ASSERT_TRUE(rig.device->open());
  rig.arm();
  const auto comes_to_read = [&](ReadStatus status) {
    return comes([&] {
      rig.frame(Vec3::Zero());
      return rig.last.status == status;
    });
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
  EXPECT_TRUE(comes([&] {
    rig.frame(Vec3{0.5, 0, 0});
    return rig.service->held_n().x() > 0.4;
  }));
  Drivers drivers;
  register_inverse3_driver(drivers);
  const auto made =
      drivers.of("inverse3")
          ->make({"inverse3", {}, {{"service", "127.0.0.1:" + std::to_string(rig.service->port())}}},
                 rig.clock);
  ASSERT_TRUE(made);
  // It gives up after 0.3 s, which is short on a busy machine.
  EXPECT_TRUE(comes([&] { return made->zero(); }));
}

}  // namespace
}  // namespace palpate::device
