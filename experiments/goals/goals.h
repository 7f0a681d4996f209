// The goals of the thesis, each answered by a measurement, as a command.
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

/// Measures, writes goals.json and the pages, prints the table. The exit status: kExitFellShort where a goal
/// could not be measured; one that is not reached is a result.
int run_goals(const GoalsArguments& arguments, Context& context);

}  // namespace palpate::experiments
