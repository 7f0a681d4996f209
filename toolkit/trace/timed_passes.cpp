#include "toolkit/trace/timed_passes.h"

#include <algorithm>
#include <ctime>
#include <limits>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "toolkit/trace/path_run.h"

namespace palpate::trace {
namespace {

using render::Frame;

constexpr std::size_t kEvictedBytes = std::size_t{64} * 1024 * 1024;
constexpr std::size_t kCacheLineBytes = 64;         // x86-64 and most ARM cores
constexpr std::int64_t kPacedPeriodNs = 1'000'000;  // the 1 kHz tick
constexpr std::int64_t kNsPerS = 1'000'000'000;
constexpr std::size_t kProgressEveryFrames = 256;  // about 4 reports a second
constexpr std::size_t kClockEveryFrames = 256;     // during warm-up: some tens of microseconds

Error differs(const ProbePath& path, const char* pass) {
  Error error;
  error.what = std::string("the renderer answered differently in the ") + pass + " than in the untimed pass";
  error.remedy =
      "a renderer must give the same trace after every restart: check what restart() leaves behind";
  error.file = path.name;
  return error;
}

std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<std::int64_t>(now.tv_sec) * kNsPerS + now.tv_nsec;
}

void step_range(PathRun& course, std::size_t begin, std::size_t end, FrameDigest& digest) noexcept {
  for (std::size_t i = begin; i < end; ++i) {
    course.advance(i);
    digest.add(course.step(i));
  }
}

// Times one stretch, in pieces between the models' moves.
FrameSpanTime time_stretch(PathRun& course, const FrameSpan& stretch, FrameDigest& digest) noexcept {
  FrameSpanTime time;
  for (std::size_t next = stretch.begin; next < stretch.end;) {
    course.advance(next);
    const std::size_t end = std::min(stretch.end, course.static_until(next));
    const std::int64_t cpu_ns = thread_cpu_ns();  // a system call, outside the other clock's interval
    const std::int64_t start_ns = monotonic_ns();
    for (; next < end; ++next) digest.add(course.step(next));
    time.wall_ns += monotonic_ns() - start_ns;
    time.cpu_ns += thread_cpu_ns() - cpu_ns;
  }
  return time;
}

// Memory walked through to evict the caches.
class Evictor {
 public:
  explicit Evictor(std::size_t bytes)
      : words_(bytes / sizeof(std::uint64_t), 1) {}  // written, so that pages exist
  void evict() noexcept {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < words_.size(); i += kCacheLineBytes / sizeof(std::uint64_t)) sum += words_[i];
    sink_ = sum;
  }

 private:
  std::vector<std::uint64_t> words_;
  volatile std::uint64_t sink_ = 0;  // prevents optimising the walk away
};

// Sleeps to the next future tick and counts the missed ones.
void sleep_to_tick(std::int64_t& next_ns, std::uint64_t& skipped) noexcept {
  next_ns += kPacedPeriodNs;
  const std::int64_t late_ns = monotonic_ns() - next_ns;
  if (late_ns > 0) {
    const std::int64_t over = late_ns / kPacedPeriodNs + 1;
    skipped += static_cast<std::uint64_t>(over);
    next_ns += over * kPacedPeriodNs;
  }
  timespec until{};
  until.tv_sec = static_cast<time_t>(next_ns / kNsPerS);
  until.tv_nsec = static_cast<long>(next_ns % kNsPerS);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
  }  // a signal woke us early: sleep on
}

}  // namespace

std::vector<FrameSpan> frame_spans_of(std::span<const std::uint8_t> contact) {
  std::vector<FrameSpan> stretches;
  for (std::size_t i = 0; i < contact.size(); ++i) {
    const bool touches = contact[i] != 0;
    if (!stretches.empty() && stretches.back().contact == touches)
      stretches.back().end = i + 1;
    else
      stretches.push_back({i, i + 1, touches});
  }
  return stretches;
}

