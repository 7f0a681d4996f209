// Fetches a known scan into the cache: complete, checked, size-limited, or not at all.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "experiments/data/locate.h"

namespace palpate::experiments {

/// Limit of a download and its unpacked file without a listed size: four times the Stanford repository's
/// largest file.
inline constexpr std::uint64_t kDownloadLimitBytes = std::uint64_t{4} << 30;

/// Free bytes on the disk of `folder`; the maximum if unknown.
[[nodiscard]] std::uint64_t free_bytes(const std::filesystem::path& folder);

struct FetchOptions {
  std::filesystem::path cache;           ///< from cache_folder(), elsewhere in tests
  const io::Readers* readers = nullptr;  ///< read files without a known checksum
  double connect_limit_s = 6.0;          ///< until an unreachable network fails
  double stall_limit_s = 10.0;           ///< until a nearly silent link fails
  double total_limit_s = 900.0;          ///< per source
  std::uint64_t download_limit_bytes = kDownloadLimitBytes;
  bool force = false;  ///< replaces existing files, keeping those that differ from an earlier fetch's record
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes = experiments::free_bytes;
};

/// Tries the scan's sources in order. Downloads to `cache`/partial, resumes there after an interruption, and
/// moves the file into place once its checksum is right. A wrong checksum deletes the download and is an
/// Error. Without a known checksum the content must be a model with the scan's number of points; its checksum
/// is recorded beside it. No file outgrows the least of known size, announcement, limit and free space;
/// larger announcements are refused at once. Of two concurrent calls on one cache the second is refused.
[[nodiscard]] Result<std::filesystem::path> fetch_scan(const Scan& scan, const FetchOptions& options,
                                                       Progress& progress);

/// Error: the file's checksum differs from the list's or the record's. O(size).
[[nodiscard]] Status check_stored(const Scan& scan, const std::filesystem::path& file);

/// A scan's file and its origin.
struct BroughtScan {
  std::filesystem::path file;
  bool fetched = false;
  std::string note;  ///< reason for a repeated fetch, a sentence; or empty
};
/// The scan's local file if it passes check_stored(), else a new one; always a new one with options.force.
/// Error: a wrong file in $PALPATE_DATA, which is never replaced.
[[nodiscard]] Result<BroughtScan> bring_scan(const Scan& scan, const FetchOptions& options,
                                             Progress& progress);

}  // namespace palpate::experiments
