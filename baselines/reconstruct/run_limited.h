// Runs one reconstruction in a separate process, within limits.
#pragma once

#include <cstddef>
#include <cstdint>

#include <palpate/progress.h>
#include "baselines/reconstruct/methods.h"
#include "baselines/reconstruct/reconstruction.h"

namespace palpate::baselines {

struct Limits {
  double time_s = 120.0;         ///< 0: none
  std::size_t memory_bytes = 0;  ///< of the worker process; 0: see memory_limit()
};

/// The memory limit; by default three quarters of the machine's memory.
[[nodiscard]] std::size_t memory_limit(const Limits& limits);

/// Runs make_mesh() in the program palpate-reconstruct, found beside the running program, built or installed,
/// or through PALPATE_RECONSTRUCT. The worker ends at the limits, when cancelled, and with this process. It
/// writes no file.
///
/// Errors: those of make_mesh(); "did not finish in N s" and "needed more than N GB" (with gave_up); a crash,
/// with the library's last printed line; no worker program.
[[nodiscard]] Result<Reconstruction> run_limited(const Method& method, const cloud::Cloud& cloud,
                                                 const Options& options, const Limits& limits, int threads,
                                                 Progress& progress);

/// Protocol over one socket, the worker's standard input. To the worker: a cloud's length (8 bytes) and the
/// cloud. From it: messages of kind (1 byte), length (8 bytes), content. Without a final kResult, kError or
/// kNoMemory the worker crashed.
enum class WorkerMessage : std::uint8_t {
  kProgress = 1,  ///< name of the phase that begins
  kResult,
  kError,
  kNoMemory,  ///< memory limit reached; no content
};

inline constexpr std::size_t kMessageHead = 9;

/// Worker arguments: method, number of threads, memory limit in bytes (0: none), parent process (the worker
/// ends with it), then the method's options as key=value.
inline constexpr int kWorkerFixedArguments = 4;

}  // namespace palpate::baselines
