// The stress matrix as a command: run, kept, drawn.
#pragma once

#include <string>

#include "experiments/session/session.h"

namespace palpate::experiments {

struct StressArguments {
  std::string renderers;  ///< empty: every renderer
  std::string cases;      ///< names and groups; empty: all
  std::string out;
  std::string against;    ///< stress.json of another run, whose hashes must be these; empty: none
  double budget_s = 0.0;  ///< 0: as long as it takes
  double cell_s = 60.0;   ///< of one cell
  bool full = false;
  bool quick = false;
  bool json = false;
};

/// The exit status: kExitFellShort where a cell of one of ours is red.
int run_stress(const StressArguments& arguments, Context& context);

}  // namespace palpate::experiments
