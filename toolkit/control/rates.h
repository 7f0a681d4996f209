// Tasks at different rates on one virtual clock: the four loops of section 2.2.4 of the thesis (reference
// [77]: graphics, simulation, slow broad phase, fast narrow phase) as a deterministic simulation. Values pass
// between them through core/handover.h, as they will between threads.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "toolkit/core/clock.h"
#include "toolkit/core/result.h"

namespace palpate::control {

/// Runs each task at its own rate, in the order of time; tasks due at the same time run in the order in which
/// they were added. Run k of a task at f Hz is due at floor(k 10^9 / f) ns, from the start and not from the
/// last run: exact for ever, for 60 Hz too.
class RateScheduler {
 public:
  /// Called at `t_s`, the time it was due.
  using Task = std::function<void(double t_s)>;

  /// A whole number of runs a second, 1 to kMostHz; first run at time 0. At most kMostTasks. An Error names
  /// the task that is wrong.
  [[nodiscard]] Status add(std::string name, std::int64_t rate_hz, Task task);
  /// Runs everything due before `t_s` and leaves the clock there. O(tasks) a run; allocates nothing.
  void run_until(double t_s);

  [[nodiscard]] const VirtualClock& clock() const noexcept { return clock_; }
  [[nodiscard]] std::size_t tasks() const noexcept { return tasks_.size(); }
  [[nodiscard]] std::int64_t runs(std::size_t task) const noexcept { return tasks_[task].runs; }

  static constexpr std::int64_t kMostHz = 1'000'000;
  static constexpr std::size_t kMostTasks = 16;

 private:
  struct Entry {
    std::string name;
    std::int64_t rate_hz;
    Task task;
    std::int64_t runs;
    std::int64_t due_ns;
  };
  VirtualClock clock_;
  std::vector<Entry> tasks_;
};

/// The four loops, in the order in which they run where several are due: poses first, then what depends on
/// them.
struct FourRates {
  std::int64_t simulation_hz = 200;
  std::int64_t broad_phase_hz = 100;
  std::int64_t narrow_phase_hz = 1000;
  std::int64_t graphics_hz = 60;  ///< 30 in the thesis
};
struct FourTasks {
  RateScheduler::Task simulation, broad_phase, narrow_phase, graphics;  ///< an empty one does not run
};
/// Adds the four.
[[nodiscard]] Status add_four_rates(RateScheduler& scheduler, const FourRates& rates, FourTasks tasks);

}  // namespace palpate::control
