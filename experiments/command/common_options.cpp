#include "experiments/command/common_options.h"

#include <fmt/format.h>

#include "toolkit/core/physical_ranges.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {

void declare_threads(const Declaration& declare, int& threads) {
  declare.integer("--threads", threads, kThreads, "threads of preparation (default: all)");
}

void declare_traj_columns(const Declaration& declare, std::string& columns) {
  declare.text("--traj-columns", columns, "of a recorded path, as `palpate compare` takes them");
}

void declare_results(const Declaration& declare, RunArguments& run) {
  declare.text(
      "--out", run.out,
      "folder for the results; made where it is missing (default: one in out/, by the model's name)");
  declare.flag("--json", run.json, "print the result as JSON");
}

void declare_model(const Declaration& declare, ModelArguments& load) {
  declare.text("--unit", load.unit,
               "unit of the model file: m, cm, mm, um, in (default: what the file says)");
  declare.number("--scale", load.scale, kScales,
                 "multiplies all lengths, after the unit (default: 1, or the scene's)");
  declare.number("--post-mm", load.post_mm, kLengthsMm,
                 "height grids: distance of their posts in mm, before --scale (default: what the file says)");
  declare.number("--vertical-mm", load.vertical_mm, kLengthsMm,
                 "height grids: mm that a height of 1 stands for, before --scale (default: the unit)");
  declare.text("--no-data", load.no_data,
               "height grids: the file's number that stands for no height (default: what the file says)");
  declare.choice("--non-finite", load.non_finite, {"drop", "refuse"},
                 "points that are not finite: drop (and count) or refuse (default: drop)");
  declare.number("--memory-limit-gb", load.memory_limit_gb, kGigabytes,
                 fmt::format("memory that reading one file may take (default: {:.3g})",
                             static_cast<double>(kMemoryLimitBytes) / kBytesPerGb));
  declare_threads(declare, load.threads);
}

void declare_surface(const Declaration& declare, SurfaceArguments& surface) {
  declare.text("--stiffness", surface.stiffness,
               "of every model, N/mm, in place of the scene's uniform value (default: 0.5, or the scene's)");
  declare.text("--friction", surface.friction,
               "of every model: one coefficient, or STATIC,DYNAMIC (default: none, or the scene's)");
  declare.text(
      "--deformation", surface.deformation,
      "of every model: the share of the force it takes away, 0 up to 1 (default: none, or the scene's)");
}

void declare_run(const Declaration& declare, RunArguments& run) {
  constexpr NumberRange kFrames{0, 10'000'000};  // 2.8 hours at 1 kHz
  constexpr NumberRange kPasses{1, 1000}, kSeconds{0, 86'400};
  declare.required("SCENE", run.scene, kSceneHelp);
  declare.text(
      "--path", run.path,
      "a file (.csv, .traj, .palrec) or a generator such as weave:frames=20000:depth_mm=2; `palpate paths` "
      "lists "
      "them with their options (default: by the model's size, an exploration, or a weave where it is a "
      "formula)");
  declare.text("--traj-columns", run.traj_columns,
               "where the numbers of a recorded path stand, columns counted from 0, and their units, such as "
               "t=0,x=1,y=2,z=3,mm_per_unit=1000 (`palpate paths` lists the keys)");
  declare.text("--reference", run.reference,
               "ground truth: auto, analytic, original-mesh, closest-point, none, or a mesh file or scan by "
               "name in the "
               "model's frame");
  declare.integer("--paced", run.paced, kFrames,
                  "also time so many frames at 1 kHz, with the caches warm and evicted");
  declare.integer(
      "--passes", run.passes, kPasses,
      fmt::format("timed passes of each kind and renderer, in turns (default: {})", kUsualPasses));
  declare.number("--timing-budget", run.budget_s, kSeconds,
                 fmt::format("seconds of timed passes a renderer: a slow one gets fewer (default: {:g})",
                             kUsualBudgetS));
  declare.text("--save-mesh", run.save_mesh, "write the mesh of a mesh renderer to this PLY file");
  declare.flag("--force", run.force, kForceHelp);
  declare.flag("--allow-missing", run.allow_missing,
               "run renderers too that lack what the scene asks for (friction, dents, ..), and say so");
  declare_results(declare, run);
  declare_surface(declare, run.surface);
  declare_model(declare, run.load);
}

void declare_trade(const Declaration& declare, SweepArguments& trade) {
  constexpr NumberRange kPasses{1, 1000};
  RunArguments& run = trade.run;
  run.passes = kSweepPasses;
  declare.required("SCENE", run.scene, kSceneHelp);
  declare.text(
      "--renderers", run.renderers,
      "A,B,..: the renderers to start from, each NAME[:option=value...] (default: all that can do what "
      "the scene asks for)");
  declare.text("--axes", trade.axes,
               "what is turned, separated by commas: " + joined(names_of(axes())) + " (default: all)");
  declare.text(
      "--path", run.path,
      "a file or a generator, as `palpate compare` takes it (default: six seconds, by the model's size)");
  declare_traj_columns(declare, run.traj_columns);
  declare.text(
      "--reference", run.reference,
      "ground truth: auto, analytic, original-mesh, or a mesh file or scan by name in the model's frame");
  declare.text(
      "--out", run.out,
      "folder for the results; one with results of the same is gone on with (default: one in out/, by the "
      "model's name)");
  declare.integer("--passes", run.passes, kPasses,
                  fmt::format("timed passes of each kind and setting, in turns (default: {})", kSweepPasses));
  declare.flag("--json", run.json, "print the result as JSON");
  declare_model(declare, run.load);
}

}  // namespace palpate::experiments
