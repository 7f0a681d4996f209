#include "toolkit/control/rates.h"

#include <cmath>
#include <utility>

#include "toolkit/core/try.h"

namespace palpate::control {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

/// floor(k 10^9 / hz) without overflow for 292 years.
std::int64_t due_ns(std::int64_t k, std::int64_t hz) noexcept {
  return k / hz * kNsPerS + k % hz * kNsPerS / hz;
}

}  // namespace

Status RateScheduler::add(std::string name, std::int64_t rate_hz, Task task) {
  if (rate_hz < 1 || rate_hz > kMostHz)
    return Error{"the task '" + name + "' runs " + std::to_string(rate_hz) + " times a second",
                 "give 1 to " + std::to_string(kMostHz), "", 0};
  if (!task) return Error{"the task '" + name + "' is empty", "", "", 0};
  if (tasks_.size() == kMostTasks)
    return Error{"the task '" + name + "' is one too many", "there may be " + std::to_string(kMostTasks), "",
                 0};
  // A task added later joins at its next beat.
  const std::int64_t now = clock_.now_ns();
  std::int64_t runs = now / kNsPerS * rate_hz + now % kNsPerS * rate_hz / kNsPerS;
  if (due_ns(runs, rate_hz) < now) ++runs;
  tasks_.push_back({std::move(name), rate_hz, std::move(task), runs, due_ns(runs, rate_hz)});
  return Done{};
}

void RateScheduler::run_until(double t_s) {
  const std::int64_t end_ns = std::llround(t_s * static_cast<double>(kNsPerS));
  while (true) {
    Entry* next = nullptr;
    for (Entry& entry : tasks_)
      if (entry.due_ns < end_ns && (next == nullptr || entry.due_ns < next->due_ns)) next = &entry;
    if (next == nullptr) break;
    clock_.advance_to(next->due_ns);
    // Divided, not multiplied: the double nearest to the time.
    next->task(static_cast<double>(clock_.now_ns()) / 1e9);
    next->due_ns = due_ns(++next->runs, next->rate_hz);
  }
  clock_.advance_to(end_ns);
}

Status add_four_rates(RateScheduler& scheduler, const FourRates& rates, FourTasks tasks) {
  struct Loop {
    const char* name;
    std::int64_t hz;
    RateScheduler::Task& task;
  };
  for (const Loop& loop : {Loop{"simulation", rates.simulation_hz, tasks.simulation},
                           Loop{"broad phase", rates.broad_phase_hz, tasks.broad_phase},
                           Loop{"narrow phase", rates.narrow_phase_hz, tasks.narrow_phase},
                           Loop{"graphics", rates.graphics_hz, tasks.graphics}}) {
    if (!loop.task) continue;
    PALPATE_TRY(scheduler.add(loop.name, loop.hz, std::move(loop.task)));
  }
  return Done{};
}

}  // namespace palpate::control
