// Runs a program without a shell; arguments are passed unchanged. It has its own process group, is ended at
// its limits with its children, and ends with this program.
#pragma once

#include <csignal>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <palpate/result.h>

namespace palpate {

inline constexpr int kSignalBase = 128;                           ///< exit code base, as in shells
inline constexpr int kFileLimitExitCode = kSignalBase + SIGXFSZ;  ///< a file reached its limit

/// A dialogue with a program over a socket as its standard input.
struct ProcessSocket {
  std::string to_send;
  /// Called with all unprocessed input. False ends the program.
  std::function<bool(std::string& received)> hear;
};

struct ProcessOptions {
  double time_limit_s = 0.0;  ///< 0: none
  double grace_s = 2.0;       ///< between asking a program to end and ending it
  std::string folder{};       ///< working folder; empty: ours
  /// Above 0: largest file that it may write; beyond, the write fails or a signal ends it (exit code
  /// kFileLimitExitCode).
  std::uint64_t file_limit_bytes = 0;
  /// Called several times a second. False ends the program.
  std::function<bool()> tick{};
  ProcessSocket* talk = nullptr;  ///< null: empty input
};

struct ProcessOutcome {
  int exit_code = 0;       ///< 128 + signal if a signal ended it
  int signal = 0;          ///< that ended it; 0: none
  bool timed_out = false;  ///< at the time limit
  bool stopped = false;    ///< by tick() or hear()
  std::string out;         ///< first MiB of standard output
  std::string err;         ///< first MiB of standard error
  std::string last_line;   ///< last line written to either
};

/// Runs `arguments[0]` (searched on PATH unless it has a folder) to its end or limits. Failure to start is an
/// Error.
[[nodiscard]] Result<ProcessOutcome> run_process(const std::vector<std::string>& arguments,
                                                 const ProcessOptions& options);

/// True if PATH has an executable of this name.
[[nodiscard]] bool program_exists(const std::string& name);

}  // namespace palpate
