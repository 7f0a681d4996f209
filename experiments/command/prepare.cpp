#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/report/tables.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/io/point_stream.h"
#include "toolkit/prepared/prepare.h"
#include "toolkit/prepared/prepare_journal.h"
#include "toolkit/render/prepare.h"
#include "toolkit/spline_sdf/prepared_surface.h"

namespace palpate::experiments {
namespace {

/// Of a file of surfaces, and of one of cells of points.
constexpr const char *kSurfaces = "palsurf", *kCells = "palcells";

struct PrepareArguments {
  std::string model, out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};

/// Whether the file is there and was made by this command: then a new one may replace it.
bool is_prepared(const std::string& path) {
  const std::vector<std::byte> first = first_bytes(path);
  return spline_sdf::SurfaceFile::begins_as_one(first) || prepared::CellFile::begins_as_one(first);
}

void declare_prepare(const Declaration& declare, PrepareArguments& a) {
  declare.required("MODEL", a.model, kSceneHelp);
  declare.required(
      "--out", a.out,
      fmt::format("the file to write: .{} for the surface, .{} for the points of a scan, or of a "
                  "folder of its tiles, that may be larger than memory",
                  kSurfaces, kCells));
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_model(declare, a.load);
}

void print_prepared(const spline_sdf::SurfaceFile& file, const render::PrepareReport& report, bool json) {
  if (json) {
    nlohmann::ordered_json phases = nlohmann::ordered_json::array();
    for (const render::PreparePhase& phase : report.phases)
      phases.push_back({{"name", phase.name}, {"ms", phase.ms}});
    fmt::print("{}\n", nlohmann::ordered_json{{"points", file.points()},
                                              {"bytes", file.bytes()},
                                              {"surfaces", file.surfaces().size()},
                                              {"phases", phases},
                                              {"warnings", report.warnings}}
                           .dump(2));
    return;
  }
  for (const render::PreparePhase& phase : report.phases)
    fmt::print("{:>10}  {}\n", format_duration(phase.ms), phase.name);
  fmt::print("{} points prepared in {} surfaces, {:.3g} MB, {:.3g} bytes a point: {}\n", file.points(),
             file.surfaces().size(), static_cast<double>(file.bytes()) * 1e-6,
             static_cast<double>(file.bytes()) / static_cast<double>(file.points()), file.path());
}

/// The unit that was given, or that of the file: without one nothing is guessed, since the points are not
/// seen before.
Result<double> mm_per_number(const PrepareArguments& arguments, const io::StreamHeader& header) {
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  const std::optional<io::Unit> unit = options.unit  ? options.unit
                                       : header.unit ? header.unit
                                                     : header.conventional_unit;
  if (!unit)
    return Error{"the file does not say its unit", "give it: --unit m, cm, mm, um or in", arguments.model};
  return io::mm_per(*unit) * options.scale.value_or(1.0);
}

void print_cells(const prepared::PrepareCellsReport& report, double seconds, const std::string& path,
                 bool json) {
  const prepared::CellFileInfo& info = report.info;
  const auto points = static_cast<double>(std::max<std::uint64_t>(info.points, 1));
  if (json) {
    fmt::print("{}\n", nlohmann::ordered_json{{"points", info.points},
                                              {"dropped", info.dropped},
                                              {"halo_points", info.halo_points},
                                              {"cells", info.cells},
                                              {"quantum_mm", info.quantum_mm},
                                              {"bytes", report.file_bytes},
                                              {"scratch_bytes", report.scratch_bytes},
                                              {"resumed", report.resumed},
                                              {"seconds", seconds}}
                           .dump(2));
    return;
  }
  fmt::print("{} points in {} cells, each point within {:.3g} mm; {} were not finite\n", info.points,
             info.cells, 0.5 * info.quantum_mm, info.dropped);
  fmt::print("{:.3g} s, {:.3g} million points a second; {:.3g} bytes a point, scratch {:.3g}: {}\n", seconds,
             points * 1e-6 / std::max(seconds, 1e-9), static_cast<double>(report.file_bytes) / points,
             static_cast<double>(report.scratch_bytes) / points, path);
}

std::uint64_t memory_bound(const PrepareArguments& arguments) {
  return arguments.load.memory_limit_gb > 0.0
             ? static_cast<std::uint64_t>(arguments.load.memory_limit_gb * kBytesPerGb)
             : prepared::kPrepareMemoryBytes;
}

Result<std::unique_ptr<io::PointStream>> open_stream(const PrepareArguments& arguments) {
  return std::filesystem::is_directory(arguments.model)
             ? io::open_folder_stream(arguments.model, arguments.load.threads)
             : io::open_point_stream(arguments.model, arguments.load.threads);
}

Result<prepared::PrepareCellsOptions> cells_options(const PrepareArguments& arguments,
                                                    const io::PointStream& stream) {
  prepared::PrepareCellsOptions options;
  PALPATE_ASSIGN(options.mm_per_unit, mm_per_number(arguments, stream.header()));
  options.threads = arguments.load.threads;
  options.memory_bytes = memory_bound(arguments);
  options.input_path = arguments.model;
  return options;
}

Status check_large_output(const PrepareArguments& arguments, const char* ending) {
  std::error_code none;
  if (std::filesystem::equivalent(std::filesystem::absolute(arguments.out, none).parent_path(),
                                  arguments.model, none))
    return Error{"the output would lie among the tiles, and the next run would read it as one",
                 "write it beside the folder", arguments.out};
  return check_output({arguments.out, {ending}, arguments.force || is_prepared(arguments.out)},
                      std::vector{arguments.model});
}

/// Sorts the points of a file, or of a folder of tiles, into cells; they never stand in memory together.
Result<int> run_cells(const PrepareArguments& arguments, Context& context) {
  PALPATE_TRY(check_large_output(arguments, kCells));
  PALPATE_ASSIGN(const std::unique_ptr<io::PointStream> stream, open_stream(arguments));
  PALPATE_ASSIGN(const prepared::PrepareCellsOptions options, cells_options(arguments, *stream));
  StopCallback stop_callback([&] { return arguments.out + " was not written; the same command goes on"; });
  const auto start = std::chrono::steady_clock::now();
  PALPATE_ASSIGN(const prepared::PrepareCellsReport report,
                 prepared::prepare_cells(*stream, options, arguments.out, context.progress));
  stop_callback.drop();
  context.progress.clear();
  for (const std::string& warning : stream->header().warnings) tell("palpate: warning: {}\n", warning);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  print_cells(report, took.count(), arguments.out, arguments.json);
  return kExitOk;
}

bool is_cell_file(const std::string& path) {
  return prepared::CellFile::begins_as_one(first_bytes(path));
}

/// Whether the surface is made cell by cell: its points exceed the bound, or are a folder's.
Result<bool> is_large(const PrepareArguments& arguments) {
  if (std::filesystem::is_directory(arguments.model)) return true;
  std::uint64_t points = 0;
  if (is_cell_file(arguments.model)) {
    PALPATE_ASSIGN(const prepared::CellFile cells, prepared::CellFile::open(arguments.model));
    points = cells.info().points;
  } else if (const auto stream = open_stream(arguments)) {
    points = (*stream)->header().points;
  }
  return points > memory_bound(arguments) / prepared::kSurfaceBytesPerPoint;
}

/// Cells of the scan beside the file to write, under a name that another scan or unit would not have: a run
/// that was stopped goes on with them.
Result<std::string> make_scratch_cells(const PrepareArguments& arguments, Context& context) {
  PALPATE_ASSIGN(const std::unique_ptr<io::PointStream> stream, open_stream(arguments));
  PALPATE_ASSIGN(const prepared::PrepareCellsOptions options, cells_options(arguments, *stream));
  for (const std::string& warning : stream->header().warnings) tell("palpate: warning: {}\n", warning);
  Hash64 choices;
  choices.real(options.mm_per_unit);
  const prepared::JournalKey key = prepared::make_journal_key(options.input_path, choices.value());
  const std::string path = fmt::format("{}.{:016x}.{}", arguments.out, key.hash, kCells);
  if (!key.unknown && is_cell_file(path)) return path;
  PALPATE_ASSIGN(const prepared::PrepareCellsReport report,
                 prepared::prepare_cells(*stream, options, path, context.progress));
  static_cast<void>(report);
  return path;
}

/// Share of the area on seams from which sides are doubtful: a tenth of what a piece's rim has.
constexpr double kDoubtfulSeams = 0.01;

/// The surface of points that exceed the bound.
Result<int> run_large_surface(const PrepareArguments& arguments, Context& context) {
  PALPATE_TRY(check_large_output(arguments, kSurfaces));
  StopCallback stop_callback([&] { return arguments.out + " was not written; the same command goes on"; });
  render::PrepareReport report;
  const bool given = is_cell_file(arguments.model);
  std::string cells_path = arguments.model;
  const render::PrepareContext prepare{arguments.load.threads, &context.progress};
  render::PreparePhases phases(report, prepare);
  if (!given) {
    phases.begin("cells");
    PALPATE_ASSIGN(cells_path, make_scratch_cells(arguments, context));
    phases.end();
  }
  PALPATE_ASSIGN(const prepared::CellFile cells, prepared::CellFile::open(cells_path));
  prepared::PrepareSurfaceOptions options;
  options.memory_bytes = memory_bound(arguments);
  options.threads = arguments.load.threads;
  phases.begin("surface");
  const Result<prepared::PrepareSurfaceReport> made =
      prepared::prepare_surface(cells, options, arguments.out, context.progress);
  phases.end();
  if (!given && !context.progress.cancelled()) std::filesystem::remove(cells_path);
  if (!made) return made.error();
  stop_callback.drop();
  if (made->contradicted > kDoubtfulSeams)
    phases.warn(fmt::format(
        "Along {:.2g} % of the seams between {} regions the surface changes sides: contact is lost there. "
        "With more memory (--memory-limit-gb) there are fewer.",
        100.0 * made->contradicted, made->chunks));
  PALPATE_ASSIGN(const std::shared_ptr<const spline_sdf::SurfaceFile> written,
                 spline_sdf::SurfaceFile::open(arguments.out));
  context.progress.clear();
  for (const std::string& warning : report.warnings) tell("palpate: warning: {}\n", warning);
  print_prepared(*written, report, arguments.json);
  return kExitOk;
}

Result<int> run_prepare(const PrepareArguments& arguments, Context& context) {
  const bool part = !arguments.load.within.empty();
  if (arguments.out.ends_with(fmt::format(".{}", kCells))) {
    if (part)
      return Error{"--within does nothing: cells are of all points",
                   "give it to the command that reads them, as in palpate info HALL.palcells --within ..."};
    return run_cells(arguments, context);
  }
  // A part is read, and then is as large as any scan in memory.
  PALPATE_ASSIGN(const bool large, part ? Result<bool>(false) : is_large(arguments));
  if (large) return run_large_surface(arguments, context);
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(const scene::SceneFile file, open_scene(arguments.model, all_renderers(), context.progress));
  if (file.models.size() != 1)
    return Error{fmt::format("a prepared file has one model, the scene has {}", file.models.size()),
                 "prepare the models one by one", file.path};
  PALPATE_TRY(check_output(
      {arguments.out, {kSurfaces, kCells}, arguments.force || is_prepared(arguments.out)}, files_read(file)));
  StopCallback stop_callback([&] { return arguments.out + " was not written"; });
  PALPATE_ASSIGN(const scene::LoadedScene loaded,
                 scene::load(file, all_readers(), options, context.progress));
  const render::ModelInput& model = loaded.input.models.front();
  if (model.prepared != nullptr) return Error{"is a prepared file already", "give the scan", arguments.model};
  render::PrepareReport report;
  const render::PrepareContext prepare{arguments.load.threads, &context.progress};
  PALPATE_TRY(spline_sdf::prepare_surface_file(model.cloud, {}, prepare, report, arguments.out));
  stop_callback.drop();
  PALPATE_ASSIGN(const std::shared_ptr<const spline_sdf::SurfaceFile> written,
                 spline_sdf::SurfaceFile::open(arguments.out));
  context.progress.clear();
  for (const std::string& warning : loaded.provenance.front().warnings)
    tell("palpate: warning: {}\n", warning);
  for (const std::string& warning : report.warnings) tell("palpate: warning: {}\n", warning);
  print_prepared(*written, report, arguments.json);
  return kExitOk;
}

}  // namespace

Subcommand prepare_subcommand() {
  return subcommand("prepare",
                    "writes a scan's smooth surface to a file that `cloud-smooth` renders at once, from disk",
                    {"palpate prepare scan.ply --unit m --out scan.palsurf",
                     "palpate prepare hall.pts --unit m --out hall.palcells"},
                    declare_prepare, run_prepare);
}

namespace {

void print_json(std::size_t before, std::size_t after, const std::vector<render::PreparePhase>& phases,
                const std::vector<std::string>& notes) {
  nlohmann::ordered_json steps = nlohmann::ordered_json::array();
  for (std::size_t i = 0; i < phases.size(); ++i)
    steps.push_back({{"name", phases[i].name}, {"ms", phases[i].ms}, {"note", notes[i]}});
  fmt::print(
      "{}\n",
      nlohmann::ordered_json{{"points_before", before}, {"points_after", after}, {"steps", steps}}.dump(2));
}

struct CleanArguments {
  std::string model, steps, out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};

void declare_clean(const Declaration& declare, CleanArguments& a) {
  declare.required("MODEL", a.model, kSceneHelp);
  declare.text("--steps", a.steps,
               "STEP[/option=value..] joined by +, of `palpate list steps` (default: those of the scene)");
  declare.required("--out", a.out, "the file to write: .ply, or text as .xyz, .txt, .asc, .csv");
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_model(declare, a.load);
}

Result<int> run_clean(const CleanArguments& arguments, Context& context) {
  std::vector<NamedOptions> steps;
  if (!arguments.steps.empty()) {
    PALPATE_ASSIGN(steps, all_cleaning().parse(arguments.steps));
  }
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(const scene::SceneFile file, open_scene(arguments.model, all_renderers(), context.progress));
  if (file.models.size() != 1)
    return Error{fmt::format("cleaning takes one model, the scene has {}", file.models.size()),
                 "clean the models one by one", file.path};
  if (steps.empty() && file.models.front().clean.empty())
    return Error{"there is nothing to do", "give --steps, or [[model.clean]] in the scene"};
  PALPATE_TRY(check_output({arguments.out, io::cloud_extensions(), arguments.force}, files_read(file)));
  StopCallback stop_callback([&] { return arguments.out + " was not written"; });
  PALPATE_ASSIGN(const scene::LoadedScene loaded,
                 scene::load(file, all_readers(), options, context.progress));
  const cloud::Cloud& before = *loaded.input.models.front().cloud;
  PALPATE_ASSIGN(scene::CleanedCloud cleaned,
                 all_cleaning().run(before, steps, arguments.load.threads, context.progress));
  const scene::Provenance& own = loaded.provenance.front();
  cleaned.phases.insert(cleaned.phases.begin(), own.cleaning.begin(), own.cleaning.end());
  cleaned.notes.insert(cleaned.notes.begin(), own.cleaned.begin(), own.cleaned.end());
  PALPATE_TRY(io::write_cloud(arguments.out, cleaned.cloud));
  stop_callback.drop();
  context.progress.clear();
  if (arguments.json) {
    print_json(own.file_points - own.non_finite - own.outside, cleaned.cloud.size(), cleaned.phases,
               cleaned.notes);
    return kExitOk;
  }
  for (const std::string& warning : own.warnings) tell("palpate: warning: {}\n", warning);
  for (std::size_t i = 0; i < cleaned.phases.size(); ++i)
    fmt::print("{:>10}  {}\n", format_duration(cleaned.phases[i].ms), cleaned.notes[i]);
  fmt::print("{} points written to {}\n", cleaned.cloud.size(), arguments.out);
  return kExitOk;
}

}  // namespace

Subcommand clean_subcommand() {
  return subcommand(
      "clean", "cleans a raw scan step by step: outliers, smooth, thin, upsample, fill-holes",
      {"palpate clean scan.ply --unit m --steps thin --out thin.ply",
       "palpate clean scan.ply --unit m --steps outliers+smooth/neighbours=12 --out cleaned.ply"},
      declare_clean, run_clean);
}

}  // namespace palpate::experiments
