// What a reconstruction's process and ours say to each other over one socket, which is its standard input.
//
// To it: the length of a cloud, 8 bytes, and the cloud. From it: messages of a kind (1 byte), a length (8
// bytes) and so many bytes. The last one is kResult, kError or kNoMemory; without one of these it has
// crashed.
#pragma once

#include <cstdint>

namespace palpate::baselines {

enum class WorkerMessage : std::uint8_t {
  kProgress = 1,  ///< the name of the phase that begins
  kResult,        ///< a Reconstruction
  kError,         ///< an Error
  kNoMemory,      ///< the limit of memory was reached; no bytes
};

inline constexpr std::size_t kMessageHead = 9;

/// Its arguments: the method, the number of threads, the limit of memory in bytes (0: none), the process that
/// must live for it to go on; then the method's options as key=value.
inline constexpr int kWorkerFixedArguments = 4;

}  // namespace palpate::baselines
