// Picture rate of the window and time to a complete picture, for several cloud sizes, with the camera turning
// and still. Needs a display, such as xvfb-run.
//
//   window_frame_rates [KEY=VALUE ...]     points=400000,1000000,3600000 seconds=3
//   window_frame_rates jitter=60           servo lateness with and without drawing instead, 60 s of each in
//                                          slices; points: the first number
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/servo_thread.h>
#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "device/live/mixer.h"
#include "device/simulated/simulated_device.h"
#include "experiments/benchmarks/weave_scene.h"
#include "experiments/window/window.h"
#include "toolkit/core/messages.h"

namespace {

using namespace palpate;
using namespace palpate::experiments;

// Lateness of servo ticks with and without the window drawing.

struct JitterWanted {
  std::size_t points = 1'000'000;
  double seconds = 60.0;  ///< for each of the two
  double slice_s = 5.0;
  std::string renderer = "cloud";
};

constexpr double kTurnRadAPicture = 0.02;
constexpr std::int64_t kJitterHz = 1000;
constexpr double kJitterUsPerNs = 1e-3;

/// Records every tick's lateness in preallocated memory; rearms after a fault so the renderer continues.
class LateBook final : public device::TickObserver {
 public:
  void reserve(double seconds) {
    late_us_.reserve(static_cast<std::size_t>(2.0 * seconds * static_cast<double>(kJitterHz)));
  }
  void took(const device::Tick& tick) noexcept override {
    if (late_us_.size() < late_us_.capacity())
      late_us_.push_back(static_cast<float>(kJitterUsPerNs * static_cast<double>(tick.t_ns - tick.due_ns)));
    missed_ += tick.missed;
    if (tick.fault == device::Fault::kNone) return;
    ++faults_;
    if (thread != nullptr) thread->request_rearm();
  }
  void print(const char* who) {
    std::sort(late_us_.begin(), late_us_.end());
    const auto at = [&](double share) {
      if (late_us_.empty()) return 0.0f;
      const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(late_us_.size())));
      return late_us_[std::clamp<std::size_t>(rank, 1, late_us_.size()) - 1];
    };
    fmt::print("| {} | {} | {} | {} | {:.1f} | {:.1f} | {:.1f} | {:.1f} |\n", who, late_us_.size(), missed_,
               faults_, at(0.5), at(0.99), at(0.999), at(1.0));
  }
  device::ServoThread* thread = nullptr;

 private:
  std::vector<float> late_us_;
  std::uint64_t missed_ = 0, faults_ = 0;
};

Result<std::unique_ptr<device::Mixer>> jitter_mixer(const JitterWanted& wanted, const WeaveScene& scene,
                                                    const Clock& clock) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(wanted.renderer));
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> renderer, registry.make(named.name, named.options));
  PALPATE_TRY(renderer->prepare(scene.input, {}));
  auto mixer = std::make_unique<device::Mixer>(device::SwitchOptions{}, clock);
  mixer->add(std::move(renderer));
  return mixer;
}

Status slice(const JitterWanted& wanted, const WeaveScene& scene, device::Mixer& mixer, SessionLink& link,
             LateBook& book) {
  const MonotonicClock clock;
  device::DeviceLimits limits;
  limits.force_max_n = 3.3;
  limits.workspace_mm = {Vec3::Constant(-1000.0), Vec3::Constant(1000.0)};
  limits.resolution_mm = 0.055;
  limits.rate_hz = static_cast<double>(kJitterHz);
  device::SimulatedDevice played(scene.path, clock, limits, 0);
  device::Servo servo(mixer, {}, played, clock, {});
  // Both cases have the feed, so only drawing differs.
  const auto feed =
      std::make_shared<WindowFeed>(servo, mixer, std::vector<std::shared_ptr<render::MovingModel>>{});
  device::ServoThreadOptions options;
  options.rate_hz = kJitterHz;
  const std::array<device::TickObserver*, 2> observers = {&book, feed.get()};
  PALPATE_ASSIGN(const auto thread, device::ServoThread::create(servo, clock, options, observers));
  book.thread = thread.get();
  PALPATE_TRY(thread->start());
  ShownSession shown;
  shown.device = "played";
  shown.labels = {wanted.renderer};
  shown.limits = limits;
  shown.force_limit_n = limits.force_max_n;
  shown.feed = feed;
  link.running(std::make_shared<const ShownSession>(std::move(shown)), {});
  std::this_thread::sleep_for(std::chrono::duration<double>(wanted.slice_s));
  link.ended();
  thread->stop();
  book.thread = nullptr;
  return Done{};
}

