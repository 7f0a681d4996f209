// Reconstructs a mesh from points, by any method. It is made within limits or taken from the cache.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/options.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "baselines/reconstruct/reconstruction.h"

namespace palpate::baselines {

struct Method {
  std::string name;
  std::string summary;  ///< one line
  std::string source;   ///< paper and library
  /// Keys are unique over all methods, or mean the same. Lengths are in spacings (the root of the occupied
  /// area per point), so the mesh scales with the cloud.
  std::vector<OptionSpec> options;
  int version = 1;  ///< increased when the same points would give another mesh; part of the cache key
  bool raster_only = false;  ///< needs a cloud in a scanner's full raster
  std::string not_built{};   ///< why this build lacks it; empty if present
};

/// advancing-front, poisson, scale-space, alpha-shape, power-crust, ball-pivoting, greedy-projection,
/// marching-cubes, organised, stars.
[[nodiscard]] const std::vector<Method>& methods();
/// Finds a method by name. The Error names all methods, or says how to get one that this build lacks.
[[nodiscard]] Result<const Method*> find_method(std::string_view name);
/// Options of all methods, each key once, conditional on the option `method_key`.
[[nodiscard]] std::vector<OptionSpec> all_method_options(const std::string& method_key);
[[nodiscard]] Options own_options(const Method& method, const Options& options);

// Runs one reconstruction in a separate process, within limits.

struct Limits {
  double time_s = 120.0;         ///< 0: none
  std::size_t memory_bytes = 0;  ///< of the worker process; 0: see memory_limit()
};

/// The memory limit; by default three quarters of the machine's memory.
[[nodiscard]] std::size_t memory_limit(const Limits& limits);

/// Runs make_mesh() in the program palpate-reconstruct, found beside the running program, built or installed,
/// or through PALPATE_RECONSTRUCT. The worker ends at the limits, when cancelled, and with this process. It
/// writes no file.
///
/// Errors: those of make_mesh(); "did not finish in N s" and "needed more than N GB" (with gave_up); a crash,
/// with the library's last printed line; no worker program.
[[nodiscard]] Result<Reconstruction> run_limited(const Method& method, const cloud::Cloud& cloud,
                                                 const Options& options, const Limits& limits, int threads,
                                                 Progress& progress);

/// Protocol over one socket, the worker's standard input. To the worker: a cloud's length (8 bytes) and the
/// cloud. From it: messages of kind (1 byte), length (8 bytes), content. Without a final kResult, kError or
/// kNoMemory the worker crashed.
enum class WorkerMessage : std::uint8_t {
  kProgress = 1,  ///< name of the phase that begins
  kResult,
  kError,
  kNoMemory,  ///< memory limit reached; no content
};

inline constexpr std::size_t kMessageHead = 9;

/// Worker arguments: method, number of threads, memory limit in bytes (0: none), parent process (the worker
/// ends with it), then the method's options as key=value.
inline constexpr int kWorkerFixedArguments = 4;

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
