// Longest frames of our renderers, between callgrind marks; see tests/experiments/worst_frames_test.cpp.
// Paths jump across, stroke through and drag over points of no surface; the frames with the most counted
// steps are replayed under the counter.
//
//   worst_frames [--step] [RENDERER ...] [POINTS ...]
//
// Marks each as NAME SCENE POINTS FRAME BOUND (default: all our renderers, 10000 300000). --step works
// without valgrind, under which ten million points take an hour to prepare. It single-steps the frames, runs
// the rest at full speed, and ends each line with the instructions.
#include <fmt/format.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include <palpate/registry.h>
#include "toolkit/core/instruction_counter.h"
#include "toolkit/core/random.h"
#include "toolkit/heightfield/heightfield_crossing.h"
#include "toolkit/local_delaunay/mesh_contact.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"

namespace {

using namespace palpate;

// Counts a part's instructions by single-stepping it from a second process; the rest runs at full speed. For
// parts of some million instructions in programs too slow for an emulator; some 25 microseconds of processor
// time per instruction. Linux only.

/// Shared between the process with the part and the one that steps it.
class SteppedPart {
 public:
  /// Names the next part; no line breaks, truncated if too long.
  void name(const std::string& text) noexcept;
  /// Starts counting; includes some dozen instructions of this call's end.
  void begin() noexcept;
  void end() noexcept { counting_ = 0; }

  [[nodiscard]] bool counting() const noexcept { return counting_ != 0; }
  [[nodiscard]] const char* text() const noexcept { return name_.data(); }