/// All slices, on a thread made before the window, as in a session: threads inherit niceness, and the window
/// raises its own.
class Slices {
 public:
  Slices(const JitterWanted& wanted, const WeaveScene& scene, device::Mixer& mixer, SessionLink& link)
      : thread_([this, &wanted, &scene, &mixer, &link] {
          while (!begun_.load(std::memory_order_acquire))
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
          const int slices = static_cast<int>(std::max(1.0, std::ceil(wanted.seconds / wanted.slice_s)));
          for (int i = 0; i < 2 * slices && status && !over_.load(std::memory_order_acquire); ++i) {
            const bool draws = i % 2 == 1;
            draws_.store(draws, std::memory_order_release);
            status = slice(wanted, scene, mixer, link, draws ? with : without);
          }
          over_.store(true, std::memory_order_release);
        }) {
    without.reserve(wanted.seconds + wanted.slice_s);
    with.reserve(wanted.seconds + wanted.slice_s);
  }
  Slices(const Slices&) = delete;
  Slices& operator=(const Slices&) = delete;
  ~Slices() {
    over_.store(true, std::memory_order_release);
    begin();
    thread_.join();
  }
  void begin() { begun_.store(true, std::memory_order_release); }
  [[nodiscard]] bool draws() const { return draws_.load(std::memory_order_acquire); }
  [[nodiscard]] bool over() const { return over_.load(std::memory_order_acquire); }

  LateBook without, with;  // read after the end
  Status status = Done{};

 private:
  std::atomic<bool> begun_{false}, draws_{false}, over_{false};
  std::thread thread_;
};

/// Alternates slices so both see the same machine; the window turns its camera, redrawing each picture, or
/// stands still. Prints a table: ticks, missed, faults, lateness in us (p50, p99, p99.9, largest).
Status measure_jitter(const JitterWanted& wanted) {
  PALPATE_ASSIGN(const WeaveScene scene, weave_scene(fmt::format("sinusoid:points={}", wanted.points),
                                                     std::llround(wanted.slice_s * kJitterHz)));
  const MonotonicClock clock;
  PALPATE_ASSIGN(const std::unique_ptr<device::Mixer> mixer, jitter_mixer(wanted, scene, clock));
  SessionLink link;
  Slices slices(wanted, scene, *mixer, link);
  PALPATE_ASSIGN(const std::unique_ptr<Window> window, Window::open(link, {}));
  link.show(std::make_shared<const ShownScene>(ShownScene{"sinusoid", scene.input.models}));
  window->frame();
  while (*window->scene().awaited() != '\0') window->frame();
  slices.begin();
  while (!slices.over()) {
    if (!slices.draws()) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      continue;
    }
    Camera camera = window->camera();
    camera.turn(kTurnRadAPicture, 0.0);
    window->look_from(camera);
    window->frame();
  }
  PALPATE_TRY(slices.status);
  fmt::print("servo at {} Hz with {} on {} points; drawn by {}\n\n", kJitterHz, wanted.renderer,
             scene.input.models.front().cloud->size(), window->graphics());
  fmt::print(
      "| window | ticks | missed | faults | late p50, us | p99 | p99.9 | most |\n"
      "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  slices.without.print("stands still");
  slices.with.print("draws");
  return Done{};
}

// Pictures a second.

constexpr double kTurnRad = 0.02;  // per picture
constexpr double kMsPerSecond = 1e3;

struct Rate {
  std::size_t points = 0;
  double turning = 0.0, standing = 0.0;  // pictures a second
  std::size_t points_a_picture = 0;      // while turning
  double whole_s = 0.0;                  // from the camera's stop until all points are drawn
  std::size_t whole_pictures = 0;        // number of pictures until then
};

