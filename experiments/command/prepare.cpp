#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include <palpate/progress.h>
#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/data/scans.h"
#include "experiments/report/tables.h"
#include "experiments/run/arguments.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "toolkit/spline_sdf/prepared_surface.h"

namespace palpate::experiments {
namespace {

/// Extension of a file of prepared surfaces.
constexpr const char* kExtension = ".palsurf";

struct PrepareArguments {
  std::string model, out;
  ModelArguments load;
  bool force = false;  ///< --out may replace what it did not write, or what is read
  bool json = false;
};

void declare_prepare(const Declaration& declare, PrepareArguments& a) {
  declare.required("MODEL", a.model, kSceneHelp);
  declare.required("--out", a.out, fmt::format("the file to write, {}", kExtension));
  declare_force(declare, a.force);
  declare_json(declare, a.json);
  declare_model(declare, a.load);
}

void print_prepared(const render::SurfaceFile& file, const render::PrepareReport& report, bool json) {
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

Result<int> run_prepare(const PrepareArguments& arguments, Context& context) {
  PALPATE_ASSIGN(const scene::LoadOptions options, load_options(arguments.load));
  PALPATE_ASSIGN(const scene::SceneFile file, open_scene(arguments.model, all_renderers(), context.progress));
  if (file.models.size() != 1)
    return Error{fmt::format("a prepared file has one model, the scene has {}", file.models.size()),
                 "prepare the models one by one", file.path};
  PALPATE_TRY(check_output({arguments.out, {kExtension}, arguments.force}, files_read(file)));
  StopCallback stop_callback([&] { return arguments.out + " was not written"; });
  PALPATE_ASSIGN(const scene::LoadedScene loaded,
                 scene::load(file, all_readers(), options, context.progress));
  const render::ModelInput& model = loaded.input.models.front();
  if (model.prepared != nullptr) return Error{"is a prepared file already", "give the scan", arguments.model};
  render::PrepareReport report;
  const render::PrepareContext prepare{arguments.load.threads, &context.progress};
  PALPATE_TRY(render::prepare_surface_file(model.cloud, {}, prepare, report, arguments.out));
  stop_callback.drop();
  PALPATE_ASSIGN(const std::shared_ptr<const render::SurfaceFile> written,
                 render::SurfaceFile::open(arguments.out));
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
                    "makes a file of a scan's smooth surface: `cloud-smooth` feels it at once, and from disk",
                    {"palpate prepare scan.ply --unit m --out scan.palsurf",
                     "palpate live scan.palsurf --renderers cloud-smooth"},
                    declare_prepare, run_prepare);
}

}  // namespace palpate::experiments
