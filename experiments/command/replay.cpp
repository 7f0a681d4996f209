#include <fmt/format.h>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_session.h"

namespace palpate::experiments {
namespace {

void declare_replay(const Declaration& declare, RunArguments& a) {
  declare.text("--renderer", a.renderers,
               "NAME[:option=value...]; default: the scene's, or what `palpate plan` chooses");
  declare_run(declare, a);
  declare.text("--save-edited", a.save_edited,
               "write the first model as the path left it to this file (.ply, .xyz, .txt, .asc, .csv; "
               "scenes with dents)");
}

int run_replay(const RunArguments& arguments, Context& context) {
  if (arguments.renderers.find(',') != std::string::npos)
    return fail({"replay runs one renderer", "`palpate compare` runs several", {}, 0}, kExitBadInput);
  RunArguments run = arguments;
  const bool recorded = !run.path.empty() && is_recorded_session(run.path);
  if (recorded && run.renderers.empty()) {
    const Result<std::string> renderer = renderer_of_recording(run.path);
    if (!renderer) return fail(renderer.error(), kExitBadInput);
    run.renderers = *renderer;
  }
  std::string path;
  const int status =
      run_study(StudyKind::kReplay, run, context, [&](const OutputFolder& folder) -> Result<std::string> {
        path = folder.path().string();
        return fmt::format("results: {}\n", path);
      });
  if (!recorded || status != kExitOk) return status;
  return check_recording(run, path, context);
}

}  // namespace

Subcommand replay_subcommand() {
  return subcommand(
      "replay", "one renderer along one probe path: trace.csv and result.json",
      {"palpate replay scan.ply --unit m",
       "palpate replay sinusoid:points=1002001 --renderer cloud --path weave:frames=50000 --out out/weave",
       "palpate replay scan.toml --renderer cloud:shading=none --path probe.csv --out out/probe --paced 5000",
       "palpate replay scan.ply --unit m --friction 0.7,0.5 --path recorded.txt --traj-columns "
       "t=0,x=1,y=2,z=3,mm_per_unit=1000 --out out/recorded"},
      declare_replay, run_replay);
}

}  // namespace palpate::experiments