Result<std::shared_ptr<const ShownScene>> scene_of(std::size_t points) {
  PALPATE_ASSIGN(NamedOptions wanted, parse_named_options(fmt::format("sinusoid:points={}", points)));
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(wanted));
  render::ModelInput model;
  model.name = wanted.name;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  return std::make_shared<const ShownScene>(ShownScene{wanted.name, {model}});
}

/// Pictures a second over `seconds`; calls `before` before each.
template <class Before>
double rate_of(Window& window, double seconds, Before&& before) {
  const Stopwatch watch;
  int pictures = 0;
  while (watch.ms() < kMsPerSecond * seconds) {
    before();
    window.frame();
    ++pictures;
  }
  return kMsPerSecond * pictures / watch.ms();
}

Rate measured(Window& window, std::size_t points, double seconds) {
  Rate rate;
  rate.points = points;
  const SplatDrawer& splats = window.scene().splats();
  // Waits for normals, which affect drawing.
  while (*window.scene().awaited() != '\0') window.frame();
  const auto turn = [&] {
    Camera camera = window.camera();
    camera.turn(kTurnRad, 0.0);
    window.look_from(camera);
  };
  (void)rate_of(window, 0.5 * seconds, turn);  // settles the budget
  rate.turning = rate_of(window, seconds, turn);
  rate.points_a_picture = splats.points_a_frame();
  turn();
  const Stopwatch watch;
  while (splats.drawn() < splats.points() || splats.drawn() == 0) window.frame();
  rate.whole_s = watch.ms() / kMsPerSecond;
  rate.whole_pictures = splats.whole_after();
  rate.standing = rate_of(window, seconds, [] {});
  return rate;
}

Status run(const Options& options) {
  constexpr NumberRange kSeconds{0.1, 3600.0};
  PALPATE_ASSIGN(const double seconds, read_number(options.text("seconds"), kSeconds));
  if (!options.text("jitter").empty()) {
    constexpr NumberRange kJitterS{0.1, 86'400.0};
    JitterWanted jitter;
    PALPATE_ASSIGN(jitter.seconds, read_number(options.text("jitter"), kJitterS));
    jitter.slice_s = std::min(jitter.slice_s, jitter.seconds);
    PALPATE_ASSIGN(const double points,
                   read_number(split_list(options.text("points")).front(), NumberRange{1.0, 1e9, true}));
    jitter.points = static_cast<std::size_t>(points);
    return measure_jitter(jitter);
  }
  SessionLink link;
  WindowOptions wanted;
  wanted.paced = false;
  PALPATE_ASSIGN(const std::unique_ptr<Window> window, Window::open(link, wanted));
  fmt::print(
      "drawn by {}\n\n| points | pictures/s turning | points in each | whole after, s | in pictures | "
      "pictures/s standing |\n"
      "| ---: | ---: | ---: | ---: | ---: | ---: |\n",
      window->graphics());
  for (const std::string& text : split_list(options.text("points"))) {
    const Result<double> points = read_number(text, NumberRange{1.0, 1e9, true});
    if (!points) return points.error();
    PALPATE_ASSIGN(std::shared_ptr<const ShownScene> scene, scene_of(static_cast<std::size_t>(*points)));
    link.show(scene);
    window->frame();
    const Rate rate = measured(*window, scene->models.front().cloud->size(), seconds);
    fmt::print("| {} | {:.1f} | {} | {:.2f} | {} | {:.1f} |\n", rate.points, rate.turning,
               rate.points_a_picture, rate.whole_s, rate.whole_pictures, rate.standing);
    std::fflush(stdout);  // the largest takes a while
  }
  return Done{};
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.set("points", "400000,1000000,3600000");
  options.set("seconds", "3");
  options.set("jitter", "");
  for (int i = 1; i < argc; ++i) {
    const std::vector<std::string> word = split_list(argv[i], '=');
    if (word.size() != 2 || !options.all().contains(word[0])) {
      fmt::print(stderr,
                 "window_frame_rates: {} is not understood; give points=N,.., seconds=S or jitter=S\n",
                 argv[i]);
      return 2;
    }
    options.set(word[0], word[1]);
  }
  const Status done = run(options);
  if (done) return 0;
  fmt::print(stderr, "window_frame_rates: {}\n", done.error().message());
  return 1;
}
