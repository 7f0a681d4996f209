// palpate live as a user runs it, on a tiny scene.
#include <nlohmann/json.hpp>

#include <algorithm>

#include "device/drivers/all_drivers.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/live/doctor.h"
#include "experiments/live/session_device.h"
#include "tests/experiments/program.h"
#include "tests/json_schema.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

class Live : public OnCommandLine {
 protected:
  template <class... More>
  Words live(const std::string& out, const More&... more) const {
    return live_of("cloud,cloud-smooth", out, more...);
  }
  template <class... More>
  Words live_of(const std::string& renderers, const std::string& out, const More&... more) const {
    return words("live", kSmallWaves, "--renderers", renderers, "--out", in(out), more...);
  }
  json document(const std::string& out) const { return json_in(out + "/live.json"); }
};

TEST_F(Live, SwitchesUnderTheHandWithoutAStepOfItsOwnAndIsTheSameTwice) {
  const Words few = words("--seconds 4 --switch-every 0.3 --accelerated");
  const ProcessOutcome run = succeeds(live("out", few));
  expect_valid("live", text_in("out/live.json"));
  const json first = document("out");
  EXPECT_EQ(first["ticks"], 4001);
  EXPECT_EQ(first["late"], 0);
  EXPECT_EQ(first["faults"], 0);
  EXPECT_GT(first["switches"], 4);
  EXPECT_LT(first["largest_excess_n"], 1e-12) << "more than rounding";
  EXPECT_GT(first["largest_step_n"], 0.0);
  for (const json& renderer : first["renderers"]) {
    EXPECT_GT(renderer["contact_frames"], 500) << renderer["label"];
    EXPECT_GT(renderer["felt_frames"], 500) << renderer["label"];
    EXPECT_EQ(renderer["frames"], 4001) << "stepped every frame";
    EXPECT_EQ(renderer["disqualified"], "");
  }
  EXPECT_THAT(run.out, HasSubstr("The session"));
  succeeds(live("again", few));
  const json second = document("again");
  EXPECT_EQ(first["decisions"], second["decisions"]);
  EXPECT_EQ(first["largest_step_n"], second["largest_step_n"]);
  for (const std::size_t i : {0u, 1u})
    EXPECT_EQ(first["renderers"][i]["felt_steps"], second["renderers"][i]["felt_steps"]);
}

TEST_F(Live, AKickUnderTheHandIsCountedAndAnExactSurfaceHasNone) {
  const Words few = words("--seconds 6 --hand explore --accelerated --verbose");
  // A penalty for each near point: its force steps as points come and go.
  succeeds(live_of("penalty-grid", "kicks", few));
  const json kicks = document("kicks")["renderers"][0]["felt_steps"];
  EXPECT_GT(kicks["over_0_2_n"], 0);
  EXPECT_GT(kicks["largest_excess"]["n"], 0.2);
  EXPECT_GE(kicks["over_0_1_n"], kicks["over_0_2_n"]);
  const ProcessOutcome run = succeeds(live_of("analytic", "exact", few));
  const json exact = document("exact")["renderers"][0];
  EXPECT_GT(exact["contact_frames"], 1000);
  EXPECT_GT(exact["felt_steps"]["largest"]["n"], 0.0);
  EXPECT_EQ(exact["felt_steps"]["over_0_1_n"], 0);
  EXPECT_THAT(run.out, HasSubstr("Steps of the force that is felt"));
}

TEST_F(Live, AHandFollowsAPathAndExploresOtherwise) {
  succeeds(live("follow", "--seconds 0.2 --path weave:frames=500 --accelerated"));
  EXPECT_EQ(document("follow")["hand"], "follow");
  succeeds(live("explore", "--seconds 0.2 --path hand:seed=7 --accelerated"));
  const json explored = document("explore");
  EXPECT_EQ(explored["hand"], "explore");
  EXPECT_THAT(explored["path"].get<std::string>(), HasSubstr("seed=7"));
}

