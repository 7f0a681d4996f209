#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/device_report.h"
#include "experiments/live/doctor.h"
#include "experiments/run/arguments.h"
#include "experiments/session/session.h"
#include "toolkit/core/files.h"

namespace palpate::experiments {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kDevicesSchema = "palpate-devices/1";

/// Without --report none is looked at.
DeviceArguments no_device() {
  DeviceArguments none;
  none.device.clear();
  return none;
}

struct DevicesArguments {
  bool doctor = false;
  bool json = false;
  bool replace = false;
  DeviceArguments report = no_device();
  ReportOptions look;
  std::string out;
};

/// A driver's entry, with the driver.
struct Listed {
  std::string driver, transport;
  device::DeviceEntry entry;
};

std::vector<Listed> listed() {
  std::vector<Listed> all;
  for (const device::Driver& driver : session_drivers().all())
    for (device::DeviceEntry& entry : driver.look())
      all.push_back({driver.name, driver.transport, std::move(entry)});
  return all;
}

void print_json(const std::vector<Listed>& devices, const std::vector<Check>* checks) {
  Json list = Json::array();
  for (const Listed& d : devices)
    list.push_back({{"driver", d.driver},
                    {"name", d.entry.name},
                    {"transport", d.transport},
                    {"status", device::device_status_name(d.entry.status)},
                    {"what", d.entry.what},
                    {"needs", d.entry.needs}});
  Json document = {{"schema", kDevicesSchema}, {"devices", std::move(list)}};
  if (checks != nullptr) {
    Json judged = Json::array();
    for (const Check& check : *checks)
      judged.push_back({{"about", check.about},
                        {"verdict", verdict_name(check.verdict)},
                        {"found", check.found},
                        {"remedy", check.remedy}});
    document["checks"] = std::move(judged);
  }
  fmt::print("{}\n", document.dump(2));
}

void print_devices(const std::vector<Listed>& devices) {
  std::size_t name = 0, transport = 0;
  for (const Listed& d : devices) {
    name = std::max(name, d.entry.name.size());
    transport = std::max(transport, d.transport.size());
  }
  for (const Listed& d : devices) {
    fmt::print("{:<{}}  {:<{}}  {:<7}  {}\n", d.entry.name, name, d.transport, transport,
               device::device_status_name(d.entry.status), d.entry.what);
    for (const std::string& need : d.entry.needs) fmt::print("{:<{}}  needs {}\n", "", name, need);
  }
}

void print_checks(const std::vector<Check>& checks) {
  std::size_t warnings = 0, problems = 0;
  fmt::print("\n");
  for (const Check& check : checks) {
    warnings += check.verdict == CheckVerdict::kWarning ? 1 : 0;
    problems += check.verdict == CheckVerdict::kProblem ? 1 : 0;
    fmt::print("{:<7}  {}: {}\n", verdict_name(check.verdict), check.about, check.found);
    for (const std::string& line : check.remedy) fmt::print("         {}\n", line);
  }
  if (problems > 0)
    fmt::print("\n{} of {} checks found a problem: a session would not run in time.\n", problems,
               checks.size());
  else if (warnings > 0)
    fmt::print("\nA simulated session runs. {} warnings matter once a device is felt.\n", warnings);
  else
    fmt::print("\nAll is well.\n");
}

void declare_devices(const Declaration& declare, DevicesArguments& a) {
  declare.flag("--doctor", a.doctor,
               "also check limits, kernel, timer, CPUs and permissions, each with its remedy (a tenth of a "
               "second); exit status 1 if a simulated session would not run in time");
  declare_json(declare, a.json);
  declare.text("--report", a.report.device,
               "NAME: opens this device, commands zero force, and prints as JSON what its first user should "
               "send to us: ids, packets, latency, homing, calibration. Move the device meanwhile");
  declare.text("--out", a.out, "FILE.json: where the report goes (default: standard output)");
  declare_force(declare, a.replace);
  constexpr NumberRange kSeconds{0.1, 3600.0};
  declare.number("--seconds", a.look.seconds, kSeconds, "how long the report takes (default: 5)");
  declare_rate(declare, a.look.rate_hz);
  declare_device_details(declare, a.report);
}

/// Exit status 1 where the device does not open: the report says why.
Result<int> run_device_report(const DevicesArguments& a, Context& context) {
  if (!a.out.empty()) PALPATE_TRY(check_output({a.out, {"json"}, a.replace}, {}));
  PALPATE_ASSIGN(const ReportedDevice reported,
                 report_device(a.report, session_drivers(), a.look, new_head(context.command_line)));
  if (a.out.empty())
    fmt::print("{}", reported.json);
  else
    PALPATE_TRY(write_file(a.out, reported.json));
  context.working = true;
  if (reported.not_opened) return *reported.not_opened;
  return kExitOk;
}

Result<int> run_devices(const DevicesArguments& arguments, Context& context) {
  if (!arguments.report.device.empty()) return run_device_report(arguments, context);
  const std::vector<Listed> devices = listed();
  std::vector<Check> checks;
  if (arguments.doctor) checks = examine(read_system_facts());
  if (arguments.json) {
    print_json(devices, arguments.doctor ? &checks : nullptr);
  } else {
    print_devices(devices);
    if (arguments.doctor) print_checks(checks);
  }
  const bool problem = std::any_of(checks.begin(), checks.end(),
                                   [](const Check& c) { return c.verdict == CheckVerdict::kProblem; });
  return problem ? kExitFellShort : kExitOk;
}

}  // namespace

Subcommand devices_subcommand() {
  return subcommand(
      "list devices",
      "haptic devices, connected and supported; --doctor checks whether a servo loop runs in time here",
      {"palpate list devices", "palpate list devices --doctor", "palpate list devices --json",
       "palpate list devices --report sim:omni --seconds 1 --out report.json"},
      declare_devices, run_devices);
}

}  // namespace palpate::experiments
