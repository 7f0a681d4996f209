#include "baselines/reconstruct/reconstruct.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>

#include <palpate/result.h>
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/cache_folder.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/parallel.h"

namespace palpate::baselines {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMagic = 0x3148534D50'4C5050;  // "PPLPMSH1"
constexpr const char* kEnding = ".mesh";

enum class Kind : std::uint8_t { kMesh = 1, kGaveUp };

std::uint64_t hash_of(std::string_view bytes) {
  Hash64 hash;
  hash.bytes(std::as_bytes(std::span(bytes)));
  return hash.value();
}

/// The time limit in comparable form: none is infinite.
double time_of(const Limits& limits) {
  return limits.time_s > 0.0 ? limits.time_s : std::numeric_limits<double>::infinity();
}

/// The bytes between magic and checksum; nothing if these are wrong.
std::optional<std::string_view> checked_body(std::string_view bytes) {
  constexpr std::size_t kWord = sizeof(std::uint64_t);
  if (bytes.size() < 2 * kWord) return std::nullopt;
  const std::string_view before = bytes.substr(0, bytes.size() - kWord);
  ByteReader ends(bytes.substr(bytes.size() - kWord)), starts(before);
  if (ends.value<std::uint64_t>() != hash_of(before) || starts.value<std::uint64_t>() != kMagic)
    return std::nullopt;
  return before.substr(kWord);
}

}  // namespace

std::string cache_key(const Method& method, const cloud::Cloud& cloud, const Options& options) {
  ByteWriter bytes;
  write(bytes, cloud);
  std::string key = fmt::format("{} {} ({}) points={} hash={:016x}", method.name, method.version,
                                PALPATE_MESH_LIBRARIES, cloud.size(), hash_of(bytes.bytes()));
  for (const auto& [name, value] : options.all()) key += fmt::format(" {}={}", name, value);
  return key;
}

std::optional<MeshCache> MeshCache::standard() {
  if (const char* given = std::getenv("PALPATE_MESH_CACHE"); given != nullptr && *given != '\0') {
    if (std::string_view(given) == "off") return std::nullopt;
    return MeshCache(given);
  }
  const fs::path folder = cache_folder();
  if (folder.empty()) return std::nullopt;
  return MeshCache(folder / "meshes");
}

fs::path MeshCache::file_of(const std::string& key) const {
  return folder_ / fmt::format("{}-{:016x}{}", key.substr(0, key.find(' ')), hash_of(key), kEnding);
}

std::optional<CachedAnswer> MeshCache::find(const std::string& key, const Limits& limits) const {
  const fs::path path = file_of(key);
  std::error_code code;
  const Result<std::string> bytes = read_file(path.string(), kMemoryLimitBytes);
  if (!bytes) return std::nullopt;
  const std::optional<std::string_view> body = checked_body(*bytes);
  ByteReader reader(body.value_or(std::string_view()));
  if (reader.value<std::string>() != key || !reader.good()) {
    fs::remove(path, code);
    return std::nullopt;
  }
  if (reader.value<Kind>() == Kind::kGaveUp) {
    const auto time_s = reader.value<double>();
    const auto memory = reader.value<std::uint64_t>();
    const auto made_on = reader.value<std::string>();
    Error error = read_error(reader);
    if (!reader.at_end() || time_of(limits) > time_s || memory_limit(limits) > memory) return std::nullopt;
    error.what += fmt::format(" [recorded {}]", made_on);
    return error;
  }
  Result<Reconstruction> kept = read_reconstruction(reader);
  if (!kept || !reader.at_end()) {
    fs::remove(path, code);
    return std::nullopt;
  }
  kept->recorded = true;
  fs::last_write_time(path, fs::file_time_type::clock::now(), code);  // marks the entry as recently used
  return kept;
}

Status MeshCache::keep(const std::string& key, const Result<Reconstruction>& answer, const Limits& limits) {
  if (!answer && !answer.error().gave_up) return Done{};
  ByteWriter body;
  body(kMagic);
  body(key);
  if (answer) {
    body(Kind::kMesh);
    write(body, *answer);
  } else {
    body(Kind::kGaveUp);
    body(time_of(limits));
    body(static_cast<std::uint64_t>(memory_limit(limits)));
    body(now_text());
    write(body, answer.error());
  }
  body(hash_of(body.bytes()));
  std::error_code code;
  fs::create_directories(folder_, code);
  PALPATE_TRY(write_file(file_of(key).string(), body.bytes()));
  make_room();
  return Done{};
}

void MeshCache::make_room() const {
  struct Entry {
    fs::file_time_type read;
    std::uint64_t bytes;
    fs::path path;
  };
  // Remains of a killed writer.
  constexpr auto kStale = std::chrono::hours(1);
  std::vector<Entry> entries;
  std::uint64_t sum = 0;
  std::error_code code;
  for (const fs::directory_entry& file : fs::directory_iterator(folder_, code)) {
    const fs::file_time_type read = file.last_write_time(code);
    const std::uint64_t bytes = file.file_size(code);
    if (file.path().extension() != kEnding) {
      if (fs::file_time_type::clock::now() - read > kStale) fs::remove(file.path(), code);
      continue;
    }
    entries.push_back({read, bytes, file.path()});
    sum += bytes;
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.read < b.read; });
  for (std::size_t i = 0; i + 1 < entries.size() && sum > most_bytes_; ++i) {
    fs::remove(entries[i].path, code);
    sum -= entries[i].bytes;
  }
}

Result<Reconstruction> reconstruct(const ReconstructRequest& request, const cloud::Cloud& cloud,
                                   Progress& progress) {
  PALPATE_ASSIGN(const Method* const method, find_method(request.method));
  PALPATE_ASSIGN(const Options options, validate(request.options, method->options, request.method));
  std::string key;
  if (request.cache != nullptr) {
    progress.report(request.method + ": looking into the cache", -1.0);
    key = cache_key(*method, cloud, options);
    if (std::optional<CachedAnswer> kept = request.cache->find(key, request.limits)) return *std::move(kept);
  }
  const int threads = request.threads > 0 ? request.threads : available_threads();
  Result<Reconstruction> made = run_limited(*method, cloud, options, request.limits, threads, progress);
  if (request.cache != nullptr)
    if (const Status kept = request.cache->keep(key, made, request.limits); !kept && made)
      made->made.notes.push_back("not kept in the cache: " + kept.error().message());
  return made;
}

}  // namespace palpate::baselines