 private:
  static constexpr std::size_t kMostName = 255;
  volatile int counting_ = 0;
  std::array<char, kMostName + 1> name_{};
};

void SteppedPart::name(const std::string& text) noexcept {
  const std::size_t size = std::min(text.size(), kMostName);
  std::copy_n(text.data(), size, name_.data());
  name_[size] = '\0';
}

void SteppedPart::begin() noexcept {
  counting_ = 1;
  std::raise(SIGTRAP);  // the other process single-steps from here
}

/// Waits until the traced process stops or ends; false with its status if it ended.
bool stopped(pid_t traced, int& signal, int& status) {
  int what = 0;
  if (::waitpid(traced, &what, 0) != traced) {
    status = 1;
    return false;
  }
  if (WIFSTOPPED(what)) {
    signal = WSTOPSIG(what);
    return true;
  }
  status = WIFEXITED(what) ? WEXITSTATUS(what) : 1;
  return false;
}

/// Steps through one part; false if the process ended within it.
bool step_through(pid_t traced, const SteppedPart& part, int& status) {
  std::uint64_t instructions = 0;
  int signal = SIGTRAP;
  while (part.counting()) {
    // Foreign signals are passed on.
    const long passed = signal == SIGTRAP ? 0 : signal;
    if (::ptrace(PTRACE_SINGLESTEP, traced, nullptr, passed) != 0) return false;
    if (!stopped(traced, signal, status)) return false;
    ++instructions;
  }
  fmt::print("{} {}\n", part.text(), instructions);
  std::fflush(stdout);
  return true;
}

/// Pins both processes to one processor, so a step wakes no second one.
void share_processor(pid_t traced) noexcept {
  const int here = ::sched_getcpu();
  if (here < 0) return;
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(static_cast<std::size_t>(here), &one);
  ::sched_setaffinity(0, sizeof one, &one);
  ::sched_setaffinity(traced, sizeof one, &one);
}

int trace(pid_t traced, const SteppedPart& part) {
  int status = 1, signal = 0;
  if (!stopped(traced, signal, status)) return status;
  ::ptrace(PTRACE_SETOPTIONS, traced, nullptr, PTRACE_O_EXITKILL);
  long passed = 0;
  while (::ptrace(PTRACE_CONT, traced, nullptr, passed) == 0) {
    if (!stopped(traced, signal, status)) return status;
    passed = signal == SIGTRAP ? 0 : signal;
    if (signal == SIGTRAP && part.counting() && !step_through(traced, part, status)) return status;
  }
  return 1;
}

/// Runs `work` in another process. It may mark any number of parts in sequence on its calling thread; a line
/// is printed for each: name, space, instructions. Returns work's result, or 1 if tracing is refused or the
/// process ended by itself.
int run_stepped(const std::function<int(SteppedPart*)>& work) {
  void* const shared =
      ::mmap(nullptr, sizeof(SteppedPart), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared == MAP_FAILED) return 1;
  auto* const part = new (shared) SteppedPart;
  std::fflush(nullptr);  // else both processes would write the buffers
  const pid_t traced = ::fork();
  if (traced == 0) {
    if (::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) ::_exit(1);
    std::raise(SIGSTOP);
    ::_exit(work(part));
  }
  if (traced > 0) share_processor(traced);
  const int status = traced > 0 ? trace(traced, *part) : 1;
  ::munmap(shared, sizeof(SteppedPart));
  return status;
}

constexpr double kPeriodS = 1e-3;
constexpr int kFramesTried = 600;
constexpr std::size_t kCounted = 3;
/// Frames stepped, those with the most counted steps: a million instructions take half a minute.
constexpr std::size_t kStepped = 1;

// Upper bounds on instructions per unit of a written bound, from callgrind on frames that do little else.
// Node: eight boxes at once, each child's visit and its block's layer. Triangle: corners from the ring, box,
// six products. Move: closest points on a ring of facets. Spline value or Newton step: 64 coefficients with
// derivatives. Height-field cell: its patch and the rise over it.
constexpr double kPerNode = 400.0, kPerTriangle = 120.0, kPerMove = 2500.0;
constexpr double kPerNewton = 900.0, kPerValue = 350.0, kPerCube = 150.0;
constexpr double kPerLook = 250.0, kPerSheetMove = 400.0;
/// Fixed instructions per frame.
constexpr double kPerFrame = 5000.0;

double bound_of(const std::string& name) {
  if (name == "cloud")
    // A flight enters, bridges, and searches for a density step beyond the gap.
    return kPerFrame + kPerMove * local_delaunay::kMaxFacetMoves * local_delaunay::kMaxFlights +
           local_delaunay::kMaxFlights * 3.0 *
               (kPerNode * local_delaunay::kMaxNodes + kPerTriangle * local_delaunay::kMaxTestedTriangles);
  if (name == "cloud-smooth")
    return kPerFrame + kPerNewton * render::kMaxNewtonSteps +
           render::kMaxEntriesPerFrame *
               (kPerValue * render::kMaxSegmentSamples + kPerCube * render::kMaxBrickLookups);
  return kPerFrame + kPerLook * render::kMaxCrossingTests + kPerSheetMove * render::kMaxDescentMoves;
}

// Unordered points make preparation try every repair: 55 us a point, twenty times a surface's. More points
// would prepare for minutes.
constexpr std::size_t kMostSoup = 1'000'000;
constexpr double kSoupMm = 20.0, kSoupAboveMm = 1.0;  // side of the cube, height above a relief

struct Stand {
  std::string scene;
  std::shared_ptr<const cloud::Cloud> cloud;
  geometry::Aabb around;  ///< the path's region
};

Stand stand_of(const char* scene, const std::vector<Vec3>& points, const geometry::Aabb& around) {
  return {scene,
          std::make_shared<const cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value()),
          around};
}

/// Random points in a cube: no surface, facets in all directions. Points beyond kMostSoup form a plane below
/// it, of the same spacing, so everything that grows with the number of points has its full size.
Stand soup(std::size_t count) {
  Random random(41);
  std::vector<Vec3> points;
  points.reserve(count);
  const double half = 0.5 * kSoupMm;
  const std::size_t in_cube = std::min(count, kMostSoup);
  for (std::size_t i = 0; i < in_cube; ++i)
    points.push_back(
        Vec3{random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)});
  const geometry::Aabb cube{Vec3::Constant(-half), Vec3::Constant(half)};
  if (in_cube == count) return stand_of("soup", points, cube);
  const double spacing_mm = kSoupMm / std::cbrt(static_cast<double>(in_cube));
  const double side = 0.5 * spacing_mm * std::sqrt(static_cast<double>(count - in_cube));
  while (points.size() < count)
    points.push_back(Vec3{random.uniform(-side, side), random.uniform(-side, side), -half - kSoupAboveMm});
  return stand_of("soup-over-plane", points, cube);
}

