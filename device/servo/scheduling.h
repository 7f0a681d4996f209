// What a machine grants to a thread that must not be late: real-time scheduling, memory that is never paged
// out, a CPU of its own, an exact timer. Everything is tried and nothing is needed: what was obtained is
// said, and what was not, with its remedy.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::device {

// SCHED_FIFO, of 1 to 99. The watchdog must get past a servo that hangs, and both past the guard, which does
// nothing until the program is dead. Above 50, where threaded interrupts of PREEMPT_RT stand; below the
// kernel's own at 99.
inline constexpr int kServoPriority = 80;
inline constexpr int kWatchdogPriority = 85;
inline constexpr int kGuardPriority = 70;

enum class KernelKind : std::uint8_t { kUnknown, kVoluntary, kPreempt, kDynamic, kRealTime };
/// "PREEMPT_RT", "PREEMPT_DYNAMIC", ..
[[nodiscard]] const char* kernel_kind_name(KernelKind kind) noexcept;
/// Of /sys/kernel/realtime (empty: not there) and the version as uname tells it.
[[nodiscard]] KernelKind kernel_kind_of(std::string_view realtime_file, std::string_view version) noexcept;
[[nodiscard]] KernelKind kernel_kind();

// Of linux/capability.h: what a process may do that its limits forbid.
inline constexpr int kCapIpcLock = 14, kCapSysNice = 23;
/// Whether this process has it.
[[nodiscard]] bool has_capability(int capability);

/// CPU time that a virtual machine's host gave to others, of /proc/stat.
struct StealTimes {
  std::uint64_t steal = 0, total = 0;  ///< in the kernel's ticks; total 0: not known
};
/// `cpu` -1: of all together.
[[nodiscard]] StealTimes steal_times_of(std::string_view proc_stat, int cpu);
[[nodiscard]] StealTimes steal_times(int cpu = -1);
/// Of the time between; 0 where none passed.
[[nodiscard]] double steal_percent(const StealTimes& from, const StealTimes& to) noexcept;

struct SchedulingOptions {
  int priority = kServoPriority;  ///< SCHED_FIFO; 0: is not asked for
  bool lock_memory = true;        ///< of the whole process, while held
  bool hold_latency = true;       ///< keeps CPUs from sleeping deeply, while held
  bool pin = true;  ///< to one CPU, where the thread got SCHED_FIFO and there are two CPUs or more
  int cpu = -1;     ///< which; -1: the last that this process may use
};

/// What was obtained.
struct SchedulingMode {
  bool fifo = false;
  int priority = 0;  ///< 0 without fifo
  int nice = 0;      ///< without fifo
  bool memory_locked = false;
  bool latency_held = false;        ///< /dev/cpu_dma_latency at 0
  int pinned_cpu = -1;              ///< -1: none
  std::int64_t timer_slack_ns = 0;  ///< of sleeping; real-time threads have none
  bool denormals_flushed = false;   ///< as found by arithmetic, in the thread
  KernelKind kernel = KernelKind::kUnknown;
  std::string kernel_release;
  int cpus = 0;                           ///< that the process may use
  std::vector<std::string> not_obtained;  ///< whole sentences, each with its remedy

  /// One line: "SCHED_FIFO 80 on CPU 1, memory locked, ..".
  [[nodiscard]] std::string text() const;
};

/// Holds for the whole process while it lives: memory locked, CPUs kept awake. Not thread-safe. Two at a time
/// are counted: the last lets go.
class ProcessRealTime {
 public:
  /// Says in `mode` what was obtained.
  ProcessRealTime(const SchedulingOptions& options, SchedulingMode& mode);
  ~ProcessRealTime();
  ProcessRealTime(const ProcessRealTime&) = delete;
  ProcessRealTime& operator=(const ProcessRealTime&) = delete;

 private:
  bool locked_ = false;
  int latency_file_ = -1;
};

/// The calling thread, from here on: floating point as everywhere else (nearest, denormals kept, so that a
/// frame answers in a servo what it answers in a replay, to the last bit), stack touched, scheduling class
/// and CPU, timer. May allocate. Says in `mode` what was obtained.
void enter_real_time(const SchedulingOptions& options, SchedulingMode& mode);

}  // namespace palpate::device
