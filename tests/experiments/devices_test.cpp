// palpate list devices, and the doctor's judgement of machines that are not here.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "device/drivers/usb_ids.h"
#include "device/simulated/arm_models.h"
#include "experiments/live/doctor.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

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

bool any_line(const Check& check, const std::string& says) {
  return std::any_of(check.remedy.begin(), check.remedy.end(),
                     [&](const std::string& line) { return line.find(says) != std::string::npos; });
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
      {"kernel", CheckVerdict::kWarning, "linux-image-rt-amd64",
       [](SystemFacts& f) { f.tried.kernel = device::KernelKind::kDynamic; }},
      {"CPUs", CheckVerdict::kWarning, "two CPUs", [](SystemFacts& f) { f.tried.cpus = 1; }},
      {"CPU governor", CheckVerdict::kWarning, "--governor performance",
       [](SystemFacts& f) {
         f.cpu_governors = {"performance", "powersave"};
       }},
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
    EXPECT_TRUE(any_line(found, one.remedy)) << one.about << ": " << json(found.remedy);
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

TEST_F(Devices, KnowNoOtherArguments) {
  refuses("--doctor", "list devices --doctr");
}

}  // namespace
}  // namespace palpate::experiments