std::vector<std::uint8_t> contact_of(std::span<const Frame> frames) {
  std::vector<std::uint8_t> contact;
  contact.reserve(frames.size());
  for (const Frame& frame : frames) contact.push_back(frame.contact ? 1 : 0);
  return contact;
}

TimedPasses::TimedPasses(render::HapticRenderer& renderer, const ProbePath& path,
                         render::Simulation* simulation, std::span<const Frame> frames)
    : renderer_(renderer),
      path_(path),
      simulation_(simulation),
      frames_(frames),
      expected_(digest_of(frames)) {}

void TimedPasses::warm_up(double most_s) noexcept {
  PathRun course(renderer_, path_, simulation_);
  FrameDigest digest;
  course.restart();
  const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(most_s * kNsPerS);
  for (std::size_t i = 0; i < course.size() && monotonic_ns() < until_ns; i += kClockEveryFrames)
    step_range(course, i, std::min(i + kClockEveryFrames, course.size()), digest);
}

Status TimedPasses::time_spans(std::span<const FrameSpan> stretches, std::span<FrameSpanTime> times) {
  PathRun course(renderer_, path_, simulation_);
  FrameDigest digest;
  course.restart();
  for (std::size_t i = 0; i < stretches.size(); ++i) times[i] = time_stretch(course, stretches[i], digest);
  if (digest.value() != expected_) return differs(path_, "pass timed by stretches");
  return Done{};
}

Status TimedPasses::time_frames(std::span<std::uint32_t> frame_ns) {
  PathRun course(renderer_, path_, simulation_);
  FrameDigest digest;
  course.restart();
  constexpr std::int64_t kMost = std::numeric_limits<std::uint32_t>::max();
  for (std::size_t i = 0; i < frame_ns.size(); ++i) {
    course.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = course.step(i);
    frame_ns[i] = static_cast<std::uint32_t>(std::min(monotonic_ns() - start_ns, kMost));
    digest.add(frame);
  }
  if (digest.value() != expected_) return differs(path_, "pass timed frame by frame");
  return Done{};
}

Result<PacedStatistics> TimedPasses::paced(std::size_t frames, bool evict,
                                           std::span<const std::uint8_t> contact, Progress* progress) {
  const char* const what = evict ? "paced pass with eviction" : "paced pass";
  frames = std::min(frames, path_.size());
  PathRun course(renderer_, path_, simulation_);
  PacedStatistics paced;
  const std::size_t first = densest_contact_stretch(contact, frames);
  std::vector<std::int64_t> times;
  times.reserve(frames);
  paced.evicted_bytes = evict ? kEvictedBytes : 0;
  Evictor evictor(paced.evicted_bytes);
  FrameDigest ahead, digest;
  course.restart();
  step_range(course, 0, first, ahead);
  std::uint64_t own_contact = 0, bound_hits = 0;
  std::int64_t next_ns = monotonic_ns();
  for (std::size_t i = first; i < first + frames; ++i) {
    if (progress != nullptr && (i - first) % kProgressEveryFrames == 0) {
      progress->report(what, static_cast<double>(i - first) / static_cast<double>(frames));
      if (progress->cancelled()) return Error{"stopped by the user", "", "", 0};
    }
    evictor.evict();
    sleep_to_tick(next_ns, paced.skipped_ticks);
    course.advance(i);
    const std::int64_t start_ns = monotonic_ns();
    const Frame frame = course.step(i);
    const std::int64_t ns = monotonic_ns() - start_ns;
    digest.add(frame);
    own_contact += frame.contact ? 1u : 0u;
    if (contact[i] == 0) continue;
    times.push_back(ns);
    bound_hits += frame.status == render::FrameStatus::kBoundHit ? 1u : 0u;
  }
  if (digest.value() != digest_of(frames_.subspan(first, frames))) return differs(path_, what);
  paced.frame = frame_statistics(std::move(times), {}, measure_clock_overhead_ns());
  paced.frame.bound_hits = bound_hits;
  paced.frame.frames = frames;
  paced.frame.contact_frames = own_contact;
  paced.first_frame = first;
  return paced;
}

}  // namespace palpate::trace
