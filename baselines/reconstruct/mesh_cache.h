// Reconstructions kept by what they were made from.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "baselines/reconstruct/methods.h"
#include "baselines/reconstruct/reconstruction.h"
#include "baselines/reconstruct/run_limited.h"

namespace palpate::baselines {

/// What an entry is found by: the points and their raster, the method with its version and the version of its
/// library, every option.
[[nodiscard]] std::string cache_key(const Method& method, const cloud::Cloud& cloud, const Options& options);

/// An answer from the cache: a mesh, or that a limit was once reached (gave_up).
using CachedAnswer = Result<Reconstruction>;

/// A folder of entries. Several processes may share it: an entry appears whole or not at all, and every
/// reading checks the whole of it.
class MeshCache {
 public:
  /// `most_bytes`: beyond, the entries that were not read for longest go.
  explicit MeshCache(std::filesystem::path folder, std::uint64_t most_bytes = kMostBytes)
      : folder_(std::move(folder)), most_bytes_(most_bytes) {}
  /// cache_folder()/meshes, or the folder that the variable PALPATE_MESH_CACHE names; none where that says
  /// "off" or there is no folder for a cache.
  [[nodiscard]] static std::optional<MeshCache> standard();

  /// The answer kept for `key`, if there is one that is whole. One that says that a limit was reached counts
  /// only where `limits` allow no more than it had. A damaged entry is removed.
  [[nodiscard]] std::optional<CachedAnswer> find(const std::string& key, const Limits& limits) const;
  /// Keeps a mesh, or an Error with gave_up under the limits it was given; other Errors are not kept. The
  /// cache is a convenience: that it cannot be written is an Error the caller may pass over.
  [[nodiscard]] Status keep(const std::string& key, const Result<Reconstruction>& answer,
                            const Limits& limits);

  [[nodiscard]] std::filesystem::path file_of(const std::string& key) const;

  static constexpr std::uint64_t kMostBytes = 8'000'000'000;  // some sixty meshes of a million points

 private:
  void make_room() const;
  std::filesystem::path folder_;
  std::uint64_t most_bytes_;
};

}  // namespace palpate::baselines
