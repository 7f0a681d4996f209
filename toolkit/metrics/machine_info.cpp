#include "toolkit/metrics/machine_info.h"

#include <sys/utsname.h>
#include <unistd.h>

#include <array>
#include <ctime>
#include <fstream>
#include <istream>
#include <sstream>

#include "toolkit/core/parallel.h"

namespace palpate::metrics {
namespace {

std::string cpu_name() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("model name", 0) != 0 && line.rfind("Model", 0) != 0) continue;  // x86; some ARM boards
    const std::size_t colon = line.find(": ");
    if (colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown";
}

std::uint64_t memory_bytes() {
  const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
  return pages > 0 && page_bytes > 0
             ? static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page_bytes)
             : 0;
}

std::string kernel_name() {
  utsname name{};
  if (uname(&name) != 0) return "unknown";
  return std::string(name.sysname) + " " + name.release + " " + name.machine;
}

std::string compiler_name() {
#if defined(__clang__)
  return "clang " + std::to_string(__clang_major__) + "." + std::to_string(__clang_minor__) + "." +
         std::to_string(__clang_patchlevel__);
#elif defined(__GNUC__)
  return "gcc " + std::to_string(__GNUC__) + "." + std::to_string(__GNUC_MINOR__) + "." +
         std::to_string(__GNUC_PATCHLEVEL__);
#else
  return "unknown";
#endif
}

}  // namespace

MachineInfo machine_info() {
  return {cpu_name(), available_threads(), memory_bytes(), kernel_name(), compiler_name()};
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  char text[sizeof "2026-01-31T12:00:00Z"] = "";
  if (gmtime_r(&now, &utc) == nullptr || std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc) == 0)
    return "unknown";
  return text;
}

namespace {

constexpr const char* kNotShown = "not shown";
constexpr double kPercent = 100.0;

std::string first_line(std::istream&& in) {
  std::string line;
  return std::getline(in, line) ? line : std::string();
}

/// "always [madvise] never": the bracketed word.
std::string chosen(const std::string& line) {
  const std::size_t open = line.find('['), close = line.find(']');
  return open < close && close != std::string::npos ? line.substr(open + 1, close - open - 1) : kNotShown;
}

/// Instruction sets that affect frame times.
constexpr std::array kSets = {"sse4_2", "avx", "fma", "avx2", "avx512f", "avx512vl", "asimd", "sve"};

std::string processor_sets() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("flags", 0) != 0 && line.rfind("Features", 0) != 0) continue;
    std::istringstream words(line);
    std::string found;
    for (std::string word; words >> word;)
      for (const char* set : kSets)
        if (word == set) found += (found.empty() ? "" : " ") + word;
    return found.empty() ? kNotShown : found;
  }
  return kNotShown;
}

std::string compiled_for() {
  std::string sets;
  const auto add = [&](const char* set) { sets += (sets.empty() ? "" : " ") + std::string(set); };
#ifdef __x86_64__
  add("x86-64");
#endif
#ifdef __aarch64__
  add("aarch64");
#endif
#ifdef __SSE4_2__
  add("sse4_2");
#endif
#ifdef __AVX__
  add("avx");
#endif
#ifdef __FMA__
  add("fma");
#endif
#ifdef __AVX2__
  add("avx2");
#endif
#ifdef __AVX512F__
  add("avx512f");
#endif
  return sets.empty() ? kNotShown : sets;
}

}  // namespace

double load_now() {
  std::istringstream text(first_line(std::ifstream("/proc/loadavg")));
  double load = 0.0;
  text >> load;
  return text ? load : 0.0;
}

std::optional<ProcessorTicks> processor_ticks() {
  std::istringstream text(first_line(std::ifstream("/proc/stat")));
  std::string name;
  text >> name;
  // user, nice, system, idle, iowait, irq, softirq, steal; guest time is part of user.
  constexpr int kKinds = 8;
  ProcessorTicks ticks;
  for (int kind = 0; kind < kKinds; ++kind) {
    std::uint64_t count = 0;
    if (!(text >> count)) return std::nullopt;
    ticks.all += count;
    if (kind + 1 == kKinds) ticks.stolen = count;
  }
  return name == "cpu" ? std::optional(ticks) : std::nullopt;
}

std::optional<double> stolen_percent(const std::optional<ProcessorTicks>& before,
                                     const std::optional<ProcessorTicks>& after) {
  if (!before || !after || after->all <= before->all || after->stolen < before->stolen) return std::nullopt;
  return kPercent * static_cast<double>(after->stolen - before->stolen) /
         static_cast<double>(after->all - before->all);
}

MeasurementConditions current_conditions() {
  MeasurementConditions now;
  now.governor = first_line(std::ifstream("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"));
  if (now.governor.empty()) now.governor = kNotShown;
  now.huge_pages = chosen(first_line(std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled")));
  now.processor_sets = processor_sets();
  now.compiled_for = compiled_for();
  now.load_before = now.load_after = load_now();
  return now;
}

}  // namespace palpate::metrics
