// What replay and compare have in common.
#pragma once

#include <functional>

#include "experiments/command/commands.h"
#include "experiments/run/run.h"

namespace palpate::experiments {

/// Called when all files of the study are written: makes more files, returns what to print.
using AfterStudy = std::function<Result<std::string>(const OutputFolder& folder)>;

enum class StudyKind { kReplay, kCompare };

/// Checks every argument before any work, runs the renderers, writes the files, prints a summary. The exit
/// status. What the arguments leave open is chosen by the model (choices.h), and said before it is run.
int run_study(StudyKind kind, const RunArguments& arguments, Context& context, const AfterStudy& after);

}  // namespace palpate::experiments