TEST_F(Live, AChangeOfParametersTakesOverInTheSameLane) {
  succeeds(
      live_of("cloud", "out", "--seconds 3 --changes 1:cloud:stiffness=0.8,2:cloud:refine=1 --accelerated"));
  const json live = document("out");
  EXPECT_EQ(live["renderers"][0]["made"], 3);
  int by_parameters = 0;
  for (const json& decision : live["decisions"])
    if (decision["source"] == "parameters" && decision["reason"] == "") ++by_parameters;
  EXPECT_GE(by_parameters, 2);
  EXPECT_LT(live["largest_excess_n"], 1e-12);
}

TEST_F(Live, ARecordingHoldsEveryRendererAndIsReplayedToTheBit) {
  succeeds(live("out",
                "--seconds 3 --hand follow --switch-every 0.3 --changes 1:cloud:refine=1 --accelerated "
                "--record @/session.palrec"));
  const json recording = document("out")["recording"];
  EXPECT_EQ(recording["ticks"], 3001);
  EXPECT_EQ(recording["written"], 3001);
  EXPECT_EQ(recording["lost"], 0);
  for (const std::string renderer : {"cloud", "cloud-smooth"}) {
    succeeds("compare", kSmallWaves, "--renderers", renderer, "--path @/session.palrec --out",
             in("again-" + renderer));
    const json segments = json_in("again-" + renderer + "/segments.json")["segments"];
    ASSERT_FALSE(segments.empty());
    for (const json& segment : segments) {
      EXPECT_EQ(segment["same"], true) << renderer;
      EXPECT_GT(segment["contact_frames"], 100) << renderer;
    }
  }
  EXPECT_EQ(palpate(live("out", "--seconds 1 --accelerated --record @/session.palrec")).exit_code, 2)
      << "a recording is not replaced unasked";
}

TEST_F(Live, TheMappingIsStatedAsItIsFelt) {
  succeeds(live("out", "--seconds 1 --mapping 2 --accelerated"));
  const json mapping = document("out")["mapping"];
  EXPECT_EQ(mapping["world_per_device"], 2.0);
  EXPECT_EQ(mapping["felt_stiffness_n_per_mm"].get<double>(),
            2.0 * mapping["stiffness_n_per_mm"].get<double>());
}

TEST_F(Live, RunsInRealTime) {
  const ProcessOutcome run = palpate(live("out", "--seconds 1 --switch-every 0.2 --rearm"));
  const json live = document("out");
  // Whatever the machine does: what was not ticked was counted.
  EXPECT_GT(live["ticks"].get<double>() + live["late"].get<double>(), 900.0) << run.err;
  EXPECT_NE(live["scheduling"], "");
}

TEST_F(Live, WhatIsWrongIsNamedAndNothingIsLeft) {
  const std::pair<const char*, const char*> wrong[] = {
      {"--device sim:omny", "sim:omni"},
      {"--grip paw", "finger"},
      {"--hand wave", "explore"},
      {"--rule perhaps", "refuse"},
      {"--mapping large", "--mapping"},
      {"--mapping 0", "--mapping"},
      {"--rate 1000.5", "whole"},
      {"--seconds 0", "--seconds"},
      {"--changes 1:cloud", "--changes"},
      {"--changes 1:clod:shading=none", "clod"},
      {"--changes 1:cloud:shadow=none", "shadow"},
      {"--changes 2:cloud:stiffness=0.8,1:cloud:stiffness=0.7", "before"},
      {"--record session.txt", ".palrec"},
      {"--record no/such/folder/a.palrec", "folder"}};
  for (const auto& [arguments, named] : wrong) {
    refuses(named, live("bad", arguments));
    EXPECT_FALSE(exists("bad/live.json"));
  }
}

// ---- palpate list devices, and the doctor's judgement of machines that are not here.

