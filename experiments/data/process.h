// Runs another program without a shell: arguments are passed as they are.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::experiments {

struct ProcessOutcome {
  int exit_code = 0;  ///< 128 + signal where a signal ended it
  bool timed_out = false;
  std::string out;  ///< standard output, at most 1 MiB of it
  std::string err;  ///< standard error, at most 1 MiB of it
};

/// Runs `arguments[0]` (searched on PATH) to its end or for `time_limit_s`, after which it is ended. `tick`,
/// if set, is called several times a second. `folder`, if not empty, is where it runs. Not being able to
/// start it is an Error.
[[nodiscard]] Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments,
                                                 double time_limit_s, const std::function<void()>& tick = {},
                                                 const std::string& folder = {});

/// Whether PATH has an executable of this name.
[[nodiscard]] bool program_exists(const std::string& name);

}  // namespace palpate::experiments