Stand generated(const char* scene, const std::string& spec) {
  auto cloud =
      std::make_shared<const cloud::Cloud>(cloud::generate(parse_named_options(spec).value()).value().cloud);
  const geometry::Aabb around = cloud->box_mm();
  return {scene, std::move(cloud), around};
}

/// Stands are made one at a time: ten million points are a gigabyte.
std::vector<std::function<Stand()>> stands_of(const std::string& name, std::size_t points) {
  if (name == "heightfield")
    return {[=] { return generated("relief", fmt::format("relief:points={}:mesh=false:slope=1", points)); }};
  return {
      [=] { return soup(points); },
      [=] { return generated("pebble", fmt::format("pebble:points={}:sampling=random:mesh=false", points)); },
      [=] {
        return generated("noisy",
                         fmt::format("relief:points={}:sampling=random:noise=0.4:mesh=false", points));
      }};
}

std::vector<Vec3> wild_path(const geometry::Aabb& box) {
  Random random(42);
  const Vec3 middle = box.centre_mm(), half = box.extent_mm().cwiseMax(0.1 * box.extent_mm().maxCoeff());
  const auto anywhere = [&](double reach) {
    const Vec3 at{random.uniform(-reach, reach), random.uniform(-reach, reach),
                  random.uniform(-reach, reach)};
    return Vec3(middle + at.cwiseProduct(half));
  };
  std::vector<Vec3> path = {middle + Vec3{0.0, 0.0, 2.0 * half.norm()}};
  while (path.size() < kFramesTried) {
    const double kind = random.uniform();
    const Vec3 from = path.back();
    if (kind < 0.4) {  // a jump in and out
      path.push_back(anywhere(0.5));
      continue;
    }
    if (kind < 0.5) {
      path.push_back(anywhere(3.0));
      continue;
    }
    const Vec3 to = anywhere(0.7);
    const int steps = 2 + static_cast<int>(random.below(kind < 0.75 ? 8 : 60));
    for (int k = 1; k <= steps; ++k) path.push_back(from + (to - from) * (static_cast<double>(k) / steps));
  }
  return path;
}

std::uint64_t work_of(const render::FrameCounters& c) {
  // A walk step examines several facets.
  return 8 * c.walk_steps + c.box_tests + c.cells_visited;
}

struct Tried {
  std::size_t frame = 0;
  std::uint64_t work = 0;
};

/// Frames with the most work, in order.
std::vector<std::size_t> worst_of(render::HapticRenderer& renderer, const std::vector<Vec3>& path,
                                  std::size_t wanted) {
  renderer.restart(path[0], -kPeriodS);
  std::vector<Tried> tried;
  std::uint64_t before = 0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const render::Frame frame = renderer.step(path[k], kPeriodS * static_cast<double>(k));
    const std::uint64_t now = work_of(renderer.counters());
    // A frame at its bound ranks above all others.
    constexpr std::uint64_t kAtBound = std::uint64_t{1} << 32;
    tried.push_back({k, now - before + (frame.status == render::FrameStatus::kBoundHit ? kAtBound : 0)});
    before = now;
  }
  std::partial_sort(tried.begin(), tried.begin() + static_cast<std::ptrdiff_t>(wanted), tried.end(),
                    [](const Tried& a, const Tried& b) { return a.work > b.work; });
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < wanted; ++i) frames.push_back(tried[i].frame);
  std::sort(frames.begin(), frames.end());
  return frames;
}

