// A command's cases as jobs of a workflow engine: a table, a Snakefile, and profiles for this machine and for
// a Slurm cluster. A job is this program with the same command line and --case; the last one is the command
// itself, which finds every case kept.
//
//   OUT/jobs/jobs.tsv        a row for each case
//   OUT/jobs/Snakefile       prepare, case, merge, report
//   OUT/jobs/run             the command line, where it was typed
//   OUT/jobs/profiles/NAME   local, slurm: config.yaml for Snakemake 7, config.v8+.yaml from 8 on
//   OUT/jobs/cases/ID        what the process of a case leaves: an OutputFolder of its own
//   OUT/jobs/done            what Snakemake has seen end
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/session/session.h"

namespace palpate::experiments {

inline constexpr const char* kJobsFolder = "jobs";
inline constexpr const char* kCasesFolder = "cases";
/// The id of no case: the process checks its arguments and loads what they name.
inline constexpr const char* kNoCase = "none";

/// The name of a case as one of a file that needs no quotes in a shell: other names end in their hash.
[[nodiscard]] std::string case_id(const std::string& name);

/// A case of one renderer on a scene, with what it may take: known to a factor of three where meshes are
/// made. `frames`: stepped, of all passes; `preparations`: how often it is prepared.
[[nodiscard]] Case case_of(const RendererRequest& request, const render::RendererInfo& info,
                           const std::string& scene, std::size_t points, double frames, double preparations);

/// Writes table, Snakefile and profiles into `out`/jobs, which is returned, and says how they are run.
[[nodiscard]] Result<std::string> write_jobs(const CaseSelection& cases, const std::filesystem::path& out);

/// Becomes Snakemake on this folder; returns where that is not possible alone.
[[nodiscard]] Error run_jobs(const std::string& folder);

}  // namespace palpate::experiments
