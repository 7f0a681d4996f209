// What the kernel tells about itself, and that what is said to be obtained was obtained.
#include <palpate/device/scheduling.h>

#include <gtest/gtest.h>
#include <sched.h>

#include <string>
#include <thread>
#if defined(__SSE2__)
#include <immintrin.h>

#include "tests/device/helpers.h"
#endif

namespace palpate::device {
namespace {

TEST(Scheduling, TheKindOfAKernelIsReadFromWhatItSays) {
  EXPECT_EQ(kernel_kind_of("1", "#1 SMP PREEMPT_DYNAMIC"), KernelKind::kRealTime);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT_RT Debian 6.1.90-1"), KernelKind::kRealTime);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT RT Wed"), KernelKind::kRealTime) << "before Linux 5.4";
  EXPECT_EQ(kernel_kind_of("0", "#1 SMP PREEMPT_DYNAMIC @0"), KernelKind::kDynamic);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP PREEMPT Mon"), KernelKind::kPreempt);
  EXPECT_EQ(kernel_kind_of("", "#1 SMP Debian 5.10"), KernelKind::kVoluntary);
  EXPECT_EQ(kernel_kind_of("", ""), KernelKind::kUnknown);
}

TEST(Scheduling, StealIsTheEighthColumnOfTheCpuAskedFor) {
  const std::string stat =
      "cpu  10 20 30 40 50 60 70 80 5 6\ncpu0 1 2 3 4 5 6 7 8 0 0\ncpu1 0 0 0 0 0 0 0 1\nintr 5\n";
  const StealTimes all = steal_times_of(stat, -1), first = steal_times_of(stat, 0);
  EXPECT_EQ(all.steal, 80u);
  EXPECT_EQ(all.total, 360u) << "guest times are in user times already";
  EXPECT_EQ(first.steal, 8u);
  EXPECT_EQ(first.total, 36u);
  EXPECT_EQ(steal_times_of(stat, 1).steal, 1u);
  EXPECT_EQ(steal_times_of(stat, 2).total, 0u);
  EXPECT_EQ(steal_times_of("", -1).total, 0u);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {90, 380}), 50.0);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {80, 360}), 0.0);
  EXPECT_DOUBLE_EQ(steal_percent({80, 360}, {70, 380}), 0.0) << "counters of some kernels go back";
}

TEST(Scheduling, WhatIsSaidToBeObtainedIsWhatTheThreadHas) {
  SchedulingMode mode;
  int policy = -1, priority = -1, cpu = -1, slack_lines = 0;
  std::thread thread([&] {
    enter_real_time({}, mode);
    policy = ::sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
    sched_param found{};
    ::sched_getparam(0, &found);
    priority = found.sched_priority;
    cpu = ::sched_getcpu();
  });
  thread.join();
  EXPECT_EQ(mode.fifo, policy == SCHED_FIFO) << mode.text();
  EXPECT_EQ(mode.priority, priority);
  if (mode.pinned_cpu >= 0) {
    EXPECT_EQ(mode.pinned_cpu, cpu);
  }
  EXPECT_GE(mode.cpus, 1);
  EXPECT_FALSE(mode.kernel_release.empty());
  EXPECT_EQ(mode.fifo, mode.not_obtained.empty()) << "what was not obtained is said";
  for (const std::string& sentence : mode.not_obtained)
    slack_lines += sentence.find("--doctor") != std::string::npos ? 1 : 0;
  EXPECT_EQ(slack_lines, mode.fifo ? 0 : 1) << "with its remedy";
  EXPECT_TRUE(says(mode.text(), mode.fifo ? "SCHED_FIFO 80" : "SCHED_OTHER"));
}

TEST(Scheduling, WhatIsNotAskedForIsNotTaken) {
  SchedulingOptions none{0, false, false, false, -1};
  SchedulingMode mode;
  std::thread thread([&] {
    const ProcessRealTime process(none, mode);
    enter_real_time(none, mode);
    EXPECT_EQ(::sched_getscheduler(0), SCHED_OTHER);
  });
  thread.join();
  EXPECT_FALSE(mode.fifo);
  EXPECT_FALSE(mode.memory_locked);
  EXPECT_FALSE(mode.latency_held);
  EXPECT_EQ(mode.pinned_cpu, -1);
  EXPECT_TRUE(mode.not_obtained.empty());
  EXPECT_EQ(mode.timer_slack_ns, 1);
  EXPECT_TRUE(says(mode.text(), " on any CPU"));
}

#if defined(__SSE2__)
TEST(Scheduling, FloatingPointIsThatOfEveryReplayWhateverTheCallerHad) {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040, kRoundUp = 0x4000;
  SchedulingMode mode;
  std::thread thread([&] {
    _mm_setcsr(_mm_getcsr() | kFlushToZero | kDenormalsAreZero | kRoundUp);
    enter_real_time({0, false, false, false, -1}, mode);
    EXPECT_EQ(_mm_getcsr() & (kFlushToZero | kDenormalsAreZero | kRoundUp), 0u);
  });
  thread.join();
  EXPECT_FALSE(mode.denormals_flushed);
}
#endif

}  // namespace
}  // namespace palpate::device
