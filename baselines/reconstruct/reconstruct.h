// A mesh from points by any method, made within limits or taken from the cache of reconstructions.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "baselines/reconstruct/methods.h"
#include "baselines/reconstruct/reconstruction.h"
#include "baselines/reconstruct/run_limited.h"

namespace palpate::baselines {

/// Key: the points and their raster, the method with its version and its library's version, every option.
[[nodiscard]] std::string cache_key(const Method& method, const cloud::Cloud& cloud, const Options& options);

/// A cached answer: a mesh, or the Error of a reached limit (gave_up).
using CachedAnswer = Result<Reconstruction>;

/// A folder of entries. Processes may share it: entries appear atomically, and every read checks the whole
/// entry.
class MeshCache {
 public:
  /// `most_bytes`: beyond it the least recently read entries are deleted.
  explicit MeshCache(std::filesystem::path folder, std::uint64_t most_bytes = kMaxBytes)
      : folder_(std::move(folder)), most_bytes_(most_bytes) {}
  /// cache_folder()/meshes, or the folder in PALPATE_MESH_CACHE; none if that is "off" or there is no cache
  /// folder.
  [[nodiscard]] static std::optional<MeshCache> standard();

  /// The intact answer for `key`, if any. A reached limit counts only if `limits` allow no more than it had.
  /// Removes damaged entries.
  [[nodiscard]] std::optional<CachedAnswer> find(const std::string& key, const Limits& limits) const;
  /// Keeps a mesh, or an Error with gave_up and its limits; other Errors are ignored. A failed write is an
  /// Error that callers may ignore.
  [[nodiscard]] Status keep(const std::string& key, const Result<Reconstruction>& answer,
                            const Limits& limits);

  [[nodiscard]] std::filesystem::path file_of(const std::string& key) const;

  static constexpr std::uint64_t kMaxBytes = 8'000'000'000;  // about sixty meshes of a million points

 private:
  void make_room() const;
  std::filesystem::path folder_;
  std::uint64_t most_bytes_;
};

struct ReconstructRequest {
  std::string method;  ///< one of methods()
  Options options;     ///< of the method; missing ones get defaults
  Limits limits;
  int threads = 0;             ///< 0 = all
  MeshCache* cache = nullptr;  ///< null: no cache
};

/// The reconstruction of `cloud`, model frame. From the cache, `recorded` is set and the times are those of
/// its making. Errors: unknown method or option, and those of run_limited(). A reached limit is cached for
/// requests that allow no more.
[[nodiscard]] Result<Reconstruction> reconstruct(const ReconstructRequest& request, const cloud::Cloud& cloud,
                                                 Progress& progress);

}  // namespace palpate::baselines
