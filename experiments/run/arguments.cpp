#include "experiments/run/arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>
#include <utility>

#include <palpate/options.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include <palpate/trace.h>
#include "device/record/recording.h"
#include "experiments/run/stage.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/io/decoding.h"

namespace palpate::experiments {
namespace {

constexpr std::size_t kLongestLabel = 64;  // becomes part of a file name

Status check_label(const std::string& label) {
  constexpr const char* kFileLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
  if (label.empty() || label.size() > kLongestLabel || label.front() == '.' ||
      label.find_first_not_of(kFileLetters) != std::string::npos)
    return Error{fmt::format("'{}' cannot be a label", label),
                 fmt::format("labels have 1 to {} letters, digits, dots, - and _", kLongestLabel)};
  return Done{};
}

Result<trace::ProbePath> read_recording(const NamedOptions& named, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(const Options options, validate(named.options, recording_columns(), named.name));
  trace::TrajColumns columns;
  columns.t = static_cast<int>(options.integer("t"));
  columns.x = static_cast<int>(options.integer("x"));
  columns.y = static_cast<int>(options.integer("y"));
  columns.z = static_cast<int>(options.integer("z"));
  columns.mm_per_unit = options.number("mm_per_unit");
  columns.s_per_unit = options.number("s_per_unit");
  columns.sample_rate_hz = options.number("rate_hz");
  PALPATE_ASSIGN(trace::TrajRecording recording, trace::read_traj(named.name, columns, max_bytes));
  return std::move(recording.path);
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
      PALPATE_ASSIGN(request.clean, all_cleaning().parse(value));
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
    PALPATE_ASSIGN(NamedOptions named, parse_named_options(item));
    PALPATE_ASSIGN(RendererRequest request, request_of(std::move(named), registry));
    if (!labels.insert(request.label).second)
      return Error{fmt::format("two renderers are called '{}'", request.label),
                   fmt::format("name one: {}:label=another", item)};
    requests.push_back(std::move(request));
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
  PALPATE_ASSIGN(NamedOptions named, exists ? NamedOptions{argument, {}} : parse_named_options(argument));
  if (!exists && paths::find_path_generator(named.name) != nullptr) return paths::make_path(named, target);
  if (exists || ends_in(named.name, ".traj") || std::filesystem::exists(named.name, code))
    return read_recording(named, max_bytes);
  if (ends_in(argument, ".csv")) return trace::read_path_csv(argument, max_bytes);
  return Error{"there is no such file, and no path generator of this name",
               did_you_mean(named.name, generator_names(),
                            "give a .csv or .traj file, or one of " + joined(generator_names()) +
                                " (`palpate list paths`)"),
               argument};
}

namespace {

constexpr std::uint64_t kBytesASample = sizeof(double) + sizeof(Vec3);
// Time from a release before the first step to that step, where nothing is before it: a frame at 1 kHz.
constexpr double kBeforeS = 1e-3;

class WayOfCalls {
 public:
  explicit WayOfCalls(trace::ProbePath& path) : path_(path) {}

  void add(const device::RendererCall& call) {
    if (!is_finite(call.hip_mm)) return;
    if (call.kind == device::RendererCall::Kind::kReleaseContact) {
      free_mm_ = call.hip_mm;
      released_ = true;
      return;
    }
    if (std::exchange(released_, false)) {
      const double before_s = path_.size() > 0 ? path_.t_s.back() : call.t_s - 2.0 * kBeforeS;
      push(free_mm_, 0.5 * (before_s + call.t_s));
    }
    push(call.hip_mm, call.t_s);
  }