/// A machine on which nothing is wrong.
SystemFacts good_machine() {
  SystemFacts facts;
  facts.tried.fifo = facts.tried.memory_locked = facts.tried.latency_held = true;
  facts.tried.priority = device::kWatchdogPriority;
  facts.tried.kernel = device::KernelKind::kRealTime;
  facts.tried.kernel_release = "6.12.0-rt";
  facts.tried.cpus = 4;
  facts.rtprio_limit = 85;
  facts.memlock_limit_bytes = SystemFacts::kUnlimited;
  facts.cpu_governors = {"performance"};
  facts.has_latency_file = facts.has_usb = true;
  facts.clock_resolution_ns = 1;
  facts.clock_source = "tsc";
  facts.lateness.p50_ns = 3'000;
  facts.lateness.p99_ns = 9'000;
  facts.real_time_share_us = 950'000;
  return facts;
}

/// The only check that is not fine; its name is empty where there is none or more than one.
Check only_finding(const SystemFacts& facts) {
  const std::vector<Check> checks = examine(facts);
  const auto not_fine = [](const Check& check) { return check.verdict != CheckVerdict::kFine; };
  if (std::count_if(checks.begin(), checks.end(), not_fine) != 1) return {};
  return *std::find_if(checks.begin(), checks.end(), not_fine);
}

TEST(Doctor, FindsNothingOnAGoodMachine) {
  for (const Check& check : examine(good_machine())) {
    EXPECT_EQ(check.verdict, CheckVerdict::kFine) << check.about << ": " << check.found;
    EXPECT_TRUE(check.remedy.empty()) << check.about;
    EXPECT_FALSE(check.found.empty()) << check.about;
  }
}

