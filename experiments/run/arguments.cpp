#include "experiments/run/arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include <palpate/result.h>
#include <palpate/scene.h>
#include <palpate/trace.h>
#include "device/record/recording.h"
#include "experiments/run/cleaning.h"
#include "experiments/run/recorded_path.h"
#include "toolkit/core/message_text.h"

namespace palpate::experiments {
namespace {

constexpr std::size_t kLongestLabel = 64;  // becomes part of a file name

Status check_label(const std::string& label) {
  constexpr const char* kFileLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  if (label.empty() || label.size() > kLongestLabel || label.front() == '.' ||
      label.find_first_not_of(kFileLetters) != std::string::npos)
    return Error{fmt::format("'{}' cannot be a label", label),
                 fmt::format("labels have 1 to {} letters, digits, dots, - and _", kLongestLabel),
                 {},
                 0};
  return Done{};
}

Result<trace::ProbePath> read_recording(const NamedOptions& named, std::uint64_t max_bytes) {
  const Result<Options> options = validate(named.options, recording_columns(), named.name);
  if (!options) return options.error();
  trace::TrajColumns columns;
  columns.t = static_cast<int>(options->integer("t"));
  columns.x = static_cast<int>(options->integer("x"));
  columns.y = static_cast<int>(options->integer("y"));
  columns.z = static_cast<int>(options->integer("z"));
  columns.mm_per_unit = options->number("mm_per_unit");
  columns.s_per_unit = options->number("s_per_unit");
  columns.sample_rate_hz = options->number("rate_hz");
  Result<trace::TrajRecording> recording = trace::read_traj(named.name, columns, max_bytes);
  if (!recording) return std::move(recording).error();
  return std::move(recording->path);
}

bool ends_in(const std::string& argument, const char* ending) {
  return std::filesystem::path(argument).extension() == ending;
}

std::vector<std::string> generator_names() {
  std::vector<std::string> all;
  for (const paths::PathGenerator& g : paths::path_generators()) all.push_back(g.name);
  return all;
}

}  // namespace

Result<RendererRequest> request_of(NamedOptions named, const render::Registry& registry) {
  RendererRequest request{named.name, named.name, {}, {}};
  for (const auto& [key, value] : named.options.all()) {
    if (key == "label") {
      request.label = value;
    } else if (key == "clean") {
      Result<std::vector<NamedOptions>> steps = all_cleaning().parse(value);
      if (!steps) return std::move(steps).error();
      request.clean = *std::move(steps);
    } else {
      request.options.set(key, value);
    }
  }
  PALPATE_TRY(check_label(request.label));
  // Making one checks the name and every option; nothing is prepared.
  if (Result<std::unique_ptr<render::HapticRenderer>> made = registry.make(request.name, request.options);
      !made) {
    Error error = std::move(made).error();
    std::vector<std::string> known;
    for (const render::RendererInfo& info : registry.all()) known.push_back(info.name);
    const std::string near = registry.find(request.name) == nullptr ? nearest_name(request.name, known) : "";
    if (!near.empty()) error.remedy = fmt::format("did you mean '{}'? {}", near, error.remedy);
    return error;
  }
  return request;
}

Result<std::vector<RendererRequest>> parse_renderers(std::string_view text,
                                                     const render::Registry& registry) {
  std::vector<RendererRequest> requests;
  std::set<std::string> labels;
  for (const std::string& item : split_list(text)) {
    Result<NamedOptions> named = parse_named_options(item);
    if (!named) return std::move(named).error();
    Result<RendererRequest> request = request_of(*std::move(named), registry);
    if (!request) return std::move(request).error();
    if (!labels.insert(request->label).second)
      return Error{fmt::format("two renderers are called '{}'", request->label),
                   fmt::format("name one: {}:label=another", item),
                   {},
                   0};
    requests.push_back(*std::move(request));
  }
  return requests;
}

std::string file_of_path(const std::string& argument) {
  std::error_code code;
  if (std::filesystem::exists(argument, code)) return argument;
  const Result<NamedOptions> named = parse_named_options(argument);
  return named && std::filesystem::exists(named->name, code) ? named->name : std::string();
}

bool is_generated_path(const std::string& argument) {
  std::error_code code;
  if (std::filesystem::exists(argument, code)) return false;
  const Result<NamedOptions> named = parse_named_options(argument);
  return named && paths::find_path_generator(named->name) != nullptr;
}

bool is_recorded_session(const std::string& argument) {
  return ends_in(argument, ".palrec") || device::is_recording(argument);
}

const std::vector<OptionSpec>& recording_columns() {
  static const std::vector<OptionSpec> specs = {
      {"t", OptionKind::kInteger, "0", "column of the time, counted from 0; -1: none", {}, -1, 1000},
      {"x", OptionKind::kInteger, "1", "column of x", {}, 0, 1000},
      {"y", OptionKind::kInteger, "2", "column of y", {}, 0, 1000},
      {"z", OptionKind::kInteger, "3", "column of z", {}, 0, 1000},
      {"mm_per_unit", OptionKind::kNumber, "1", "the file's unit of length, mm", {}, 1e-12, 1e12},
      {"s_per_unit",
       OptionKind::kNumber,
       "1",
       "the file's unit of time, s",
       {},
       1e-12,
       1e12,
       {{"t", {"-1"}, true}}},
      {"rate_hz",
       OptionKind::kNumber,
       "0",
       "samples a second, where there is no column of time",
       {},
       0,
       1e9,
       {{"t", {"-1"}}}}};
  return specs;
}

Result<trace::ProbePath> open_path(const std::string& argument, const paths::PathTarget& target,
                                   std::uint64_t max_bytes, std::vector<std::string>* warnings) {
  std::error_code code;
  const bool exists = std::filesystem::exists(argument, code);
  if (exists && is_recorded_session(argument)) {
    PALPATE_ASSIGN(RecordedPath recorded, path_of_recording(argument, max_bytes));
    if (warnings != nullptr)
      warnings->insert(warnings->end(), recorded.warnings.begin(), recorded.warnings.end());
    return std::move(recorded.path);
  }
  if (exists && !ends_in(argument, ".traj")) return trace::read_path_csv(argument, max_bytes);
  Result<NamedOptions> named = exists ? NamedOptions{argument, {}} : parse_named_options(argument);
  if (!named) return std::move(named).error();
  if (!exists && paths::find_path_generator(named->name) != nullptr) return paths::make_path(*named, target);
  if (exists || ends_in(named->name, ".traj") || std::filesystem::exists(named->name, code))
    return read_recording(*named, max_bytes);
  if (ends_in(argument, ".csv")) return trace::read_path_csv(argument, max_bytes);
  return Error{"there is no such file, and no path generator of this name",
               did_you_mean(named->name, generator_names(),
                            "give a .csv or .traj file, or one of " + joined(generator_names()) +
                                " (`palpate list paths`)"),
               argument, 0};
}

}  // namespace palpate::experiments
