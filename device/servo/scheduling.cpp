#include <palpate/device/scheduling.h>

#include <fcntl.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cfenv>
#include <cstring>
#include <fstream>
#include <limits>
#include <mutex>
#include <sstream>

namespace palpate::device {
namespace {

constexpr const char* kDoctor = "`palpate list devices --doctor` says the lines that allow it";

// Stack of a frame, its callees and a signal: mostly a renderer's fixed arrays, some tens of KB.
constexpr std::size_t kStackBytes = std::size_t{256} * 1024;
constexpr std::size_t kPageBytes = 4096;

std::string reason() {
  return std::strerror(errno);  // NOLINT(concurrency-mt-unsafe): before the loop runs
}

/// Faults in the stack pages before the first frame.
[[gnu::noinline]] void touch_stack() noexcept {
  std::array<volatile unsigned char, kStackBytes> stack;
  for (std::size_t i = 0; i < kStackBytes; i += kPageBytes) stack[i] = 0;
}

/// True if this thread flushes denormals to zero.
bool flushes_denormals() noexcept {
  volatile double least = std::numeric_limits<double>::min();
  volatile const double half = least * 0.5;
  least = half;
  return least == 0.0;
}

/// The CPUs that this process may use.
std::vector<int> usable_cpus() {
  cpu_set_t set;
  CPU_ZERO(&set);
  std::vector<int> cpus;
  if (::sched_getaffinity(::getpid(), sizeof set, &set) != 0) return cpus;
  for (std::size_t cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(cpu, &set)) cpus.push_back(static_cast<int>(cpu));
  return cpus;
}

void ask_for_fifo(const SchedulingOptions& options, SchedulingMode& mode) {
  if (options.priority <= 0) return;
  sched_param wanted{};
  wanted.sched_priority = options.priority;
  // Threads started by this one do not inherit it.
  if (::sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &wanted) == 0) {
    mode.fifo = true;
    mode.priority = options.priority;
    return;
  }
  mode.not_obtained.push_back("SCHED_FIFO " + std::to_string(options.priority) + " was refused (" + reason() +
                              "): " + kDoctor);
}

void pin(const SchedulingOptions& options, SchedulingMode& mode) {
  const std::vector<int> cpus = usable_cpus();
  mode.cpus = static_cast<int>(cpus.size());
  // Without priority a pinned thread waits for others on its CPU.
  if (!options.pin || !mode.fifo || (cpus.size() < 2 && options.cpu < 0)) return;
  const int cpu = options.cpu >= 0 ? options.cpu : cpus.back();
  cpu_set_t set;
  CPU_ZERO(&set);
  if (cpu < CPU_SETSIZE) CPU_SET(static_cast<std::size_t>(cpu), &set);
  if (::sched_setaffinity(0, sizeof set, &set) == 0)
    mode.pinned_cpu = cpu;
  else
    mode.not_obtained.push_back("CPU " + std::to_string(cpu) + " was refused (" + reason() + "): it has " +
                                std::to_string(mode.cpus) + " that may be used");
}

void describe_kernel(SchedulingMode& mode) {
  mode.kernel = kernel_kind();
  utsname names{};
  if (::uname(&names) == 0) mode.kernel_release = names.release;
}

/// Effects shared by all live instances.
struct Held {
  std::mutex mutex;
  int locks = 0;
};
Held& held() {
  static Held one;
  return one;
}

bool may_lock_without_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY) return true;
  return has_capability(kCapIpcLock);
}

}  // namespace

bool has_capability(int capability) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (!line.starts_with("CapEff:")) continue;
    const std::uint64_t mask = std::strtoull(line.c_str() + std::strlen("CapEff:"), nullptr, 16);
    return (mask >> capability & 1u) != 0;
  }
  return false;
}

const char* kernel_kind_name(KernelKind kind) noexcept {
  constexpr std::array kNames = {"unknown preemption", "voluntary preemption or none", "PREEMPT",
                                 "PREEMPT_DYNAMIC", "PREEMPT_RT"};
  static_assert(kNames.size() == static_cast<std::size_t>(KernelKind::kRealTime) + 1);
  const auto at = static_cast<std::size_t>(kind);
  return kNames[at < kNames.size() ? at : 0];
}

