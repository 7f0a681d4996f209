// Runs another program without a shell: arguments are passed as they are.
#pragma once

#include <csignal>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::experiments {

inline constexpr int kSignalBase = 128;                      ///< of exit codes, as shells have it
inline constexpr int kTooLargeFile = kSignalBase + SIGXFSZ;  ///< a file reached its limit

struct ProcessOutcome {
  int exit_code = 0;  ///< 128 + signal where a signal ended it
  bool timed_out = false;
  std::string out;  ///< standard output, at most 1 MiB of it
  std::string err;  ///< standard error, at most 1 MiB of it
};

/// Runs `arguments[0]` (searched on PATH) to its end or for `time_limit_s`, after which it is ended with all
/// that it started, as when this program is stopped. `tick`, if set, is called several times a second.
/// `folder`, if not empty, is where it runs. Not being able to start it is an Error. With `file_limit_bytes`
/// above 0 no file that it writes grows beyond so much: the write fails, or a signal ends it (exit_code
/// kTooLargeFile).
[[nodiscard]] Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments,
                                                 double time_limit_s, const std::function<void()>& tick = {},
                                                 const std::string& folder = {},
                                                 std::uint64_t file_limit_bytes = 0);

/// Whether PATH has an executable of this name.
[[nodiscard]] bool program_exists(const std::string& name);

}  // namespace palpate::experiments