/// A frame's marks: callgrind's or the stepping process's.
class Marks {
 public:
  explicit Marks(SteppedPart* stepped) : stepped_(stepped) {}
  void begin() const noexcept {
    if (stepped_ != nullptr)
      stepped_->begin();
    else
      begin_counting();
  }
  void end(const std::string& name) const noexcept {
    if (stepped_ != nullptr)
      stepped_->end();
    else
      end_counting(name.c_str());
  }

 private:
  SteppedPart* stepped_;
};

int count(const std::string& name, const Stand& stand, const render::Registry& registry,
          SteppedPart* stepped) {
  render::ModelInput model;
  model.cloud = stand.cloud;
  render::SceneInput scene;
  scene.models.push_back(model);
  auto renderer = registry.make(name, {});
  if (!renderer || !(*renderer)->prepare(scene, {1, nullptr})) return 1;
  const std::vector<Vec3> path = wild_path(stand.around);
  const std::vector<std::size_t> worst = worst_of(**renderer, path, stepped != nullptr ? kStepped : kCounted);
  const Marks marks(stepped);
  (*renderer)->restart(path[0], -kPeriodS);
  std::size_t next = 0;
  for (std::size_t k = 0; next < worst.size(); ++k) {
    const double t_s = kPeriodS * static_cast<double>(k);
    if (k != worst[next]) {
      (void)(*renderer)->step(path[k], t_s);
      continue;
    }
    const std::string part =
        fmt::format("{} {} {} {} {:.0f}", name, stand.scene, stand.cloud->size(), k, bound_of(name));
    if (stepped != nullptr) stepped->name(part);
    marks.begin();
    (void)(*renderer)->step(path[k], t_s);
    marks.end(part);
    ++next;
  }
  return 0;
}

struct Wanted {
  std::vector<std::string> renderers;
  std::vector<std::size_t> sizes;
  bool step = false;
};

/// Parses the arguments; the first invalid one is an Error.
Result<Wanted> wanted_of(const std::vector<std::string>& words, const render::Registry& registry) {
  constexpr NumberRange kSizes{1'000, 20'000'000};
  Wanted wanted;
  for (const std::string& word : words) {
    if (word == "--step") {
      wanted.step = true;
    } else if (const render::RendererInfo* info = registry.find(word);
               info != nullptr && info->role == render::Role::kOurs) {
      wanted.renderers.push_back(word);
    } else {
      const Result<long long> size = read_integer(word, kSizes);
      if (!size) return size.error();
      wanted.sizes.push_back(static_cast<std::size_t>(*size));
    }
  }
  if (wanted.sizes.empty()) wanted.sizes = {10'000, 300'000};
  if (wanted.renderers.empty())
    for (const render::RendererInfo& info : registry.all())
      if (info.role == render::Role::kOurs && info.geometry != render::Geometry::kImages)
        wanted.renderers.push_back(info.name);
  return wanted;
}

/// Counts one renderer at one size on all its stands.
int count_all(const std::string& name, std::size_t size, bool step, const render::Registry& registry) {
  for (const auto& stand : stands_of(name, size)) {
    const auto counted = [&](SteppedPart* stepped) { return count(name, stand(), registry, stepped); };
    const int status = step ? run_stepped(counted) : counted(nullptr);
    if (status == 0) continue;
    fmt::print(stderr, "worst_frames: {} was not counted at {} points: status {}\n", name, size, status);
    return status;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  const Result<Wanted> wanted = wanted_of({argv + 1, argv + argc}, registry);
  if (!wanted) {
    fmt::print(stderr,
               "worst_frames: {}\nusage: worst_frames [--step] [RENDERER ...] [POINTS ...]\n"
               "  a renderer of ours: cloud, cloud-smooth, heightfield\n",
               wanted.error().message());
    return 2;
  }
  for (const std::size_t size : wanted->sizes)
    for (const std::string& name : wanted->renderers)
      if (const int status = count_all(name, size, wanted->step, registry); status != 0) return status;
  return 0;
}
