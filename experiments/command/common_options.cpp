#include "experiments/command/common_options.h"

#include <fmt/format.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include <cmath>

#include <palpate/options.h>
#include "experiments/report/tables.h"
#include "experiments/session/session.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"

namespace palpate::experiments {

void declare_threads(const Declaration& declare, int& threads) {
  declare.shared().integer("--threads", threads, kThreads, "threads that prepare (default: all)");
}

void declare_json(const Declaration& declare, bool& json) {
  declare.shared().flag("--json", json, "print the result as JSON");
}

void declare_force(const Declaration& declare, bool& force) {
  declare.shared().flag("--force", force,
                        "let the output replace an input, or a file that Palpate did not write");
}

void declare_out(const Declaration& declare, std::string& out) {
  declare.shared().text("--out", out, "folder for the results (default: one in out/, named after the model)");
}

void declare_required_out(const Declaration& declare, std::string& out) {
  declare.shared().required("--out", out, "folder for the results; an interrupted run in it is resumed");
}

void declare_renderers(const Declaration& declare, std::string& renderers, const std::string& usual) {
  declare.text("--renderers", renderers,
               "A,B,..: each NAME[:option=value..][:label=TEXT] (default: " + usual + ")");
}

void declare_renderer(const Declaration& declare, std::string& renderer) {
  declare.text("--renderer", renderer,
               "NAME[:option=value..] (default: the scene's, or what info plan chooses)");
}

void declare_path(const Declaration& declare, std::string& path, const std::string& usual) {
  declare.text(
      "--path", path,
      "a file or a generator (`palpate list paths`) such as weave:frames=20000 (default: " + usual + ")");
}

void declare_scene_or_stream(const Declaration& declare, RunArguments& run) {
  declare.text("SCENE", run.scene, kSceneHelp);
  declare.text("--stream", run.stream,
               "depth images instead of SCENE: a folder, a recorded session, sim:wall, openni");
}

void declare_reference(const Declaration& declare, std::string& reference) {
  declare.text("--reference", reference,
               "ground truth: auto, analytic, original-mesh, closest-point, none, or a mesh file or known "
               "scan in the model's frame (default: auto)");
}

void declare_model(const Declaration& declare, ModelArguments& load) {
  const Declaration rare = declare.rare();
  declare.shared().text("--unit", load.unit,
                        "unit of the model file: m, cm, mm, um, in (default: what the file says)");
  rare.number("--scale", load.scale, kScales,
              "factor on all lengths, after --unit (default: the scene's, or 1)");
  rare.number("--post-mm", load.post_mm, kLengthsMm,
              "height grids: distance between posts in mm, before --scale (default: what the file says)");
  rare.number("--vertical-mm", load.vertical_mm, kLengthsMm,
              "height grids: mm that a height of 1 stands for, before --scale (default: the unit)");
  rare.text("--no-data", load.no_data,
            "height grids: the number that marks a missing height (default: what the file says)");
  rare.text("--within", load.within,
            "X,Y,Z,X,Y,Z: only the points in this box, its low and its high corner in mm, after --scale "
            "(default: all, or the scene's)");
  rare.choice("--non-finite", load.non_finite, {"drop", "refuse"},
              "points with NaN or infinite coordinates: drop (and count) or refuse (default: drop)");
  rare.number("--memory-limit-gb", load.memory_limit_gb, kGigabytes,
              fmt::format("memory that reading one file may take, GB (default: {:.3g})",
                          static_cast<double>(kMemoryLimitBytes) / kBytesPerGb));
  declare_threads(declare, load.threads);
}

void declare_surface(const Declaration& declare, SurfaceArguments& surface) {
  const Declaration shared = declare.shared();
  shared.text("--stiffness", surface.stiffness,
              "stiffness of every model, N/mm (default: the scene's, or 0.5)");
  shared.text("--friction", surface.friction,
              "friction coefficient of every model, or STATIC,DYNAMIC (default: the scene's)");
  shared.text("--deformation", surface.deformation,
              "share of the force that deformation removes, below 1 (default: the scene's)");
}

void declare_scene_run(const Declaration& declare, RunArguments& run) {
  declare_reference(declare.rare(), run.reference);
  declare_out(declare, run.out);
  declare_json(declare, run.json);
  declare.verbose();
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
}

void declare_trade(const Declaration& declare, SweepArguments& trade) {
  RunArguments& run = trade.run;
  run.passes = kSweepPasses;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare_renderers(declare, run.renderers, "all that support the scene");
  declare.text("--axes", trade.axes,
               "what is varied, separated by commas: " + joined(names_of(axes())) + " (default: all)");
  declare_path(declare, run.path, "six seconds, fitted to the model");
  declare.rare().integer(
      "--passes", run.passes, kPasses,
      fmt::format("timed passes of each kind per setting, interleaved (default: {})", kSweepPasses));
  declare_reference(declare, run.reference);
  declare_out(declare, run.out);
  declare_json(declare, run.json);
  declare.cases();
  declare_model(declare, run.load);
}

void declare_device(const Declaration& declare, DeviceArguments& device) {
  declare.text("--device", device.device,
               "sim:NAME (omni, touch, falcon, omega3 or admittance), or another of `palpate list devices` "
               "(default: sim, which is sim:omni)");
  declare.text("--grip", device.grip,
               "how a simulated hand holds it: hand, finger, arm or released (default: hand)");
  declare_device_details(declare, device);
}

void declare_device_details(const Declaration& declare, DeviceArguments& device) {
  constexpr NumberRange kKillAfter{0.0, 10'000.0};
  const Declaration rare = declare.rare();
  rare.text("--device-file", device.file, "a device description, for drivers that take one");
  rare.repeated("--device-option", device.options, "KEY=VALUE for the device's driver; can be repeated");
  rare.number("--guard-kill-after", device.guard_kill_after_ms, kKillAfter,
              "ms without a tick after which the guard process of a real device takes this program for hung, "
              "kills it and commands zero force (default: 0, never)");
}

namespace {

const char* kind_name(OptionKind kind) {
  switch (kind) {
    case OptionKind::kText:
      return "text";
    case OptionKind::kNumber:
      return "number";
    case OptionKind::kInteger:
      return "integer";
    case OptionKind::kFlag:
      return "flag";
    case OptionKind::kChoice:
      return "choice";
  }
  return "text";
}

/// Options with which the option acts; empty: always.
std::string conditions(const OptionSpec& spec) {
  std::string all;
  for (const OptionCondition& condition : spec.only_with)
    all += (all.empty() ? "" : ", and with ") + text_of(condition);
  return all;
}

/// The bounds that are no mere guard against overflow.
struct Range {
  std::optional<double> low, high;
};

Range range_of(const OptionSpec& spec) {
  // Lengths and speeds may be anything that can be squared and stays a number.
  constexpr double kSmall = 1e-100, kLarge = 1e100;
  Range range;
  if (spec.kind != OptionKind::kNumber && spec.kind != OptionKind::kInteger) return range;
  if (spec.low > -kLarge) range.low = std::abs(spec.low) < kSmall ? 0.0 : spec.low;
  if (spec.high < kLarge) range.high = spec.high;
  return range;
}

std::string range_text(const OptionSpec& spec) {
  const Range range = range_of(spec);
  const char* const least = spec.low > 0.0 && range.low == 0.0 ? "above" : "at least";
  if (range.low && range.high) return fmt::format("{} to {}", *range.low, *range.high);
  if (range.low) return fmt::format("{} {}", least, *range.low);
  if (range.high) return fmt::format("at most {}", *range.high);
  return {};
}

void print_json(std::span<const CatalogueEntry> entries) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const CatalogueEntry& entry : entries) {
    nlohmann::ordered_json options = nlohmann::ordered_json::array();
    for (const OptionSpec& spec : entry.options) {
      nlohmann::ordered_json option = {{"key", spec.key},
                                       {"kind", kind_name(spec.kind)},
                                       {"default", spec.default_value},
                                       {"choices", spec.choices},
                                       {"help", spec.help},
                                       {"only_with", conditions(spec)}};
      const Range range = range_of(spec);
      if (range.low) option["low"] = *range.low;
      if (range.high) option["high"] = *range.high;
      options.push_back(std::move(option));
    }
    nlohmann::ordered_json one = {{"name", entry.name}, {"summary", entry.summary}};
    if (!entry.source.empty()) one["source"] = entry.source;
    if (!entry.role.empty()) {
      one["role"] = entry.role;
      one["works_on"] = entry.works_on;
      one["supports"] = entry.supports;
    }
    if (!entry.models.empty()) one["models"] = entry.models;
    if (!entry.example.empty()) one["example"] = entry.example;
    one["options"] = std::move(options);
    list.push_back(std::move(one));
  }
  fmt::print("{}\n", list.dump(2));
}

}  // namespace

