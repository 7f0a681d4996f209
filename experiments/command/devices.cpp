#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include <palpate/paths.h>
#include <palpate/trace.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/doctor.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
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

// Lists of names: renderers, paths and cleaning steps.

namespace {

struct ListArguments {
  std::string name;  ///< empty: all
  bool json = false;
};

void declare_list(const Declaration& declare, ListArguments& a) {
  declare.text("NAME", a.name, "show options, defaults and source of this one (default: a line for each)");
  declare_json(declare, a.json);
}

/// Prints all, or the named one, and what is said below.
Result<int> print_entries(std::vector<CatalogueEntry> entries, const ListArguments& arguments,
                          const char* list, const char* below) {
  PALPATE_TRY(keep_named(entries, arguments.name));
  print_catalogue(entries, arguments.json);
  if (arguments.json) return kExitOk;
  if (arguments.name.empty())
    fmt::print("`palpate list {} NAME` shows options, defaults and source.\n", list);
  fmt::print("{}", below);
  return kExitOk;
}

Result<int> print_renderers(const ListArguments& arguments, Context& /*context*/) {
  const render::Registry registry = all_renderers();
  std::vector<CatalogueEntry> entries;
  for (const render::RendererInfo& info : registry.all())
    entries.push_back({info.name, info.summary, info.source, info.options, std::string(name_of(info.role)),
                       std::string(name_of(info.geometry)), names_of(info.supports)});
  return print_entries(
      std::move(entries), arguments, "renderers",
      "Options follow the name after colons, as in cloud:refine=1; label=TEXT names one used twice;\n"
      "clean=STEP+STEP cleans the points before (`palpate list steps`).\n");
}

Result<int> print_steps(const ListArguments& arguments, Context& /*context*/) {
  std::vector<CatalogueEntry> entries;
  for (const scene::CleaningStep& step : all_cleaning().all())
    entries.push_back({step.name, step.summary, step.source, step.options, {}, {}, {}});
  return print_entries(
      std::move(entries), arguments, "steps",
      "Options follow the step after slashes, steps are joined by +: outliers/distance=3+smooth.\nLengths "
      "are in spacings: the square root of the occupied area per point.\n");
}

CatalogueEntry entry(const std::string& name, const std::string& summary, std::span<const OptionSpec> options,
                     const std::string& models, const std::string& example) {
  CatalogueEntry made{name, summary, {}, options};
  made.models = models;
  made.example = example;
  return made;
}

Result<int> print_paths(const ListArguments& arguments, Context& /*context*/) {
  std::vector<CatalogueEntry> entries;
  for (const paths::PathGenerator& g : paths::path_generators())
    entries.push_back(entry(g.name, g.summary, g.options, g.models, g.example));
  entries.push_back(entry("FILE.csv",
                          fmt::format("a recorded path; its first line is {}", trace::kPathHeader), {}, "any",
                          "probe.csv"));
  entries.push_back(entry("FILE.traj",
                          "a recorded path in columns, separated by blanks, tabs, commas or semicolons; a "
                          "first line of names, and lines that begin with # or %, are skipped",
                          recording_columns(), "any", "probe.traj:t=0:x=1:y=2:z=3:mm_per_unit=1000"));
  return print_entries(std::move(entries), arguments, "paths",
                       "Options follow the name after colons. A recording of any other ending: --path "
                       "probe.txt:t=0:x=1:y=2:z=3.\n"
                       "Lengths are in mm of the model's frame; docs/reference/documents.md says more.\n");
}

}  // namespace

Subcommand renderers_subcommand() {
  return subcommand(
      "list renderers", "the renderers, a line each; with NAME, one's options, defaults and source",
      {"palpate list renderers", "palpate list renderers cloud"}, declare_list, print_renderers);
}

Subcommand paths_subcommand() {
  return subcommand("list paths",
                    "the probe paths that --path takes: generators with their options, and recorded files",
                    {"palpate list paths", "palpate list paths tap",
                     "palpate compare sinusoid:points=10201 --renderers cloud --path "
                     "raster:lines=8:speed_mm_s=100 --out out/raster"},
                    declare_list, print_paths);
}

Subcommand steps_subcommand() {
  return subcommand("list steps",
                    "the steps that clean points, a line each; with NAME, one's options and defaults",
                    {"palpate list steps", "palpate list steps outliers"}, declare_list, print_steps);
}

}  // namespace palpate::experiments
