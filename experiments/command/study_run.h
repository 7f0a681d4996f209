// What replay and compare have in common.
#pragma once

#include <functional>

#include "experiments/command/commands.h"
#include "experiments/run/run.h"

namespace palpate::experiments {

/// Called with the finished study, after its files are written: makes more files, returns what to print.
using AfterStudy = std::function<Result<std::string>(const Study& study, const OutputFolder& folder)>;

/// Checks every argument before any work, runs the renderers, writes the files, prints a summary. The exit
/// status.
int run_study(const RunArguments& arguments, Context& context, const AfterStudy& after);

}  // namespace palpate::experiments
