// Brings a known scan into the cache: whole, checked, or not at all.
#pragma once

#include <filesystem>
#include <string>

#include "experiments/data/locate.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"

namespace palpate::experiments {

struct FetchOptions {
  std::filesystem::path cache;   ///< from cache_folder(), or elsewhere in tests
  double connect_limit_s = 6.0;  ///< an unreachable network fails after this long
  double total_limit_s = 900.0;  ///< per source
};

/// Tries the scan's sources in order. A download goes to `cache`/partial and is resumed there by the next
/// call after an interruption; it is moved to its place after its checksum has been found right. A wrong
/// checksum deletes the download and is an Error. Two calls at once on one cache: the second one is refused.
[[nodiscard]] Result<std::filesystem::path> fetch_scan(const Scan& scan, const FetchOptions& options,
                                                       Progress& progress);

}  // namespace palpate::experiments
