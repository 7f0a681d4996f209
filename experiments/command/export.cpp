#include "experiments/command/common_options.h"
#include "experiments/command/subcommands.h"
#include "experiments/live/recording_export.h"

namespace palpate::experiments {
namespace {

void declare_export(const Declaration& declare, ExportArguments& a) {
  declare.required("RECORDING", a.recording, "what `palpate record` or `palpate live --record` wrote");
  declare.choice("--format", a.format, {"csv", "hdf5", "motion-bids"},
                 "csv: the trace of one renderer, as replay writes it; hdf5: everything; motion-bids: a "
                 "dataset of one subject (default: csv)");
  declare.text("--out", a.out, "the file (.csv, .h5), or the folder of the dataset");
  declare.text("--renderer", a.renderer, "of csv: the label of the renderer (default: the first)");
  declare.text("--subject", a.subject, "of motion-bids: label of the subject (default: 01)");
  declare.text("--task", a.task, "of motion-bids: label of the task (default: touch)");
  declare.flag("--skip-damaged", a.skip_damaged, "leave out what is damaged in the middle, and say so");
  declare.flag("--force", a.force, "a file of this name may be replaced");
  declare.flag("--json", a.json, "print the result as JSON");
}

int run_export_command(const ExportArguments& arguments, Context& context) {
  if (arguments.out.empty())
    return fail({"there is nowhere to export to", "give --out FILE", {}, 0}, kExitBadInput);
  return run_export(arguments, context);
}

}  // namespace

Subcommand export_subcommand() {
  return subcommand("export", "a recording as CSV, HDF5 or Motion-BIDS",
                    {"palpate export session.palrec --out session.csv",
                     "palpate export session.palrec --format hdf5 --out session.h5",
                     "palpate export session.palrec --format motion-bids --subject 01 --out dataset"},
                    declare_export, run_export_command);
}

}  // namespace palpate::experiments
