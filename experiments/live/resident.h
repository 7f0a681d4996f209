// What the process has in memory.
#pragma once

#include <cstdint>

namespace palpate::experiments {

/// Bytes; what was freed is given back first. Not for the servo's thread: it takes the heap's locks and reads
/// a file.
[[nodiscard]] std::uint64_t resident_bytes();

}  // namespace palpate::experiments
