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

#include <palpate/clock.h>
#include <palpate/device/scheduling.h>
#include <palpate/device/servo_loop.h>
#include <palpate/triple_buffer.h>
#include "experiments/goals/goal.h"

namespace palpate::experiments {
namespace {

constexpr std::int64_t kPinnedHz = 1000;
constexpr double kPinnedNsPerS = 1e9;
/// Time limit of a picture; undrawn points are left out.
constexpr std::int64_t kImageNs = 33'000'000;
/// Points between clock checks: some tens of microseconds.
constexpr std::size_t kPointsAtOnce = 4096;
/// One camera turn in ten seconds of pictures.
constexpr double kTurnPerImage = 2.0 * std::numbers::pi / 300.0;

/// The last core allowed to this process, since the first serve most interrupts. -1: unknown.
int core_to_share() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  if (::sched_getaffinity(0, sizeof allowed, &allowed) != 0) return -1;
  int last = -1;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
    if (CPU_ISSET(static_cast<std::size_t>(cpu), &allowed)) last = cpu;
  return last;
}

bool pin_this_thread(int cpu) {
  if (cpu < 0) return false;
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<std::size_t>(cpu), &one);
  return ::pthread_setaffinity_np(::pthread_self(), sizeof one, &one) == 0;
}

void sleep_until(std::int64_t due_ns) {
  timespec until{};
  constexpr std::int64_t kSecond = 1'000'000'000;
  until.tv_sec = static_cast<time_t>(due_ns / kSecond);
  until.tv_nsec = static_cast<long>(due_ns % kSecond);
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

struct SharedByThreads {
  std::atomic<bool> stop{false};
  TripleBuffer<Vec3> hip_mm{Vec3::Zero()};
};

/// The servo thread: writes its ticks into `run`, whose arrays are preallocated. Scheduling and due times
/// follow device::ServoThread, which does not fit: it keeps histograms instead of every tick, steps a device
/// and governor, and is pinned only under SCHED_FIFO.
void step_servo(render::HapticRenderer& renderer, const trace::ProbePath& path, std::size_t ticks, int cpu,
                SharedByThreads& shared, PinnedRun& run) {
  run.cpu = pin_this_thread(cpu) ? cpu : -1;
  device::SchedulingOptions asked;
  asked.pin = false;
  device::SchedulingMode mode;
  device::enter_real_time(asked, mode);
  run.real_time = mode.fifo;
  run.not_obtained = mode.not_obtained;
  renderer.restart(path.hip_mm.front(), 0.0);
  device::DueTimes due(kPinnedHz);
  due.begin(monotonic_ns() + due.period_ns());
  for (std::size_t tick = 0, at = 0; tick < ticks; ++tick, at = at + 1 < path.size() ? at + 1 : 0) {
    const std::int64_t due_ns = due.due_ns();
    sleep_until(due_ns);
    const std::int64_t began_ns = monotonic_ns();
    run.skipped_ticks += due.take(began_ns);
    const Vec3& hip = path.hip_mm[at];
    // Restarting the path is a jump: the probe is lifted and set down again.
    if (at == 0) renderer.release_contact(hip);
    (void)renderer.step(hip, kTickS * static_cast<double>(tick + 1));
    const std::int64_t ended_ns = monotonic_ns();
    run.late_ns.push_back(began_ns - due_ns);
    run.step_ns.push_back(ended_ns - began_ns);
    shared.hip_mm.publish(hip);
  }
  shared.stop.store(true, std::memory_order_release);
}

void draw_pictures(PointDrawer& drawer, int cpu, SharedByThreads& shared, PinnedRun& run) {
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
  const auto ticks = static_cast<std::size_t>(options.seconds * static_cast<double>(kPinnedHz));
  if (path.size() == 0 || ticks == 0) return Error{"there is nothing to step", {}, {}, 0};
  run.late_ns.reserve(ticks);
  run.step_ns.reserve(ticks);
  PinnedRun pictures;
  PointDrawer drawer(cloud);
  SharedByThreads shared;
  const int cpu = core_to_share();
  try {
    std::thread drawing;
    if (options.draw) drawing = std::thread([&] { draw_pictures(drawer, cpu, shared, pictures); });
    std::thread stepping;
    try {
      stepping = std::thread([&] { step_servo(renderer, path, ticks, cpu, shared, run); });
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
