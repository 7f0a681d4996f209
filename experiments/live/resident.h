// Resident memory of the process.
#pragma once

#include <cstdint>

namespace palpate::experiments {

/// Bytes, after returning freed memory to the system. Not for the servo's thread: takes the heap's locks and
/// reads a file.
[[nodiscard]] std::uint64_t resident_bytes();

}  // namespace palpate::experiments
