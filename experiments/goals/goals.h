// Measures the thesis's goals as a command.
#pragma once

#include <string>

#include "experiments/session/session.h"

namespace palpate::experiments {

struct GoalsArguments {
  std::string out;
  bool quick = false;  ///< small models and short paths
  int threads = 0;     ///< of preparation; 0: all
  bool json = false;
};

/// Measures, writes goals.json and pages, and prints the table. Exit status kExitFellShort: a goal could not
/// be measured. A missed goal is a result.
[[nodiscard]] Result<int> run_goals(const GoalsArguments& arguments, Context& context);

}  // namespace palpate::experiments
