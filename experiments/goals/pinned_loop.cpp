#include "experiments/goals/pinned_loop.h"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <ctime>
#include <limits>
#include <numbers>
#include <system_error>
#include <thread>
#include <utility>

#include <palpate/clock.h>
#include <palpate/device/scheduling.h>
#include <palpate/device/servo_loop.h>
#include <palpate/triple_buffer.h>
#include "experiments/goals/goals.h"
#include "toolkit/core/random.h"

namespace palpate::experiments {
namespace {

constexpr std::uint64_t kOrderSeed = 20'090'414;
/// The camera looks down at 30 degrees from this many radii away and sees the whole model.
constexpr float kSine = 0.5f, kCosine = 0.8660254f, kAwayRadii = 4.0f;
/// Pixels of a radius at a distance of one radius.
constexpr float kFocal = 1200.0f;
constexpr std::uint8_t kPaper = 255;
/// Greys of near (dark) and far (light) points.
constexpr float kDarkestPoint = 30.0f, kLightestPoint = 200.0f;
constexpr int kCross = 12;

}  // namespace

PointDrawer::PointDrawer(const cloud::Cloud& cloud) : origin_mm_(cloud.origin_mm) {
  points_.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    points_.push_back({cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]});
  Random random(kOrderSeed);
  for (std::size_t i = points_.size(); i > 1; --i)
    std::swap(points_[i - 1], points_[static_cast<std::size_t>(random.below(i))]);
  const double radius = 0.5 * cloud.box_mm().extent_mm().norm();
  radius_mm_ = radius > 0.0 ? static_cast<float>(radius) : 1.0f;
  constexpr std::size_t kPixels = std::size_t{kImageWidth} * kImageHeight;
  image_.grey.assign(kPixels, kPaper);
  image_.depth_mm.assign(kPixels, std::numeric_limits<float>::infinity());
}

void PointDrawer::begin(double turn_rad) {
  right_x_ = static_cast<float>(std::cos(turn_rad));
  right_y_ = static_cast<float>(std::sin(turn_rad));
  std::fill(image_.grey.begin(), image_.grey.end(), kPaper);
  std::fill(image_.depth_mm.begin(), image_.depth_mm.end(), std::numeric_limits<float>::infinity());
  next_ = 0;
}

PointDrawer::Seen PointDrawer::see(float x, float y, float z) const noexcept {
  const float across = right_x_ * x + right_y_ * y, along = right_x_ * y - right_y_ * x;
  const float up = kCosine * z - kSine * -along, away = kCosine * along - kSine * z + kAwayRadii * radius_mm_;
  if (!(away > 0.0f)) return {};
  const float scale = kFocal / away;
  const float column = 0.5f * kImageWidth + scale * across, row = 0.5f * kImageHeight - scale * up;
  if (!(column >= 0.0f && column < kImageWidth && row >= 0.0f && row < kImageHeight)) return {};
  return {static_cast<int>(column), static_cast<int>(row), away};
}

std::size_t PointDrawer::draw(std::size_t count) noexcept {
  const std::size_t end = std::min(points_.size(), next_ + count);
  const float nearest = (kAwayRadii - 1.0f) * radius_mm_, range = 2.0f * radius_mm_;
  for (; next_ < end; ++next_) {
    const Point& point = points_[next_];
    const Seen seen = see(point.x, point.y, point.z);
    if (seen.column < 0) continue;
    const auto pixel =
        static_cast<std::size_t>(seen.row) * kImageWidth + static_cast<std::size_t>(seen.column);
    if (!(seen.depth_mm < image_.depth_mm[pixel])) continue;
    image_.depth_mm[pixel] = seen.depth_mm;
    const float share = std::clamp((seen.depth_mm - nearest) / range, 0.0f, 1.0f);
    image_.grey[pixel] = static_cast<std::uint8_t>(kDarkestPoint + share * (kLightestPoint - kDarkestPoint));
  }
  return points_.size() - next_;
}

void PointDrawer::mark(const Vec3& at_mm) noexcept {
  const Vec3 at = at_mm - origin_mm_;
  if (!is_finite(at)) return;
  const Seen seen = see(static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(at.z()));
  if (seen.column < 0) return;
  for (int i = -kCross; i <= kCross; ++i) {
    const int column = std::clamp(seen.column + i, 0, kImageWidth - 1);
    const int row = std::clamp(seen.row + i, 0, kImageHeight - 1);
    image_.grey[static_cast<std::size_t>(seen.row) * kImageWidth + static_cast<std::size_t>(column)] = 0;
    image_.grey[static_cast<std::size_t>(row) * kImageWidth + static_cast<std::size_t>(seen.column)] = 0;
  }
}

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
  if (path.size() == 0 || ticks == 0) return Error{"there is nothing to step"};
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
    return Error{std::string("a thread cannot be made: ") + error.what(), "let the system have more threads"};
  }
  run.images = pictures.images;
  run.points_drawn = pictures.points_drawn;
  run.drawn_s = pictures.drawn_s;
  if (options.draw) run.last = drawer.image();
  return run;
}

}  // namespace palpate::experiments
