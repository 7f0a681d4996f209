// Brings a known scan into the cache: whole, checked, bounded, or not at all.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "experiments/data/locate.h"
#include "toolkit/core/progress.h"
#include "toolkit/core/result.h"
#include "toolkit/io/read_model.h"

namespace palpate::experiments {

/// A download, and what is unpacked of it, may be so large where the list of scans does not know: four times
/// the largest single file of the Stanford repository.
inline constexpr std::uint64_t kDownloadLimitBytes = std::uint64_t{4} << 30;

/// Bytes that may still be written where `folder` is; all there could be where nobody can say.
[[nodiscard]] std::uint64_t free_bytes(const std::filesystem::path& folder);

struct FetchOptions {
  std::filesystem::path cache;           ///< from cache_folder(), or elsewhere in tests
  const io::Readers* readers = nullptr;  ///< read what no checksum is known of
  double connect_limit_s = 6.0;          ///< an unreachable network fails after this long
  double stall_limit_s = 10.0;           ///< as does a link that gives next to nothing
  double total_limit_s = 900.0;          ///< per source
  std::uint64_t download_limit_bytes = kDownloadLimitBytes;
  bool force = false;  ///< replaces what is there, and keeps what differs from the record of an earlier fetch
  std::function<std::uint64_t(const std::filesystem::path&)> free_bytes = experiments::free_bytes;
};

/// Tries the scan's sources in order. A download goes to `cache`/partial and is resumed there by the next
/// call after an interruption; it is moved to its place after its checksum has been found right. A wrong
/// checksum deletes the download and is an Error. Where no checksum is known the content must be a model of
/// as many points as the scan has, and its checksum is recorded beside it. No file grows beyond what is known
/// of its size, the source's own announcement, the limit or the free space, the least of them; what is
/// announced larger is refused before a byte comes. Two calls at once on one cache: the second one is
/// refused.
[[nodiscard]] Result<std::filesystem::path> fetch_scan(const Scan& scan, const FetchOptions& options,
                                                       Progress& progress);

/// An Error where a checksum of this file of the scan is known, by the list or a record beside it, and the
/// file's is another. O(size).
[[nodiscard]] Status check_stored(const Scan& scan, const std::filesystem::path& file);

/// A scan's file, and how it came.
struct BroughtScan {
  std::filesystem::path file;
  bool fetched = false;
  std::string note;  ///< why it was fetched again, a whole sentence; or empty
};
/// The scan's file: the one that is here where it passes check_stored(), else a new one. With options.force
/// always a new one. A wrong file in $PALPATE_DATA is nobody's to replace: an Error.
[[nodiscard]] Result<BroughtScan> bring_scan(const Scan& scan, const FetchOptions& options,
                                             Progress& progress);

}  // namespace palpate::experiments
