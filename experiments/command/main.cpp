// The palpate command: reads the command line, calls a subcommand, turns everything into an exit status.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <new>

#include "experiments/command/commands.h"
#include "experiments/command/version.h"

namespace palpate::experiments {
namespace {

std::string quoted(const std::string& argument) {
  constexpr const char* kPlain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=:,./@%";
  if (!argument.empty() && argument.find_first_not_of(kPlain) == std::string::npos) return argument;
  std::string text = "'";
  for (const char c : argument) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

void add_model_options(CLI::App& command, ModelArguments& load) {
  command.add_option("--unit", load.unit,
                     "unit of the model file: m, cm, mm, um, in (default: what the file says)");
  command
      .add_option("--scale", load.scale,
                  "multiplies all lengths, after the unit (default: 1, or the scene's)")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--post-mm", load.post_mm,
                  "height grids: distance of their posts in mm, before --scale (default: what the file says)")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--vertical-mm", load.vertical_mm,
                  "height grids: mm that a height of 1 stands for, before --scale (default: the unit)")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--non-finite", load.non_finite, "points that are not finite: drop (and count) or refuse")
      ->check(CLI::IsMember({"drop", "refuse"}));
  command.add_option("--threads", load.threads, "threads of preparation (default: all)")
      ->check(CLI::Range(0, 4096));
}

void add_run_options(CLI::App& command, RunArguments& run) {
  command
      .add_option("SCENE", run.scene,
                  "a scene (.toml), a model file, or a generator such as sinusoid:points=10201")
      ->required();
  command
      .add_option("--path", run.path,
                  "a file (.csv, .traj) or a generator such as weave:frames=20000:depth_mm=2")
      ->required();
  command.add_option("--out", run.out, "folder for the results; made where it is missing")->required();
  command.add_option(
      "--reference", run.reference,
      "ground truth: auto, analytic, original-mesh, none, or a mesh file or scan by name in the "
      "model's frame");
  command
      .add_option("--paced", run.paced, "also time so many frames at 1 kHz, with the caches warm and evicted")
      ->check(CLI::Range(std::uint64_t{0}, std::uint64_t{10'000'000}));
  command.add_option("--save-mesh", run.save_mesh, "write the mesh of a mesh renderer to this PLY file");
  command.add_flag("--json", run.json, "print the result as JSON");
  add_model_options(command, run.load);
}

struct Arguments {
  InfoArguments info;
  PlanArguments plan;
  RenderersArguments renderers;
  RunArguments replay, compare;
  ReproduceArguments reproduce;
  BehavioursArguments behaviours;
  FetchArguments fetch;
  CleanArguments clean;
};

void declare(CLI::App& app, Arguments& a) {
  app.require_subcommand(1);
  app.set_version_flag("--version",
                       fmt::format("palpate {} (commit {}, {})", version_text(), kCommit, build_text()));
  app.footer(
      "Exit status: 0 done; 1 ran, and failed or fell short; 2 bad arguments or input.\n"
      "`palpate COMMAND --help` shows examples.");

  CLI::App* info =
      app.add_subcommand("info", "what a model holds: points, box, resolution, density, spacing, defects");
  info->add_option("MODEL", a.info.model, "a model file, a scene (.toml) or a generator")->required();
  info->add_flag("--json", a.info.json, "print JSON");
  add_model_options(*info, a.info.load);
  info->footer(
      "Examples:\n  palpate info dragon_vrip.ply.gz --unit m --scale 1.025\n  palpate info "
      "sinusoid:points=1002001 --json");

  CLI::App* plan = app.add_subcommand(
      "plan", "what will be built for a scene and why, with bytes and expected cost; nothing is run");
  plan->add_option("SCENE", a.plan.scene, "a scene (.toml), a model file or a generator")->required();
  plan->add_option("--renderer", a.plan.renderer,
                   "NAME[:option=value...]; default: the scene's, or the plan's own");
  plan->add_flag("--json", a.plan.json, "print JSON");
  add_model_options(*plan, a.plan.load);
  plan->footer(
      "Examples:\n  palpate plan sinusoid:points=101761\n  palpate plan scan.toml --renderer cloud --json");

  CLI::App* clean = app.add_subcommand(
      "clean", "cleans a raw scan step by step: outliers, smooth, thin, upsample, fill-holes");
  clean->add_option("MODEL", a.clean.model, "a model file, a scene (.toml) or a generator");
  clean->add_option("--steps", a.clean.steps,
                    "STEP[/option=value..] joined by +; without it and a MODEL: the list of steps");
  clean->add_option("--out", a.clean.out, "the PLY file to write");
  clean->add_flag("--json", a.clean.json, "print JSON");
  add_model_options(*clean, a.clean.load);
  clean->footer(
      "Examples:\n  palpate clean\n  palpate clean scan.ply --unit m --steps outliers+smooth/neighbours=12 "
      "--out cleaned.ply");

  CLI::App* renderers =
      app.add_subcommand("renderers", "the renderers with their options, defaults and sources");
  renderers->add_flag("--json", a.renderers.json, "print JSON");
  renderers->footer("Example:\n  palpate renderers");

  CLI::App* replay =
      app.add_subcommand("replay", "one renderer along one probe path: trace.csv and result.json");
  replay->add_option("--renderer", a.replay.renderers,
                     "NAME[:option=value...]; default: the scene's, or what `palpate plan` chooses");
  add_run_options(*replay, a.replay);
  replay->add_option("--save-edited", a.replay.save_edited,
                     "write the first model as the path left it to this PLY file (scenes with dents)");
  replay->footer(
      "Examples:\n  palpate replay sinusoid:points=1002001 --renderer cloud --path weave:frames=50000 --out "
      "out/weave\n"
      "  palpate replay scan.toml --renderer cloud:shading=none --path probe.csv --out out/probe --paced "
      "5000");

  CLI::App* compare =
      app.add_subcommand("compare", "several renderers along one path: result.json, traces, report.html");
  compare->add_option("--renderers", a.compare.renderers, "A,B,..: each NAME[:option=value...][:label=TEXT]")
      ->required();
  add_run_options(*compare, a.compare);
  compare->footer(
      "Examples:\n  palpate compare sinusoid:points=101761 --renderers cloud-literal,cloud,mesh-godobject "
      "--path weave:frames=20000 --out out/ab\n"
      "  palpate compare scan.ply --unit m --renderers cloud,cloud:shading=none:label=bare --path "
      "exploration:frames=20000 --out out/shading");

  CLI::App* reproduce =
      app.add_subcommand("reproduce", "the thesis's tables beside the printed values, and a comparison");
  reproduce->add_option("--tables", a.reproduce.tables, "which tables, separated by commas (default: all)");
  reproduce->add_option("--out", a.reproduce.out, "folder for the results")->required();
  reproduce->add_flag("--full", a.reproduce.full,
                      "longer runs too: growth with the number of points to ten million; whole models; no "
                      "limit of time for reconstructions");
  reproduce
      ->add_option("--mesh-limit", a.reproduce.mesh_limit_s,
                   "a reconstruction may take so many seconds; 0: no limit (default: 120, with "
                   "--full 0)")
      ->check(CLI::NonNegativeNumber);
  reproduce->add_flag("--no-cache", a.reproduce.no_cache,
                      "make every mesh anew, and keep none for the next run");
  reproduce->add_flag("--quick", a.reproduce.quick,
                      "small models, short paths: tries the machinery, measures nothing");
  reproduce->add_option("--threads", a.reproduce.threads, "threads of preparation (default: all)")
      ->check(CLI::Range(0, 4096));
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
  behaviours->add_option("--threads", a.behaviours.threads, "threads of preparation (default: all)")
      ->check(CLI::Range(0, 4096));
  behaviours->add_flag("--json", a.behaviours.json, "print the matrix as JSON");
  behaviours->footer(
      "Examples:\n  palpate behaviours --out out/behaviours\n  palpate behaviours --renderers "
      "cloud,mesh-godobject --only thin-plate,ridge --out out/two");

  CLI::App* fetch =
      app.add_subcommand("fetch", "lists the scans known by name, or downloads one, checked, into the cache");
  fetch->add_option("NAME", a.fetch.name, "the scan; without it: the list");
  fetch->add_option("--source", a.fetch.source, "take it from this address (http, https, file) instead");
  fetch->add_flag("--json", a.fetch.json, "print JSON");
  fetch->footer("Examples:\n  palpate fetch\n  palpate fetch stanford-dragon");
}

int dispatch(const CLI::App& app, const Arguments& a, Context& context) {
  const std::string name = app.get_subcommands().front()->get_name();
  if (name == "info") return run_info(a.info, context);
  if (name == "plan") return run_plan(a.plan, context);
  if (name == "clean") return run_clean(a.clean, context);
  if (name == "renderers") return run_renderers(a.renderers);
  if (name == "replay") return run_replay(a.replay, context);
  if (name == "compare") return run_compare(a.compare, context);
  if (name == "reproduce") return run_reproduce(a.reproduce, context);
  if (name == "behaviours") return run_behaviours_command(a.behaviours, context);
  return run_fetch(a.fetch, context);
}

int run(int argc, char** argv) {
  CLI::App app("Haptic rendering of dense point clouds, and the bench that compares it with mesh baselines.",
               "palpate");
  Arguments arguments;
  declare(app, arguments);
  const auto is_first = [&](const CLI::App* command) { return command->get_name() == argv[1]; };
  if (argc > 1 && argv[1][0] != '-' && app.get_subcommands(is_first).empty()) {
    fmt::print(stderr, "palpate: error: there is no command '{}'; `palpate --help` lists them\n", argv[1]);
    return kExitBadInput;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    const std::string what = error.what();
    fmt::print(stderr, "palpate: error: {}; `palpate{} --help` shows what is understood\n", what,
               app.get_subcommands().empty() ? "" : " " + app.get_subcommands().front()->get_name());
    return kExitBadInput;
  }
  ProgressBar progress;
  Context context{progress, "palpate"};
  for (int i = 1; i < argc; ++i) context.command_line += " " + quoted(argv[i]);
  return dispatch(app, arguments, context);
}

}  // namespace
}  // namespace palpate::experiments

int main(int argc, char** argv) {
  try {
    return palpate::experiments::run(argc, argv);
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "palpate: error: out of memory; close other programs or take a smaller model\n");
  } catch (const std::exception& error) {
    fmt::print(stderr, "palpate: error: unexpected: {}; this is a fault of Palpate, please report it\n",
               error.what());
  }
  return palpate::experiments::kExitFellShort;
}
