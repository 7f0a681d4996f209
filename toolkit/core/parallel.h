// All parallelism of preparation goes through this function. It runs on oneTBB, or on std::thread where
// PALPATE_STD_THREADS is defined: ThreadSanitizer cannot see oneTBB's synchronisation, so its build uses the
// latter and needs no suppressions.
//
// Determinism: a result must not depend on `threads`. Give every index its own output, or reduce over fixed
// chunks in index order.
#pragma once

#include <cstddef>
#include <functional>

namespace palpate {

/// Points a chunk where a pass over all of them gives each little work: long enough to hide the hand-over of
/// a chunk, short enough that a million make some sixty of them. It decides nothing about a result.
inline constexpr std::size_t kPointsPerChunk = 16384;

/// Calls body(begin, end) for consecutive chunks of at most `grain` covering [0, count), on up to `threads`
/// threads (0 = all; never more than the machine has). Chunk borders depend on `grain` alone. Returns when
/// all are done. body must not throw.
void parallel_chunks(std::size_t count, std::size_t grain, int threads,
                     const std::function<void(std::size_t begin, std::size_t end)>& body);

/// The number of threads that 0 stands for.
[[nodiscard]] int available_threads() noexcept;

}  // namespace palpate
