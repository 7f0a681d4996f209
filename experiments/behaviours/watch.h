// The behaviour suite as a command.
#pragma once

#include <string>

#include "experiments/session/session.h"

namespace palpate::experiments {

struct BehavioursArguments {
  std::string renderers;  ///< empty: all methods
  std::string only;       ///< "thin-plate,ridge"; empty: all
  std::string out;
  int threads = 0;
  bool json = false;
};

/// Returns the exit status.
[[nodiscard]] Result<int> watch_behaviours(const BehavioursArguments& arguments, Context& context);

}  // namespace palpate::experiments