 private:
  void push(const Vec3& hip_mm, double t_s) {
    if (path_.size() > 0 && !(t_s > path_.t_s.back())) return;
    path_.t_s.push_back(t_s);
    path_.hip_mm.push_back(hip_mm);
  }
  trace::ProbePath& path_;
  Vec3 free_mm_ = Vec3::Zero();  // where it let go, and did not step since
  bool released_ = false;
};

}  // namespace

Result<RecordedPath> path_of_recording(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(device::Recording recording, device::Recording::open(file));
  RecordedPath recorded;
  recorded.path.name = file;
  WayOfCalls way(recorded.path);
  device::RecordedTick tick;
  for (;;) {
    PALPATE_ASSIGN(const bool more, recording.next(tick));
    if (!more) break;
    for (const device::RecordedTrack& track : tick.tracked()) {
      if (track.calls.empty()) continue;
      for (const device::RendererCall& call : track.calls) way.add(call);
      break;
    }
    if (recorded.path.size() * kBytesASample > max_bytes)
      return over_memory_limit("the path of " + file, max_bytes);
  }
  recorded.warnings = recording.end().warnings();
  if (recorded.path.size() == 0)
    return Error{"holds no step of any renderer", "record a session in which the device was held", file};
  return recorded;
}

namespace {

/// A value that the command line gives to every model.
struct Given {
  std::optional<double> stiffness_n_per_mm;
  std::optional<surface::Friction> friction;
  std::optional<double> deformation;
};

Result<double> number(const char* option, const std::string& text, const NumberRange& range) {
  Result<double> value = read_number(text, range);
  if (!value) return Error{fmt::format("--{}: {}", option, value.error().what), value.error().remedy};
  return value;
}

Result<surface::Friction> friction(const std::string& text) {
  std::vector<double> values;
  for (const std::string& part : split_list(text)) {
    PALPATE_ASSIGN(const double mu, number("friction", part, kFrictionCoefficients));
    values.push_back(mu);
  }
  if (values.size() > 2 || values.back() > values.front())
    return Error{
        fmt::format("--friction: {} is not one coefficient, or a static and then a dynamic one, not larger",
                    shown(text)),
        "write one number, or two as in 0.7,0.5"};
  return surface::Friction{values.front(), values.back()};
}

Result<Given> parse(const SurfaceArguments& arguments) {
  Given given;
  if (!arguments.stiffness.empty()) {
    PALPATE_ASSIGN(const double k, number("stiffness", arguments.stiffness, kStiffnessesNPerMm));
    given.stiffness_n_per_mm = k;
  }
  if (!arguments.friction.empty()) {
    PALPATE_ASSIGN(const surface::Friction mu, friction(arguments.friction));
    given.friction = mu;
  }
  if (!arguments.deformation.empty()) {
    PALPATE_ASSIGN(const double c, number("deformation", arguments.deformation, {0.0, 1.0}));
    if (!(c < 1.0))
      return Error{"--deformation: 1 would take all of the force away", "give a number from 0, below 1"};
    given.deformation = c;
  }
  return given;
}

/// A value from the command line beside one that the scene takes point by point.
Status check_source(const scene::SceneFile& scene, const scene::SceneModel& model, const char* option,
                    bool given, const std::string& source) {
  if (!given || source.empty()) return Done{};
  return Error{
      fmt::format("--{} cannot hold: '{}' takes it point by point from {}", option, model.name, source),
      "leave the option out, or take the key out of the scene", scene.path, model.sources.line};
}

Status check_sources(const scene::SceneFile& scene, const scene::SceneModel& model, const Given& given) {
  const scene::SurfaceSources& s = model.sources;
  const auto column = [](const std::string& name) {
    return name.empty() ? std::string() : fmt::format("the column '{}'", name);
  };
  const std::string friction = s.friction_map ? fmt::format("the image {}", s.friction_map->image)
                                              : column(s.static_friction_column + s.dynamic_friction_column);
  for (const auto& [option, is_given, source] :
       {std::tuple{"stiffness", given.stiffness_n_per_mm.has_value(), column(s.stiffness_column)},
        {"friction", given.friction.has_value(), friction},
        {"deformation", given.deformation.has_value(), column(s.deformation_column)}})
    PALPATE_TRY(check_source(scene, model, option, is_given, source));
  return Done{};
}

void set(const Given& given, scene::SceneModel& model, SurfaceReport& report) {
  if (given.stiffness_n_per_mm) model.surface.stiffness_n_per_mm = *given.stiffness_n_per_mm;
  if (given.friction) model.surface.friction = *given.friction;
  if (given.deformation) model.surface.deformation = *given.deformation;
  for (const scene::SceneRegion& region : model.regions)
    for (const auto& [option, keeps] :
         {std::pair{"stiffness", given.stiffness_n_per_mm && region.stiffness_n_per_mm},
          {"friction", given.friction && region.friction},
          {"deformation", given.deformation && region.deformation}})
      if (keeps)
        report.warnings.push_back(
            fmt::format("--{} does not hold in a region of '{}' (line {}), which has its own.", option,
                        model.name, region.line));
}

std::string text_of(const Given& given) {
  std::string text;
  const auto add = [&](const std::string& value) { text += (text.empty() ? "" : ", ") + value; };
  if (given.stiffness_n_per_mm) add(fmt::format("stiffness {} N/mm", *given.stiffness_n_per_mm));
  if (given.friction)
    add(fmt::format("friction {} static, {} dynamic", given.friction->static_coefficient,
                    given.friction->dynamic_coefficient));
  if (given.deformation) add(fmt::format("deformation {}", *given.deformation));
  return text;
}

}  // namespace

Result<SurfaceReport> set_surfaces(const SurfaceArguments& arguments, scene::SceneFile& scene) {
  SurfaceReport report;
  if (!arguments.any()) return report;
  PALPATE_ASSIGN(const Given given, parse(arguments));
  for (scene::SceneModel& model : scene.models) {
    PALPATE_TRY(check_sources(scene, model, given));
    set(given, model, report);
  }
  report.notes.push_back(fmt::format("From the command line, for every model: {}.", text_of(given)));
  return report;
}

namespace fs = std::filesystem;

Status check_output(const OutputFile& file, std::span<const std::string> read) {
  const auto wrong = [&](std::string what, std::string remedy) {
    return Error{std::move(what), std::move(remedy), file.path};
  };
  const fs::path path = file.path;
  std::string ending = io::lower_case(path.extension().string());
  if (!ending.empty()) ending.erase(0, 1);
  if (std::find(file.endings.begin(), file.endings.end(), ending) == file.endings.end()) {
    std::string known;
    for (const std::string& e : file.endings) known += (known.empty() ? "." : ", .") + e;
    return wrong(ending.empty() ? std::string("the name has no ending that says the format")
                                : fmt::format("no file ending in .{} can be written here", ending),
                 fmt::format("give it one of {}", known));
  }
  std::error_code code;
  const fs::path folder = path.parent_path();
  if (!folder.empty() && !fs::is_directory(folder, code))
    return wrong("the folder for it is not there", "create the folder first");
  if (!fs::exists(path, code)) return Done{};
  if (!fs::is_regular_file(path, code)) return wrong("is not a plain file", "give another name");
  if (file.force) return Done{};
  for (const std::string& input : read)
    if (fs::equivalent(path, input, code))
      return wrong("is read by this command, and would be overwritten", "give another name, or --force");
  if (!io::is_written_by_palpate(file.path))
    return wrong("is there already, and Palpate did not write it",
                 "give another name, or --force to replace it");
  return Done{};
}

}  // namespace palpate::experiments
