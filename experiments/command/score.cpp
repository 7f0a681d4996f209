#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/report/findings.h"
#include "experiments/report/tables.h"
#include "experiments/session/terminal.h"
#include "experiments/session/version.h"
#include "experiments/study/scoring.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/try.h"
#include "toolkit/metrics/score_io.h"

namespace palpate::experiments {
namespace {

/// The scores of every run, and last of all result.json.
Status write_scores(const Study& study, const OutputFolder& folder) {
  for (std::size_t i = 0; i < study.runs.size(); ++i) {
    const std::string& name = study.document.renderers[i].scores_file;
    if (name.empty()) continue;
    const Result<std::string> file = folder.claim(name);
    if (!file) return file.error();
    PALPATE_TRY(metrics::write_scores_csv(study.path, study.runs[i].per_frame, *file));
  }
  return folder.write(kResultFile, metrics::to_json(study.document));
}

/// Scores by another program than that which measured are said to be.
void note_program(metrics::ResultDocument& document) {
  if (document.version == version_text() && document.commit == kCommit) return;
  const std::string note = fmt::format("Scored again by palpate {}, commit {}.", version_text(), kCommit);
  if (std::find(document.notes.begin(), document.notes.end(), note) == document.notes.end())
    document.notes.push_back(note);
}

struct ScoreArguments {
  std::string folder;
  bool json = false;
};

void declare_score(const Declaration& declare, ScoreArguments& a) {
  declare.required("DIR", a.folder, kStudyFolderHelp);
  declare.flag("--json", a.json, "print the result as JSON");
}

int run_score(const ScoreArguments& arguments, Context& context) {
  context.progress.report("reading the study", -1.0);
  Result<Study> study = read_study(arguments.folder);
  if (!study) return fail(study.error(), kExitBadInput, &context.progress);
  const Result<OutputFolder> folder = OutputFolder::reopen(arguments.folder);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  context.progress.report("scoring", -1.0);
  if (const Status scored = score_study(*study); !scored)
    return fail(scored.error(), kExitFellShort, &context.progress);
  note_program(study->document);
  const Status written = write_scores(*study, *folder);
  context.progress.clear();
  if (!written) return fail(written.error(), kExitFellShort);
  if (arguments.json) {
    fmt::print("{}\n", metrics::to_json(study->document));
    return kExitOk;
  }
  fmt::print("{}\nresults: {}\n", to_text(comparison_table(study->document), terminal_columns(STDOUT_FILENO)),
             folder->path().string());
  if (std::filesystem::exists(folder->file(kReportFile)))
    fmt::print("`palpate report {}` draws the report again\n", arguments.folder);
  tell("{}", findings_text(study->document));
  return kExitOk;
}

}  // namespace

Subcommand score_subcommand() {
  return subcommand("score", "scores a study again, from its traces and its truth; no renderer is run",
                    {"palpate score out/ab", "palpate score out/ab --json"}, declare_score, run_score);
}

}  // namespace palpate::experiments
