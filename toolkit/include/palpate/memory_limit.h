// The default limit on memory for reading one file.
//
// First:
//   io::ReadOptions options;
//   options.max_bytes = 2 * palpate::kMemoryLimitBytes;  // a scan of 200 million points
//   auto model = readers.read("scan.ply", options);
#pragma once

#include <cstdint>

namespace palpate {

/// About 100 million points without faces.
inline constexpr std::uint64_t kMemoryLimitBytes = std::uint64_t{1} << 32;

}  // namespace palpate
