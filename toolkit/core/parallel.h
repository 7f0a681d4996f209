// All parallelism of preparation goes through this function. It runs on oneTBB, or on std::thread where
// PALPATE_STD_THREADS is defined: ThreadSanitizer cannot see oneTBB's synchronisation, so its build uses the
// latter and needs no suppressions.
//
// Determinism: a result must not depend on `threads`. Give every index its own output, or reduce over fixed
// chunks in index order.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>

namespace palpate {

/// Points per chunk in passes with little work each: large enough to hide the hand-over, small enough for
/// about sixty chunks per million. Does not affect results.
inline constexpr std::size_t kPointsPerChunk = 16384;

/// Calls body(begin, end) for consecutive chunks of at most `grain` covering [0, count), on up to `threads`
/// threads (0 = all; at most the machine's). Chunk borders depend on `grain` only. Returns when all are done.
/// body must not throw.
void parallel_chunks(std::size_t count, std::size_t grain, int threads,
                     const std::function<void(std::size_t begin, std::size_t end)>& body);

/// The number of threads for 0.
[[nodiscard]] int available_threads() noexcept;

/// Ends idle worker threads before a fork: the child has only the forking thread and would wait for them for
/// ever. They return with the next work. False if some are busy, or if this build cannot be forked
/// (ThreadSanitizer).
[[nodiscard]] bool stop_idle_workers();

/// Name and version of the loaded parallel runtime.
[[nodiscard]] std::pair<std::string, std::string> parallel_library();

}  // namespace palpate
