// palpate live serve and palpate devices --report, as a user runs them. Where one waits for another, it waits
// as long as it takes.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "device/drivers/usb_ids.h"
#include "experiments/live/device_report.h"
#include "experiments/live/session_device.h"
#include "tests/experiments/program.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

const std::string kReportSchema = std::string(PALPATE_DOCS) + "/schemas/device-report.schema.json";
const std::string kCountsSchema = std::string(PALPATE_DOCS) + "/schemas/bridge.schema.json";

class BridgeCommand : public OnCommandLine {
 protected:
  /// "ADDRESS:PORT" at which a started `palpate live serve` listens; empty where it ended.
  static std::string address_of(Started& bridge) {
    std::string where;
    bridge.wait_for([&] {
      const std::string text = bridge.out();
      const std::size_t at = text.find(" at "), end = text.find(": forces");
      if (end == std::string::npos) return false;
      where = text.substr(at + 4, end - at - 4);
      return true;
    });
    return where;
  }
};

TEST_F(BridgeCommand, AProgramAtAnotherProcessFeelsTheDevice) {
  Started bridge(folder_, {"live", "serve", "--device", "sim:falcon", "--listen", "127.0.0.1:0",
                           "--watchdog-ms", "1000", "--most-age-ms", "1000"});
  const std::string where = address_of(bridge);
  ASSERT_NE(where, "") << bridge.err();
  const ProcessOutcome run =
      succeeds("list devices --report", "bridge:" + where, "--seconds 0.5 --device-option most-age-ms=1000");
  EXPECT_EQ(schema_violations(kReportSchema, run.out), "");
  const json report = json::parse(run.out);
  EXPECT_TRUE(report["opened"].get<bool>());
  EXPECT_EQ(report["limits"]["force_max_n"], 8.0) << "the far device's own";
  EXPECT_GT(report["packets"]["fresh"], 0);
  EXPECT_FALSE(report["packets"]["first"].empty());
  EXPECT_EQ(report["device"]["options"]["most-age-ms"], "1000");
  EXPECT_FALSE(report["device"]["unproven"].empty());
  bridge.wait_for_signals();
  bridge.send(SIGINT);
  EXPECT_EQ(bridge.end(), 130);
}

TEST_F(BridgeCommand, CountsWhatItDid) {
  const ProcessOutcome run = succeeds("live serve --listen 127.0.0.1:0 --seconds 0.2 --json");
  EXPECT_EQ(schema_violations(kCountsSchema, run.out), "");
  const json counts = json::parse(run.out);
  EXPECT_GT(counts["ticks"], 0);
  EXPECT_EQ(counts["sessions"], 0);
  EXPECT_FALSE(counts["scheduling"].get<std::string>().empty());
}

TEST_F(BridgeCommand, ItsSchemaRefusesWhatItNeverPrints) {
  json counts = json::parse(palpate("live serve --listen 127.0.0.1:0 --seconds 0.1 --json").out);
  ASSERT_EQ(schema_violations(kCountsSchema, counts.dump()), "");
  counts["trips"] = -1;
  EXPECT_NE(schema_violations(kCountsSchema, counts.dump()), "");
  counts.erase("trips");
  EXPECT_NE(schema_violations(kCountsSchema, counts.dump()), "");
}

TEST_F(BridgeCommand, RefusesWhatMeansNothing) {
  const std::pair<const char*, const char*> cases[] = {
      {"live serve --device sim:falcn", "falcon"},
      {"live serve --device nothing", "palpate list devices"},
      {"live serve --device sim --grip paw", "paw"},
      {"live serve --listen nowhere", "HOST:PORT"},
      {"live serve --listen 127.0.0.1:99999", "port"},
      {"live serve --device-option novalue", "KEY=VALUE"},
      {"live serve --device sim --device-option a=b", "leave it out"},
      {"live serve --device path", "palpate list devices"},
      {"list devices --report nothing", "palpate list devices"},
      {"list devices --report sim --out report.txt", ".json"},
      {"list devices --report bridge:a:b:c", "HOST:PORT"}};
  for (const auto& [line, says] : cases) EXPECT_EQ(refuses(says, line).out, "") << line;
}

TEST_F(BridgeCommand, AReportOfASimulatedArmFitsItsSchemaAndAddsUp) {
  const std::string out = (folder_ / "report.json").string();
  const std::vector<std::string> command = {"list", "devices", "--report", "sim:omni", "--seconds",
                                            "0.3",  "--rate",  "500",      "--out",    out};
  const ProcessOutcome run = succeeds(command);
  EXPECT_EQ(run.out, "");
  EXPECT_EQ(schema_violations(kReportSchema, file_text(out)), "");
  const json report = json::parse(file_text(out));
  const json& packets = report["packets"];
  EXPECT_EQ(packets["fresh"].get<int>() + packets["nothing_new"].get<int>() + packets["garbled"].get<int>() +
                packets["lost"].get<int>(),
            packets["frames"].get<int>());
  EXPECT_GT(packets["frames"], 0);
  EXPECT_TRUE(report["homing"]["at_start"].get<bool>());
  EXPECT_EQ(report["device"]["driver"], "sim");
  const ProcessOutcome again = palpate(command);
  EXPECT_EQ(again.exit_code, 2) << "a report that is there is kept";
  std::vector<std::string> forced = command;
  forced.emplace_back("--force");
  succeeds(forced);
}