TEST(Doctor, FindsEachFaultAloneAndSaysItsRemedy) {
  struct Case {
    const char* about;
    CheckVerdict verdict;
    const char* remedy;
    void (*spoil)(SystemFacts&);
  };
  const Case cases[] = {
      {"real-time priority", CheckVerdict::kWarning, "@realtime - rtprio 85",
       [](SystemFacts& f) { f.tried.fifo = false; }},
      {"locked memory", CheckVerdict::kWarning, "@realtime - memlock unlimited",
       [](SystemFacts& f) { f.tried.memory_locked = false; }},
      {"locked memory", CheckVerdict::kWarning, "@realtime - memlock unlimited",
       [](SystemFacts& f) { f.memlock_limit_bytes = std::uint64_t{8} << 20; }},
      {"kernel", CheckVerdict::kWarning, "linux-image-rt-amd64",
       [](SystemFacts& f) { f.tried.kernel = device::KernelKind::kDynamic; }},
      {"CPUs", CheckVerdict::kWarning, "two CPUs", [](SystemFacts& f) { f.tried.cpus = 1; }},
      {"CPU governor", CheckVerdict::kWarning, "--governor performance",
       [](SystemFacts& f) { f.cpu_governors.push_back("powersave"); }},
      {"CPU sleep states", CheckVerdict::kWarning, "KERNEL==\"cpu_dma_latency\"",
       [](SystemFacts& f) { f.tried.latency_held = false; }},
      {"timer", CheckVerdict::kProblem, "HIGH_RES_TIMERS",
       [](SystemFacts& f) { f.clock_resolution_ns = 4'000'000; }},
      {"timer", CheckVerdict::kWarning, "tsc=reliable", [](SystemFacts& f) { f.clock_source = "hpet"; }},
      {"timer", CheckVerdict::kWarning, "stop what else runs",
       [](SystemFacts& f) { f.lateness.p50_ns = 500'000; }},
      {"real-time share", CheckVerdict::kWarning, "sched_rt_runtime_us=950000",
       [](SystemFacts& f) { f.real_time_share_us = -1; }},
      {"host and steal", CheckVerdict::kWarning, "machine of its own",
       [](SystemFacts& f) { f.virtual_machine = true; }},
      {"host and steal", CheckVerdict::kWarning, "machine of its own",
       [](SystemFacts& f) { f.steal_percent = 3.0; }},
      {"USB permission", CheckVerdict::kWarning, R"(ATTR{idVendor}=="0403", ATTR{idProduct}=="cb48")",
       [](SystemFacts& f) {
         f.usb.push_back({"Novint Falcon", "0403", "cb48", "/dev/bus/usb/001/004", false,
                          device::udev_rule(device::known_usb_ids().front())});
         f.usb.push_back({"3Dconnexion", "256f", "c635", "/dev/hidraw0", true, ""});
       }},
  };
  for (const Case& one : cases) {
    SystemFacts facts = good_machine();
    one.spoil(facts);
    const Check found = only_finding(facts);
    EXPECT_EQ(found.about, one.about);
    EXPECT_EQ(found.verdict, one.verdict) << one.about;
    EXPECT_THAT(found.remedy, testing::Contains(HasSubstr(one.remedy))) << one.about;
  }
}

TEST(Doctor, WhatIsNotThereIsNoFault) {
  SystemFacts facts = good_machine();
  facts.cpu_governors.clear();
  facts.has_latency_file = facts.has_usb = facts.tried.latency_held = false;
  facts.real_time_share_us.reset();
  facts.clock_source.clear();
  for (const Check& check : examine(facts)) EXPECT_EQ(check.verdict, CheckVerdict::kFine) << check.about;
}

TEST(Doctor, ReadsThisMachine) {
  const SystemFacts facts = read_system_facts();
  EXPECT_GE(facts.tried.cpus, 1);
  EXPECT_GT(facts.clock_resolution_ns, 0);
  EXPECT_EQ(facts.lateness.count, 99u) << "a tenth of a second at 1 kHz";
  EXPECT_GE(facts.steal_percent, 0.0);
  EXPECT_FALSE(facts.tried.kernel_release.empty());
}

class Devices : public OnCommandLine {};

TEST_F(Devices, AreListedWithWhatTheyNeed) {
  const ProcessOutcome text = palpate("list devices"), run = palpate("list devices --json");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(text.exit_code, 0);
  expect_valid("devices", run.out);
  const json document = json::parse(run.out);
  EXPECT_FALSE(document.contains("checks")) << "only where asked for";
  std::vector<std::string> names;
  for (const json& one : document["devices"]) {
    names.push_back(one["name"]);
    EXPECT_THAT(text.out, HasSubstr(names.back()));
    EXPECT_EQ(one["status"] == "ready", one["needs"].empty()) << one;
    for (const json& need : one["needs"]) EXPECT_THAT(text.out, HasSubstr(need.get<std::string>())) << need;
  }
  for (const device::ArmOptions& arm : device::arm_models())
    EXPECT_EQ(std::count(names.begin(), names.end(), "sim:" + arm.name), 1) << arm.name;
}

TEST_F(Devices, TheDoctorSaysEveryCheckInTextAndJson) {
  const ProcessOutcome text = palpate("list devices --doctor"), run = palpate("list devices --doctor --json");
  expect_valid("devices", run.out);
  const json checks = json::parse(run.out)["checks"];
  ASSERT_EQ(checks.size(), examine(good_machine()).size());
  bool problem = false;
  for (const json& check : checks) {
    EXPECT_THAT(text.out, HasSubstr(check["about"].get<std::string>() + ": ")) << check;
    EXPECT_EQ(check["verdict"] == "fine", check["remedy"].empty()) << check;
    problem = problem || check["verdict"] == "problem";
  }
  EXPECT_EQ(run.exit_code, problem ? 1 : 0) << "warnings are no failure";
}

// ---- palpate live serve and palpate devices --report, as a user runs them. Where one waits for another, it
// waits as long as it takes.

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
  Started bridge(folder_, words("live serve --device sim:falcon --listen 127.0.0.1:0 --watchdog-ms 1000 "
                                "--most-age-ms 1000"));
  const std::string where = address_of(bridge);
  ASSERT_NE(where, "") << bridge.err();
  const ProcessOutcome run =
      succeeds("list devices --report", "bridge:" + where, "--seconds 0.5 --device-option most-age-ms=1000");
  expect_valid("device-report", run.out);
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

TEST_F(BridgeCommand, CountsWhatItDidAndItsSchemaRefusesWhatItNeverPrints) {
  const ProcessOutcome run = succeeds("live serve --listen 127.0.0.1:0 --seconds 0.2 --json");
  expect_valid("bridge", run.out);
  json counts = json::parse(run.out);
  EXPECT_GT(counts["ticks"], 0);
  EXPECT_EQ(counts["sessions"], 0);
  EXPECT_FALSE(counts["scheduling"].get<std::string>().empty());
  const std::string schema = std::string(PALPATE_DOCS) + "/schemas/bridge.schema.json";
  counts["trips"] = -1;
  EXPECT_NE(schema_violations(schema, counts.dump()), "");
  counts.erase("trips");
  EXPECT_NE(schema_violations(schema, counts.dump()), "");
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
      {"list devices --doctr", "--doctor"},
      {"list devices --report nothing", "palpate list devices"},
      {"list devices --report sim --out report.txt", ".json"},
      {"list devices --report bridge:a:b:c", "HOST:PORT"}};
  for (const auto& [line, says] : cases) EXPECT_EQ(refuses(says, line).out, "") << line;
}

TEST_F(BridgeCommand, AReportOfASimulatedArmFitsItsSchemaAndAddsUp) {
  const Words command = words("list devices --report sim:omni --seconds 0.3 --rate 500 --out @/report.json");
  EXPECT_EQ(succeeds(command).out, "");
  expect_valid("device-report", text_in("report.json"));
  const json report = json_in("report.json");
  int packets = 0;
  for (const char* kind : {"fresh", "nothing_new", "garbled", "lost"})
    packets += report["packets"][kind].get<int>();
  EXPECT_EQ(report["packets"]["frames"], packets);
  EXPECT_GT(packets, 0);
  EXPECT_TRUE(report["homing"]["at_start"].get<bool>());
  EXPECT_EQ(report["device"]["driver"], "sim");
  EXPECT_EQ(palpate(command).exit_code, 2) << "a report that is there is kept";
  succeeds(command, "--force");
}

TEST_F(BridgeCommand, ADeviceThatDoesNotOpenIsAReportToo) {
  const ProcessOutcome run = palpate("list devices --report bridge:127.0.0.1:1");
  EXPECT_EQ(run.exit_code, 1);
  expect_valid("device-report", run.out);
  const json report = json::parse(run.out);
  EXPECT_FALSE(report["opened"].get<bool>());
  EXPECT_THAT(report["error"].get<std::string>(), HasSubstr("palpate live serve"));
  EXPECT_THAT(run.err, HasSubstr("palpate live serve"));
}

TEST(SessionDevice, OptionsAreReadInOrder) {
  const auto options = value_of(option_pairs({"k=2.5", "firmware=a=b", "empty="}));
  ASSERT_EQ(options.size(), 3u);
  EXPECT_EQ(options[1], (std::pair<std::string, std::string>("firmware", "a=b")));
  EXPECT_EQ(options[2].second, "");
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

TEST(DeviceObserver, CountsWhatASilentLyingAndHomingDeviceDoes) {
  VirtualClock clock;
  ToldDevice told;
  device::ForceGovernor governor = device::ForceGovernor::create(told.limits(), {}).value();
  DeviceObserver observer(told, governor, clock);
  told.state.homed = false;
  const auto frame = [&](device::ReadStatus status, double x_mm) {
    clock.advance(1e-3);
    told.state.status = status;
    told.state.position_mm.x() = x_mm;
    told.state.packet_ns = clock.now_ns() - 200'000;
    observer.frame(clock.now_ns());
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
  const DeviceWatch& watch = observer.watch();
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