Status keep_named(std::vector<CatalogueEntry>& entries, const std::string& name) {
  if (name.empty()) return Done{};
  std::vector<std::string> names;
  for (const CatalogueEntry& entry : entries) names.push_back(entry.name);
  std::erase_if(entries, [&](const CatalogueEntry& entry) { return entry.name != name; });
  if (!entries.empty()) return Done{};
  return Error{"none of them is called " + shown(name),
               did_you_mean(name, names, "they are " + joined(names))};
}

void print_catalogue(std::span<const CatalogueEntry> entries, bool json) {
  if (json) return print_json(entries);
  if (entries.size() > 1) {
    Table table;
    table.columns = {"name", "what it is"};
    for (const CatalogueEntry& entry : entries) table.rows.push_back(plain_row({entry.name, entry.summary}));
    return fmt::print("{}\n", to_text(table, terminal_columns(STDOUT_FILENO)));
  }
  for (const CatalogueEntry& entry : entries) {
    fmt::print("{}\n  {}\n", entry.name, entry.summary);
    for (const auto& [about, text] :
         {std::pair{"source", &entry.source}, {"models", &entry.models}, {"example", &entry.example}})
      if (!text->empty()) fmt::print("  {}: {}\n", about, *text);
    if (!entry.role.empty())
      fmt::print("  role: {}, works on {}{}; supports: {}\n", entry.role, entry.works_on,
                 entry.works_on == "formula"  ? " (generated models only)"
                 : entry.works_on == "images" ? " (streams only)"
                                              : "",
                 entry.supports.empty() ? "no surface property"
                                        : fmt::format("{}", fmt::join(entry.supports, ", ")));
    for (const OptionSpec& spec : entry.options) {
      std::string values = range_text(spec);
      for (const std::string& c : spec.choices) values += (values.empty() ? "" : "|") + c;
      const std::string only = conditions(spec);
      fmt::print("    {}={}  {}{}{}\n", spec.key, spec.default_value, spec.help,
                 values.empty() ? "" : "  (" + values + ")",
                 only.empty() ? "" : "  (only with " + only + ")");
    }
    fmt::print("\n");
  }
}

}  // namespace palpate::experiments