TEST_F(BridgeCommand, ADeviceThatDoesNotOpenIsAReportToo) {
  const ProcessOutcome run = palpate("list devices --report bridge:127.0.0.1:1");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_EQ(schema_violations(kReportSchema, run.out), "");
  const json report = json::parse(run.out);
  EXPECT_FALSE(report["opened"].get<bool>());
  EXPECT_THAT(report["error"].get<std::string>(), HasSubstr("palpate live serve"));
  EXPECT_THAT(run.err, HasSubstr("palpate live serve"));
}

TEST(SessionDevice, OptionsAreReadInOrder) {
  const auto options = option_pairs({"k=2.5", "firmware=a=b", "empty="});
  ASSERT_TRUE(options);
  ASSERT_EQ(options->size(), 3u);
  EXPECT_EQ((*options)[1], (std::pair<std::string, std::string>("firmware", "a=b")));
  EXPECT_EQ((*options)[2].second, "");
  EXPECT_TRUE(option_pairs({})->empty());
  for (const char* bad : {"k", "=2", ""}) EXPECT_FALSE(option_pairs({bad})) << bad;
}

/// Says what it is told to say.
class ToldDevice final : public device::Device {
 public:
  [[nodiscard]] std::string name() const override { return "told"; }
  [[nodiscard]] Status open() override { return Done{}; }
  void close() noexcept override {}
  [[nodiscard]] device::DeviceLimits limits() const noexcept override {
    return {1.0, {Vec3::Constant(-1.0), Vec3::Constant(1.0)}, 0.01, 1000.0};
  }
  [[nodiscard]] device::DeviceState read() noexcept override { return state; }
  void send(device::GovernedForce force) noexcept override { zero = zero && force.newtons().isZero(0.0); }
  device::DeviceState state;
  bool zero = true;
};

TEST(DeviceLooker, CountsWhatASilentLyingAndHomingDeviceDoes) {
  VirtualClock clock;
  ToldDevice told;
  device::ForceGovernor governor = device::ForceGovernor::create(told.limits(), {}).value();
  DeviceLooker looker(told, governor, clock);
  told.state.homed = false;
  const auto frame = [&](device::ReadStatus status, double x_mm) {
    clock.advance(1e-3);
    told.state.status = status;
    told.state.position_mm.x() = x_mm;
    told.state.packet_ns = clock.now_ns() - 200'000;
    looker.frame(clock.now_ns());
  };
  using device::ReadStatus;
  frame(ReadStatus::kFresh, 1.0);
  frame(ReadStatus::kFresh, 1.5);
  told.state.homed = true;
  told.state.buttons = 2;
  frame(ReadStatus::kFresh, 1.25);
  told.state.buttons = 4;
  frame(ReadStatus::kFresh, std::nan(""));
  for (int i = 0; i < 5; ++i) frame(ReadStatus::kNothingNew, 9.0);
  frame(ReadStatus::kGarbled, 9.0);
  frame(ReadStatus::kLost, 9.0);
  const DeviceWatch& watch = looker.watch();
  EXPECT_TRUE(told.zero) << "zero force all the while";
  EXPECT_EQ(watch.frames, 11u);
  EXPECT_EQ(watch.fresh, 4u);
  EXPECT_EQ(watch.nothing_new, 5u);
  EXPECT_EQ(watch.garbled, 1u);
  EXPECT_EQ(watch.lost, 1u);
  EXPECT_EQ(watch.longest_gap_ns, 7'000'000);
  EXPECT_FALSE(watch.homed_at_start);
  ASSERT_TRUE(watch.homed_after_s);
  EXPECT_NEAR(*watch.homed_after_s, 2e-3, 1e-9);
  EXPECT_EQ(watch.buttons_seen, 6u);
  EXPECT_EQ(watch.low_mm.x(), 1.0);
  EXPECT_EQ(watch.high_mm.x(), 1.5);
  EXPECT_EQ(watch.smallest_step_mm.x(), 0.25);
  EXPECT_EQ(watch.interval.statistics().count, 3u);
  EXPECT_EQ(watch.age_bins.counts[18], 4u) << "200 us lie between 2^17 and 2^18 ns";
}

}  // namespace
}  // namespace palpate::experiments
