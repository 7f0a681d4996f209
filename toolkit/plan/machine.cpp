#include "toolkit/plan/machine.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <limits>
#include <numeric>
#include <sstream>

#include <palpate/options.h>
#include "toolkit/core/atomic_file.h"
#include "toolkit/core/cache_folder.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/input_file.h"
#include "toolkit/core/large_pages.h"
#include "toolkit/core/number_format.h"
#include "toolkit/core/random.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::plan {
namespace {

namespace fs = std::filesystem;

// From a first-level cache to beyond every desktop cache.
constexpr std::size_t kMinBytes = std::size_t{1} << 14, kMaxBytes = std::size_t{1} << 26;
constexpr std::size_t kGrowth = 4;
constexpr std::size_t kLine = 64;
// 0.03 s at 100 ns a read; the fastest of three runs counts.
constexpr std::size_t kReads = 300'000;
constexpr int kRepeats = 3;
constexpr std::uint64_t kSeed = 20'090'413;
constexpr std::uint64_t kMaxFileBytes = 1 << 16;
constexpr const char* kHead = "palpate-machine-1";

double thread_cpu_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return 1e9 * static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec);
}

/// One random cycle through all lines (Sattolo 1986): no read is predictable.
double chase_ns(std::size_t bytes) {
  struct alignas(kLine) Line {
    std::uint64_t next = 0;
  };
  const std::size_t count = bytes / kLine;
  LargePageVector<Line> lines(count);
  for (std::size_t i = 0; i < count; ++i) lines[i].next = i;
  Random random(kSeed);
  for (std::size_t i = count - 1; i > 0; --i)
    std::swap(lines[i].next, lines[static_cast<std::size_t>(random.below(i))].next);
  double fastest = std::numeric_limits<double>::max();
  std::uint64_t at = 0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const double start = thread_cpu_ns();
    for (std::size_t i = 0; i < kReads; ++i) at = lines[at].next;
    fastest = std::min(fastest, thread_cpu_ns() - start);
  }
  // Using the final position prevents optimising the loop away.
  return at < count ? fastest / static_cast<double>(kReads) : 0.0;
}

fs::path cache_file(const std::string& cpu, const std::string& version) {
  const fs::path folder = cache_folder();
  if (folder.empty()) return {};
  Hash64 hash;
  for (const char c : fmt::format("{}\n{}", cpu, version)) hash.byte(static_cast<std::uint8_t>(c));
  return folder / fmt::format("machine-{}.txt", hash.hex());
}

/// No reads if the file is missing or invalid.
std::vector<ReadLatency> read_cached(const fs::path& file, const std::string& cpu) {
  const Result<std::string> text = read_file(file.string(), kMaxFileBytes);
  if (!text) return {};
  std::istringstream lines(*text);
  std::string head, named;
  if (!std::getline(lines, head) || head != kHead || !std::getline(lines, named) || named != cpu) return {};
  std::vector<ReadLatency> reads;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t blank = line.find(' ');
    if (blank == std::string::npos) return {};
    const Result<double> bytes = parse_number(line.substr(0, blank)),
                         ns = parse_number(line.substr(blank + 1));
    if (!bytes || !ns || !(*ns > 0.0) || (!reads.empty() && !(*bytes > reads.back().bytes))) return {};
    reads.push_back({*bytes, *ns});
  }
  return reads;
}

/// If it cannot be kept, it is measured again next time.
void keep(const fs::path& file, const Machine& machine) {
  std::error_code code;
  fs::create_directories(file.parent_path(), code);
  std::string text = fmt::format("{}\n{}\n", kHead, machine.cpu);
  for (const ReadLatency& read : machine.reads) text += fmt::format("{} {}\n", read.bytes, read.ns);
  Result<AtomicFile> out = AtomicFile::create(file.string());
  if (out && out->write(text)) (void)out->commit();
}

}  // namespace

double Machine::read_ns(double bytes) const noexcept {
  if (reads.empty()) return 0.0;
  if (!(bytes > reads.front().bytes)) return reads.front().ns;
  for (std::size_t i = 1; i < reads.size(); ++i) {
    if (bytes > reads[i].bytes) continue;
    const ReadLatency &below = reads[i - 1], &above = reads[i];
    const double share = std::log(bytes / below.bytes) / std::log(above.bytes / below.bytes);
    return below.ns + share * (above.ns - below.ns);
  }
  return reads.back().ns;
}

Machine measure_machine(const std::string& version, bool anew, Progress* progress) {
  Machine machine;
  machine.cpu = metrics::machine_info().cpu;
  const fs::path file = cache_file(machine.cpu, version);
  if (!anew && !file.empty()) machine.reads = read_cached(file, machine.cpu);
  machine.from_cache = !machine.reads.empty();
  if (machine.from_cache) return machine;
  for (std::size_t bytes = kMinBytes; bytes <= kMaxBytes; bytes *= kGrowth) {
    if (progress != nullptr)
      progress->report("measuring this machine", std::log(static_cast<double>(bytes / kMinBytes) + 1.0) /
                                                     std::log(static_cast<double>(kMaxBytes / kMinBytes)));
    machine.reads.push_back({static_cast<double>(bytes), chase_ns(bytes)});
  }
  if (!file.empty()) keep(file, machine);
  return machine;
}

std::string text(const Machine& machine) {
  std::string out = machine.cpu + ":";
  for (const ReadLatency& read : machine.reads)
    out += fmt::format("{} {} ns from {}", &read == machine.reads.data() ? " a read waits" : ",",
                       format_number(read.ns), format_bytes(read.bytes));
  return out;
}

}  // namespace palpate::plan