KernelKind kernel_kind_of(std::string_view realtime_file, std::string_view version) noexcept {
  const auto says = [version](std::string_view word) { return version.find(word) != std::string_view::npos; };
  if (realtime_file.starts_with("1") || says("PREEMPT_RT") || says("PREEMPT RT"))
    return KernelKind::kRealTime;
  if (says("PREEMPT_DYNAMIC")) return KernelKind::kDynamic;
  if (says("PREEMPT")) return KernelKind::kPreempt;
  return version.empty() ? KernelKind::kUnknown : KernelKind::kVoluntary;
}

KernelKind kernel_kind() {
  std::ifstream file("/sys/kernel/realtime");
  std::string realtime;
  std::getline(file, realtime);
  utsname names{};
  return kernel_kind_of(realtime, ::uname(&names) == 0 ? names.version : "");
}

StealTimes steal_times_of(std::string_view proc_stat, int cpu) {
  const std::string name = cpu < 0 ? "cpu" : "cpu" + std::to_string(cpu);
  std::istringstream lines{std::string(proc_stat)};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string first;
    words >> first;
    if (first != name) continue;
    // user nice system idle iowait irq softirq steal; guest times are part of user and nice.
    constexpr int kStealColumn = 7;
    StealTimes found;
    std::uint64_t value = 0;
    for (int column = 0; column <= kStealColumn && words >> value; ++column) {
      found.total += value;
      if (column == kStealColumn) found.steal = value;
    }
    return found;
  }
  return {};
}

StealTimes steal_times(int cpu) {
  std::ifstream file("/proc/stat");
  std::ostringstream text;
  text << file.rdbuf();
  return steal_times_of(text.str(), cpu);
}

double steal_percent(const StealTimes& from, const StealTimes& to) noexcept {
  if (to.total <= from.total || to.steal < from.steal) return 0.0;
  return 100.0 * static_cast<double>(to.steal - from.steal) / static_cast<double>(to.total - from.total);
}

std::string SchedulingMode::text() const {
  std::string all = fifo ? "SCHED_FIFO " + std::to_string(priority)
                         : "SCHED_OTHER" + (nice == 0 ? std::string() : " nice " + std::to_string(nice));
  all += pinned_cpu >= 0 ? " on CPU " + std::to_string(pinned_cpu) : " on any CPU";
  all += " of " + std::to_string(cpus);
  all += memory_locked ? ", memory locked" : ", memory not locked";
  all += latency_held ? ", CPUs kept awake" : ", CPUs may sleep";
  if (!fifo) all += ", timer slack " + std::to_string(timer_slack_ns) + " ns";
  all += denormals_flushed ? ", denormals flushed" : "";
  return all + ", kernel " + kernel_release + " (" + kernel_kind_name(kernel) + ")";
}

ProcessRealTime::ProcessRealTime(const SchedulingOptions& options, SchedulingMode& mode) {
  describe_kernel(mode);
  if (options.lock_memory) {
    const std::lock_guard lock(held().mutex);
    // Under a limit later memory must not be locked: allocations beyond it would fail.
    const int what = may_lock_without_limit() ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT;
    if (::mlockall(what) == 0) {
      locked_ = mode.memory_locked = true;
      ++held().locks;
    } else {
      mode.not_obtained.push_back("the memory was not locked (" + reason() + "): " + kDoctor);
    }
  }
  if (options.hold_latency) {
    latency_file_ = ::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    const std::int32_t none_us = 0;
    if (latency_file_ >= 0 && ::write(latency_file_, &none_us, sizeof none_us) == sizeof none_us)
      mode.latency_held = true;
    else
      mode.not_obtained.push_back("/dev/cpu_dma_latency was refused (" + reason() + "): " + kDoctor);
  }
}

ProcessRealTime::~ProcessRealTime() {
  if (latency_file_ >= 0) ::close(latency_file_);
  if (!locked_) return;
  const std::lock_guard lock(held().mutex);
  if (--held().locks == 0) ::munlockall();
}

void enter_real_time(const SchedulingOptions& options, SchedulingMode& mode) {
  if (mode.kernel_release.empty()) describe_kernel(mode);
  // The default environment, independent of the starting thread: rounding, masks, denormals kept.
  std::fesetenv(FE_DFL_ENV);
  mode.denormals_flushed = flushes_denormals();
  touch_stack();
  ask_for_fifo(options, mode);
  pin(options, mode);
  errno = 0;
  const int nice = ::getpriority(PRIO_PROCESS, 0);
  mode.nice = errno == 0 ? nice : 0;
  ::prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
  mode.timer_slack_ns = ::prctl(PR_GET_TIMERSLACK, 0UL, 0UL, 0UL, 0UL);
}

}  // namespace palpate::device
