// Real-time set-up of threads: scheduling class, locked memory, own CPU, exact timer. Each is tried and none
// is required; the result lists what was obtained and the remedy for what was not.
//
// First:
//   palpate::device::SchedulingMode mode;
//   const palpate::device::ProcessRealTime held({.lock_memory = true}, mode);  // while it lives
//   for (const auto& missing : mode.not_obtained) std::puts(missing.c_str());
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>

namespace palpate::device {

// SCHED_FIFO priorities, 1 to 99. The watchdog must preempt a hanging servo, and both the guard, which is
// idle until the program's end. Above 50, where PREEMPT_RT's threaded interrupts run; below the kernel's own
// at 99.
inline constexpr int kServoPriority = 80;
inline constexpr int kWatchdogPriority = 85;

enum class KernelKind : std::uint8_t { kUnknown, kVoluntary, kPreempt, kDynamic, kRealTime };
/// "PREEMPT_RT", "PREEMPT_DYNAMIC", ..
[[nodiscard]] const char* kernel_kind_name(KernelKind kind) noexcept;
/// From /sys/kernel/realtime (empty: missing) and uname's version.
[[nodiscard]] KernelKind kernel_kind_of(std::string_view realtime_file, std::string_view version) noexcept;
[[nodiscard]] KernelKind kernel_kind();

// From linux/capability.h: locking memory beyond limits.
inline constexpr int kCapIpcLock = 14;
/// True if this process has the capability.
[[nodiscard]] bool has_capability(int capability);

/// CPU time that a virtual machine's host gave to others, from /proc/stat.
struct StealTimes {
  std::uint64_t steal = 0, total = 0;  ///< kernel ticks; total 0: unknown
};
/// `cpu` -1: all together.
[[nodiscard]] StealTimes steal_times_of(std::string_view proc_stat, int cpu);
[[nodiscard]] StealTimes steal_times(int cpu = -1);
/// Over the time between; 0 if none passed.
[[nodiscard]] double steal_percent(const StealTimes& from, const StealTimes& to) noexcept;

struct SchedulingOptions {
  int priority = kServoPriority;  ///< SCHED_FIFO; 0: not requested
  bool lock_memory = true;        ///< of the whole process, while held
  bool hold_latency = true;       ///< prevents deep CPU sleep, while held
  bool pin = true;                ///< to one CPU, given SCHED_FIFO and at least two CPUs
  int cpu = -1;                   ///< which one; -1: the last allowed
};

/// Scheduling that was obtained.
struct SchedulingMode {
  bool fifo = false;
  int priority = 0;  ///< 0 without fifo
  int nice = 0;      ///< without fifo
  bool memory_locked = false;
  bool latency_held = false;        ///< /dev/cpu_dma_latency at 0
  int pinned_cpu = -1;              ///< -1: none
  std::int64_t timer_slack_ns = 0;  ///< of sleeping; 0 for real-time threads
  bool denormals_flushed = false;   ///< measured in the thread
  KernelKind kernel = KernelKind::kUnknown;
  std::string kernel_release;
  int cpus = 0;                           ///< that the process may use
  std::vector<std::string> not_obtained;  ///< whole sentences, each with its remedy

  /// One line: "SCHED_FIFO 80 on CPU 1, memory locked, ..".
  [[nodiscard]] std::string text() const;
};

/// Process-wide effects for its lifetime: locked memory, awake CPUs. Not thread-safe. Counted: the last
/// instance releases.
class ProcessRealTime {
 public:
  /// Records in `mode` what was obtained.
  ProcessRealTime(const SchedulingOptions& options, SchedulingMode& mode);
  ~ProcessRealTime();
  ProcessRealTime(const ProcessRealTime&) = delete;
  ProcessRealTime& operator=(const ProcessRealTime&) = delete;

 private:
  bool locked_ = false;
  int latency_file_ = -1;
};

/// Sets up the calling thread: default floating point (round to nearest, denormals kept, so a servo's frame
/// equals a replay's bit for bit), touched stack, scheduling class and CPU, timer. The call may allocate. It
/// records in `mode` what was obtained.
void enter_real_time(const SchedulingOptions& options, SchedulingMode& mode);

}  // namespace palpate::device
