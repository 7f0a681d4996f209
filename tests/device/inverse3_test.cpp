// The Inverse3 without a service: texts, and the device over a pretended connection.
#include "device/haply/inverse3_device.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include <palpate/device/force_governor.h>
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "toolkit/core/random.h"

extern "C" int palpate_fuzz_inverse3(const std::uint8_t* data,
                                     std::size_t size);  // tests/fuzz/fuzz_inverse3.cpp

namespace palpate::device {
namespace {

using nlohmann::json;

std::string state_text(const std::string& id, double x_m, double y_m, double z_m) {
  return json{{"inverse3",
               {{{"device_id", id},
                 {"config", {{"handedness", "right"}}},
                 {"state", {{"cursor_position", {{"x", x_m}, {"y", y_m}, {"z", z_m}}}}}}}},
              {"wireless_verse_grip", {{{"state", {{"buttons", {{"a", true}, {"b", false}, {"c", true}}}}}}}}}
      .dump();
}

Vec3 force_in(const std::string& text) {
  const json values = json::parse(text)["inverse3"][0]["commands"]["set_cursor_force"]["values"];
  return Vec3{values["x"].get<double>(), values["y"].get<double>(), values["z"].get<double>()};
}

TEST(Inverse3Texts, AStateIsInMillimetres) {
  const Inverse3Text read = parsed_inverse3(state_text("049D", 0.01, -0.1, 0.25), "");
  EXPECT_TRUE(read.is_json && read.has_device && read.has_position);
  EXPECT_EQ(read.device_id, "049D");
  EXPECT_EQ(read.position_mm, Vec3(10, -100, 250));
  EXPECT_EQ(read.buttons, 5u);
  EXPECT_EQ(read.devices, 1);
  EXPECT_TRUE(says(read.config, "right"));
  EXPECT_FALSE(parsed_inverse3(state_text("049D", 0, 0, 0), "OTHER").has_device);
}

TEST(Inverse3Texts, WhatIsNotThereStaysUnset) {
  for (const char* text : {"", "{", "[]", "7", "\"x\"", "{\"inverse3\":7}", "\xff\xfe"})
    EXPECT_FALSE(parsed_inverse3(text, "").has_device) << text;
  for (const char* position :
       {R"({"x":1,"y":2})", R"({"x":"1","y":2,"z":3})", R"({"x":1e308,"y":0,"z":0})", "null", "[1,2,3]"}) {
    const std::string text =
        R"({"inverse3":[{"device_id":"A","state":{"cursor_position":)" + std::string(position) + "}}]}";
    const Inverse3Text read = parsed_inverse3(text, "");
    EXPECT_TRUE(read.has_device) << position;
    EXPECT_FALSE(read.has_position) << position;
  }
}

TEST(Inverse3Texts, AForceIsWhatTheMakersPagesShow) {
  EXPECT_EQ(
      json::parse(inverse3_force_text("049D", Vec3{0.5, -1.25, 2})),
      json::parse(
          R"({"inverse3":[{"device_id":"049D","commands":{"set_cursor_force":{"values":{"x":0.5,"y":-1.25,"z":2}}}}]})"));
  EXPECT_EQ(json::parse(inverse3_gate_text("049D", 0.3)),
            json::parse(R"({"inverse3":[{"device_id":"049D","configure":{"force_gate":{"gain":0.3}}}]})"));
  EXPECT_TRUE(force_in(inverse3_force_text("A", Vec3{std::nan(""), 1, 1})).isZero(0.0));
}

TEST(PackedForce, KeepsEveryForceToItsStepAndTheDirectionBeyond) {
  PackedForce packed;
  Random random(9);
  for (int i = 0; i < 2000; ++i) {
    const double x = random.uniform(-20, 20), y = random.uniform(-20, 20), z = random.uniform(-20, 20);
    packed.store(Vec3{x, y, z});
    EXPECT_LE((packed.load() - Vec3{x, y, z}).cwiseAbs().maxCoeff(), 0.5001 * PackedForce::kStepN);
  }
  packed.store(Vec3{100, -50, 0});
  EXPECT_NEAR(packed.load().y() / packed.load().x(), -0.5, 1e-5);
  EXPECT_GT(packed.load().x(), 20.0);
  packed.store(Vec3{std::nan(""), 1, 1});
  EXPECT_TRUE(packed.load().isZero(0.0));
  packed.store(Vec3{1e308, 1e308, 1e308});
  EXPECT_TRUE(is_finite(packed.load()));
}

/// What the service would be, called by hand.
class PretendedTextLink final : public TextLink {
 public:
  Status open(TextPeer& to) override {
    peer = &to;
    return Done{};
  }
  void close() noexcept override {
    std::string text;
    if (peer != nullptr && peer->last(text)) sent.push_back(text);
    peer = nullptr;
  }
  void say(const std::string& text) {
    peer->take(text);
    std::string answer;
    while (peer->give(answer)) sent.push_back(answer);
  }
  TextPeer* peer = nullptr;
  std::vector<std::string> sent;
};

struct Inverse3Rig {
  Inverse3Rig() {
    Inverse3Options options;
    options.open_tries = 5;
    options.wait = [this] { link->say(says); };
    options.http = [this](const HttpRequest& request) -> Result<HttpAnswer> {
      requests.push_back(request);
      if (http_fails) return Error{"refused"};
      return HttpAnswer{200, R"({"enabled":true})"};
    };
    auto owned = std::make_unique<PretendedTextLink>();
    link = owned.get();
    device = std::make_unique<Inverse3Device>(std::move(owned), clock, options);
  }
  VirtualClock clock;
  PretendedTextLink* link = nullptr;
  std::string says = state_text("049D", 0.0, -0.1, 0.2);
  std::vector<HttpRequest> requests;
  bool http_fails = false;
  std::unique_ptr<Inverse3Device> device;
};

TEST(Inverse3, OpensWithZeroAndItsFiltersSetAndRecorded) {
  Inverse3Rig rig;
  ASSERT_TRUE(ok(rig.device->open()));
  ASSERT_GE(rig.link->sent.size(), 2u);
  EXPECT_TRUE(says(rig.link->sent[0], "force_gate")) << "before any force";
  EXPECT_TRUE(force_in(rig.link->sent[1]).isZero(0.0));
  ASSERT_GE(rig.requests.size(), 2u);
  EXPECT_EQ(rig.requests[0].method, "POST");
  EXPECT_EQ(rig.requests[0].path, "/inverse3/049D/config/torque_scaling");
  EXPECT_EQ(rig.requests[0].body, R"({"enabled":true})");
  const auto facts = rig.device->facts();
  const auto fact = [&](const char* key) {
    for (const auto& [name, value] : facts)
      if (name == key) return value;
    return std::string("none");
  };
  EXPECT_EQ(fact("device_id"), "049D");
  EXPECT_EQ(fact("force_gate_set"), "0.300");
  EXPECT_EQ(fact("torque_scaling_now"), R"(200 {"enabled":true})");
  Inverse3Rig deaf;
  deaf.http_fails = true;
  ASSERT_TRUE(deaf.device->open());
  EXPECT_TRUE(says(deaf.device->facts()[5].second, "not answered"));
}

TEST(Inverse3, ReadsAndShowsForce) {
  Inverse3Rig rig;
  ASSERT_TRUE(rig.device->open());
  rig.clock.advance(1.0);
  rig.link->say(state_text("049D", 0.01, -0.09, 0.2));
  const DeviceState state = rig.device->read();
  EXPECT_EQ(state.status, ReadStatus::kFresh);
  EXPECT_LT((state.position_mm - Vec3{10, 10, 0}).norm(), 1e-9);
  EXPECT_EQ(state.buttons, 5u);
  EXPECT_EQ(state.packet_ns, 1'000'000'000);
  EXPECT_EQ(rig.device->read().status, ReadStatus::kNothingNew);
  rig.device->send(governed(Vec3{0.5, -1, 0.25}));
  rig.link->say(rig.says);
  EXPECT_LT((force_in(rig.link->sent.back()) - Vec3{0.5, -1, 0.25}).norm(), 1e-4);
  EXPECT_TRUE(rig.device->cut_force());
  rig.link->say(rig.says);
  EXPECT_TRUE(force_in(rig.link->sent.back()).isZero(0.0));
  rig.device->send(governed(Vec3{0.5, -1, 0.25}));
  rig.device->close();
  EXPECT_TRUE(force_in(rig.link->sent.back()).isZero(0.0)) << "the last that it hears";
}

TEST(Inverse3, AServiceThatLiesNeverGetsForceThrough) {
  Inverse3Rig rig;
  ASSERT_TRUE(rig.device->open());
  (void)rig.device->read();
  for (int i = 0; i < 3; ++i) rig.link->say("{\"inverse3\":[{\"device_id\":\"049D\",\"state\":{}}]}");
  EXPECT_EQ(rig.device->read().status, ReadStatus::kGarbled);
  rig.link->say(rig.says);
  EXPECT_EQ(rig.device->read().status, ReadStatus::kFresh);
  rig.link->say(R"({"events":[]})");
  EXPECT_EQ(rig.device->read().status, ReadStatus::kNothingNew) << "about something else";
  rig.link->say(R"({"inverse3":[]})");
  EXPECT_EQ(rig.device->read().status, ReadStatus::kLost) << "unplugged, says the service";
  rig.link->say(rig.says);
  EXPECT_EQ(rig.device->read().status, ReadStatus::kFresh);
  rig.link->say(state_text("OTHER", 0, 0, 0));
  EXPECT_EQ(rig.device->read().status, ReadStatus::kLost) << "another device is not this one";
  rig.link->say(rig.says);
  (void)rig.device->read();
  rig.link->peer->disconnected();
  EXPECT_EQ(rig.device->read().status, ReadStatus::kLost);
  EXPECT_FALSE(rig.device->cut_force());
}

TEST(Inverse3Driver, ReadsItsOptionsAndRefusesOthers) {
  const Driver driver = driver_of(&register_inverse3_driver, "inverse3:049D");
  const MonotonicClock clock;
  const std::vector<std::pair<std::string, std::string>> options = {{"service", "localhost:10001"},
                                                                    {"force-gate", "1"},
                                                                    {"torque-scaling", "off"},
                                                                    {"centre-mm", "0/-100/200"},
                                                                    {"force-max-n", "3"}};
  const auto made = value_of(driver.make({"inverse3:049D", {}, options}, clock));
  EXPECT_EQ(made.device->limits().force_max_n, 3.0);
  EXPECT_FALSE(made.unproven.empty());
  const std::pair<const char*, const char*> bad[] = {{"force-gate", "2"},   {"torque-scaling", "maybe"},
                                                     {"centre-mm", "1/2"},  {"service", "nowhere"},
                                                     {"force-max-n", "99"}, {"colour", "red"}};
  for (const auto& [key, value] : bad) {
    EXPECT_TRUE(refused(driver.make({"inverse3", {}, {{key, value}}}, clock),
                        std::string(key) == "service" ? "port" : key));
  }
}

TEST(Inverse3Fuzz, TheCorpusIsRead) {
  expect_corpus_passes(&palpate_fuzz_inverse3, PALPATE_SOURCE_ROOT "/tests/corpus/inverse3", 10);
  Random random(23);
  const std::string whole = state_text("049D", 0.01, -0.1, 0.25);
  for (int run = 0; run < 3000; ++run) {
    std::string text = whole;
    for (std::uint64_t k = 1 + random.below(4); k > 0; --k)
      text[random.below(text.size())] = static_cast<char>(random.below(256));
    if (random.below(3) == 0) text.resize(random.below(text.size()));
    ASSERT_EQ(palpate_fuzz_inverse3(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()), 0)
        << "seed 23, run " << run;
  }
}

}  // namespace
}  // namespace palpate::device
