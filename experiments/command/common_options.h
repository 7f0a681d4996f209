// Options that several subcommands take.
#pragma once

#include "experiments/command/subcommand.h"
#include "experiments/session/study_run.h"
#include "experiments/trade/sweep.h"

namespace palpate::experiments {

inline constexpr NumberRange kThreads{0, 4096};       ///< more than any machine has
inline constexpr NumberRange kGigabytes{0.001, 1e6};  ///< a petabyte: beyond every machine

inline constexpr const char* kForceHelp =
    "files to be written may replace those that are read, or that Palpate did not write";
inline constexpr const char* kStudyFolderHelp =
    "the folder of a study: what replay or compare wrote with --out, or a table's folder in what reproduce "
    "wrote";
inline constexpr const char* kSceneHelp =
    "a scene (.toml), a model file, a scan by name (`palpate fetch` lists them), or a generator such as "
    "sinusoid:points=10201";

void declare_threads(const Declaration& declare, int& threads);
void declare_model(const Declaration& declare, ModelArguments& load);
/// --traj-columns, where the text of --path says what is meant.
void declare_traj_columns(const Declaration& declare, std::string& columns);
/// --out as a folder, --json.
void declare_results(const Declaration& declare, RunArguments& run);
void declare_surface(const Declaration& declare, SurfaceArguments& surface);
/// Those of replay and compare.
void declare_run(const Declaration& declare, RunArguments& run);
/// Those of sweep and tune.
void declare_trade(const Declaration& declare, SweepArguments& trade);

}  // namespace palpate::experiments
