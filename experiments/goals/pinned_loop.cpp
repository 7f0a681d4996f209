#include "experiments/goals/pinned_loop.h"

#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <numbers>
#include <system_error>
#include <thread>

#include "toolkit/core/clock.h"
#include "toolkit/core/handover.h"

namespace palpate::experiments {
namespace {

constexpr std::int64_t kPinnedPeriodNs = 1'000'000;
constexpr double kPinnedNsPerS = 1e9;
/// Above all that is not real-time itself, below the kernel's own threads.
constexpr int kServoPriority = 80;
/// A picture is shown at the latest after so long; what is not drawn by then is left out.
constexpr std::int64_t kImageNs = 33'000'000;
/// Points between two looks at the clock: some tens of microseconds.
constexpr std::size_t kPointsAtOnce = 4096;
/// The camera goes round once in ten seconds of pictures.
constexpr double kTurnPerImage = 2.0 * std::numbers::pi / 300.0;

/// The last core that this process may run on: the first ones serve most interrupts. -1: not known.
int core_to_share() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (::sched_getaffinity(0, sizeof allowed, &allowed) != 0) return -1;
  int last = -1;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(cpu, &allowed)) last = cpu;
  return last;
}

bool pin_this_thread(int cpu) {
  if (cpu < 0) return false;
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(cpu, &one);
  return ::pthread_setaffinity_np(::pthread_self(), sizeof one, &one) == 0;
}

bool ask_for_real_time() {
  sched_param parameters{};
  parameters.sched_priority = kServoPriority;
  return ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &parameters) == 0;
}

void sleep_until(std::int64_t due_ns) {
  timespec until{};
  constexpr std::int64_t kSecond = 1'000'000'000;
  until.tv_sec = static_cast<time_t>(due_ns / kSecond);
  until.tv_nsec = static_cast<long>(due_ns % kSecond);
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

/// What the two threads share.
struct Shared {
  std::atomic<bool> stop{false};
  Handover<Vec3> hip_mm{Vec3::Zero()};
};

/// The servo: its ticks go into `run`, whose arrays have their room.
void servo(render::HapticRenderer& renderer, const trace::ProbePath& path, std::size_t ticks, int cpu,
           Shared& shared, PinnedRun& run) {
  run.cpu = pin_this_thread(cpu) ? cpu : -1;
  run.real_time = ask_for_real_time();
  double path_s = 0.0;
  renderer.restart(path.hip_mm.front(), path_s);
  std::int64_t due_ns = monotonic_ns() + kPinnedPeriodNs;
  for (std::size_t tick = 0, at = 0; tick < ticks; ++tick, at = at + 1 < path.size() ? at + 1 : 0) {
    sleep_until(due_ns);
    const std::int64_t began_ns = monotonic_ns();
    const Vec3& hip = path.hip_mm[at];
    // Back at its beginning the path is far away: the probe is lifted and set down again.
    if (at == 0) renderer.let_go(hip);
    path_s += 1e-3;
    (void)renderer.step(hip, path_s);
    const std::int64_t ended_ns = monotonic_ns();
    run.late_ns.push_back(began_ns - due_ns);
    run.step_ns.push_back(ended_ns - began_ns);
    shared.hip_mm.publish(hip);
    due_ns += kPinnedPeriodNs;
    while (due_ns < ended_ns) {
      due_ns += kPinnedPeriodNs;
      ++run.skipped_ticks;
    }
  }
  shared.stop.store(true, std::memory_order_release);
}

void draw_pictures(PointDrawer& drawer, int cpu, Shared& shared, PinnedRun& run) {
  pin_this_thread(cpu);
  const std::int64_t began_ns = monotonic_ns();
  while (!shared.stop.load(std::memory_order_acquire)) {
    const std::int64_t until_ns = monotonic_ns() + kImageNs;
    drawer.begin(kTurnPerImage * static_cast<double>(run.images));
    std::size_t left = drawer.size();
    while (left > 0 && monotonic_ns() < until_ns) {
      const std::size_t before = left;
      left = drawer.draw(kPointsAtOnce);
      run.points_drawn += before - left;
    }
    (void)shared.hip_mm.acquire();
    drawer.mark(shared.hip_mm.front());
    ++run.images;
  }
  run.drawn_s = static_cast<double>(monotonic_ns() - began_ns) / kPinnedNsPerS;
}

}  // namespace

Result<PinnedRun> run_pinned(render::HapticRenderer& renderer, const trace::ProbePath& path,
                             const cloud::Cloud& cloud, const PinnedOptions& options) {
  PinnedRun run;
  const auto ticks =
      static_cast<std::size_t>(options.seconds * kPinnedNsPerS / static_cast<double>(kPinnedPeriodNs));
  if (path.size() == 0 || ticks == 0) return Error{"there is nothing to step", {}, {}, 0};
  run.late_ns.reserve(ticks);
  run.step_ns.reserve(ticks);
  PinnedRun pictures;
  PointDrawer drawer(cloud);
  Shared shared;
  const int cpu = core_to_share();
  try {
    std::thread drawing;
    if (options.draw) drawing = std::thread([&] { draw_pictures(drawer, cpu, shared, pictures); });
    std::thread stepping;
    try {
      stepping = std::thread([&] { servo(renderer, path, ticks, cpu, shared, run); });
    } catch (const std::system_error&) {
      shared.stop.store(true, std::memory_order_release);
      if (drawing.joinable()) drawing.join();
      throw;
    }
    stepping.join();
    if (drawing.joinable()) drawing.join();
  } catch (const std::system_error& error) {
    return Error{
        std::string("a thread cannot be made: ") + error.what(), "let the system have more threads", {}, 0};
  }
  run.images = pictures.images;
  run.points_drawn = pictures.points_drawn;
  run.drawn_s = pictures.drawn_s;
  if (options.draw) run.last = drawer.image();
  return run;
}

}  // namespace palpate::experiments
