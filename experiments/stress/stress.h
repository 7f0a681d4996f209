// The stress matrix as a command.
#pragma once

#include <string>

#include "experiments/session/session.h"

namespace palpate::experiments {

struct StressArguments {
  std::string renderers;  ///< empty: all
  std::string cases;      ///< names and groups; empty: all
  std::string out;
  std::string against;    ///< another run's stress.json with the expected hashes; empty: none
  double budget_s = 0.0;  ///< 0: unlimited
  double cell_s = 60.0;   ///< per cell
  bool full = false;
  bool quick = false;
  bool json = false;
};

/// Returns the exit status: kExitFellShort if a cell of ours failed.
[[nodiscard]] Result<int> run_stress(const StressArguments& arguments, Context& context);

}  // namespace palpate::experiments
