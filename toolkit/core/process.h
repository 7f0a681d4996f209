// Runs another program without a shell: arguments are passed as they are. It stands in a group of its own, is
// ended at its limits with all that it started, and ends with this program.
#pragma once

#include <csignal>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate {

inline constexpr int kSignalBase = 128;                      ///< of exit codes, as shells have it
inline constexpr int kTooLargeFile = kSignalBase + SIGXFSZ;  ///< a file reached its limit

/// A talk with a program over a socket, which is its standard input.
struct ProcessTalk {
  std::string to_send;
  /// Called with all that has come and was not taken off yet. False: that was all, the program is ended.
  std::function<bool(std::string& received)> hear;
};

struct ProcessOptions {
  double time_limit_s = 0.0;  ///< 0: none
  double grace_s = 2.0;       ///< between asking a program to end at its limit and ending it
  std::string folder{};       ///< where it runs; empty: where we do
  /// Above 0: no file that it writes grows beyond so much; the write fails, or a signal ends it (exit code
  /// kTooLargeFile).
  std::uint64_t file_limit_bytes = 0;
  /// Called several times a second. False: the program is ended.
  std::function<bool()> tick{};
  ProcessTalk* talk = nullptr;  ///< null: it has nothing to read
};

struct ProcessOutcome {
  int exit_code = 0;       ///< 128 + signal where a signal ended it
  int signal = 0;          ///< that ended it; 0: none
  bool timed_out = false;  ///< at the limit of time
  bool stopped = false;    ///< by tick() or hear()
  std::string out;         ///< standard output: the first MiB of it
  std::string err;         ///< standard error: likewise
  std::string last_line;   ///< of the two, the line that was written last
};

/// Runs `arguments[0]` (searched on PATH unless it names a folder) to its end or its limits. Not being able
/// to start it is an Error.
[[nodiscard]] Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments,
                                                 const ProcessOptions& options);

/// Whether PATH has an executable of this name.
[[nodiscard]] bool program_exists(const std::string& name);

}  // namespace palpate
