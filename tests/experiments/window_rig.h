// A session under a window for tests: a scene, two renderers on a mixer, a simulated device, on a virtual
// clock; and a window over it, where there is a display.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/device/servo_loop.h>
#include <palpate/options.h>
#include <palpate/scene.h>
#include "device/live/hand_controls.h"
#include "device/simulated/simulated_arm.h"
#include "experiments/session/session.h"
#include "experiments/window/window.h"
#include "tests/toolkit/messages.h"

namespace palpate::experiments {

/// Three millimetres high, and small enough to be drawn at once.
inline constexpr const char* kWindowWaves =
    "sinusoid:points=10201:extent_mm=60:wavelength_mm=30:amplitude_mm=3";

/// A generated scene, loaded.
inline scene::LoadedScene loaded_scene(const std::string& name) {
  const auto file = test::value_of(scene::open_scene(name));
  return test::value_of(scene::load(file, all_readers(), {}, no_progress()));
}

/// Where tests leave their pictures for people; empty: nowhere.
inline std::string picture_folder() {
  const char* folder = std::getenv("PALPATE_PICTURES");
  return folder != nullptr ? folder : "";
}

inline bool is_paper(const std::uint8_t* pixel) {
  return pixel[0] < 60 && pixel[1] < 65 && pixel[2] < 70;
}

inline double apart(const std::uint8_t* pixel, const std::array<std::uint8_t, 3>& colour) {
  double sum = 0.0;
  for (std::size_t k = 0; k < 3; ++k)
    sum = std::max(sum, std::abs(static_cast<double>(pixel[k]) - colour[k]));
  return sum;
}

/// The middle of all pixels of a colour left of the panel, and how many.
struct Spot {
  double x = 0.0, y = 0.0;
  int count = 0;
};
inline Spot spot_of(const ColourImage& image, const std::array<std::uint8_t, 3>& colour, double width) {
  Spot spot;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < static_cast<int>(width); ++x) {
      if (apart(image.at(x, y), colour) > 6.0) continue;
      spot.x += x;
      spot.y += y;
      ++spot.count;
    }
  if (spot.count > 0) {
    spot.x /= spot.count;
    spot.y /= spot.count;
  }
  return spot;
}

/// A virtual clock that goes on by the machine's between two of its steps, by half a millisecond at most: the
/// same ticks, and what a frame of them takes is seen. One thread.
class TimedFrames final : public Clock {
 public:
  explicit TimedFrames(const VirtualClock& steps) : steps_(steps) {}
  [[nodiscard]] std::int64_t now_ns() const noexcept override {
    const std::int64_t step_ns = steps_.now_ns();
    if (step_ns != step_ns_) since_ns_ = monotonic_ns();
    step_ns_ = step_ns;
    return last_ns_ = std::max(last_ns_, step_ns + std::min(kMostNs, monotonic_ns() - since_ns_));
  }

 private:
  static constexpr std::int64_t kMostNs = 500'000;
  const VirtualClock& steps_;
  mutable std::int64_t step_ns_ = -1, since_ns_ = 0, last_ns_ = 0;
};

/// Owns everything that ticks, in the order in which it may end. The hand goes where `guide` says.
class WindowSession {
 public:
  /// `frames`: what times them; null: the same clock.
  WindowSession(const std::string& scene, const std::vector<std::string>& renderers, const Clock& clock,
                const std::optional<Vec3>& fitted_free_mm = std::nullopt, const Clock* frames = nullptr)
      : loaded_(loaded_scene(scene)) {
    const render::Registry registry = all_renderers();
    hold(Vec3(0.0, 0.0, 10.0), clock);
    // Its limits say where the free place is for the device.
    if (fitted_free_mm) hold(fitted_map().device_mm(*fitted_free_mm), clock);
    device::SwitchOptions switching{.device_force_max_n = plant_->limits().force_max_n,
                                    .force_limit_n = plant_->limits().force_max_n};
    const Clock& timed = frames != nullptr ? *frames : clock;
    mixer_ = std::make_unique<device::Mixer>(switching, clock, timed);
    for (const std::string& name : renderers) {
      const NamedOptions named = parse_named_options(name).value();
      auto renderer = registry.make(named.name, named.options).value();
      EXPECT_TRUE(renderer->prepare(loaded_.input, {}).ok()) << name;
      mixer_->add(std::move(renderer));
    }
    servo_ = std::make_unique<device::Servo>(*mixer_, device::GovernorOptions{}, *plant_, timed,
                                             fitted_free_mm ? fitted_map() : device::DeviceMap{});
    feed_ =
        std::make_shared<WindowFeed>(*servo_, *mixer_, std::vector<std::shared_ptr<render::MovingModel>>{});
    scene_ = std::make_shared<const ShownScene>(ShownScene{scene, loaded_.input.models});
    ShownSession shown;
    shown.device = "sim:omni";
    shown.labels = renderers;
    shown.limits = plant_->limits();
    shown.force_limit_n = 0.7 * shown.limits.force_max_n;
    shown.felt_options = renderers.front() + ":stiffness=0.8";
    shown.feed = feed_;
    shown.hand = guide_;
    shown_ = std::make_shared<const ShownSession>(std::move(shown));
  }

  /// Shows it in a window.
  void show_in(SessionLink& link, std::function<void()> rearm = {},
               std::function<std::string()> homing_prompt = {}) {
    link.show(scene_);
    SessionActions actions;
    actions.switch_to = [this](const device::SwitchRequest& request) { mixer_->request(request); };
    actions.rearm = std::move(rearm);
    actions.homing_prompt = std::move(homing_prompt);
    link.running(shown_, std::move(actions));
  }
  /// All of the scene within the device's reach.
  [[nodiscard]] device::DeviceMap fitted_map() const {
    device::WorkspaceOptions options;
    options.fit = device::WorkspaceFit::kFitted;
    return device::map_for(loaded_.input.models.front().cloud->box_mm(), plant_->limits(), options).value();
  }
  [[nodiscard]] device::Servo& servo() { return *servo_; }
  [[nodiscard]] device::Mixer& mixer() { return *mixer_; }
  [[nodiscard]] WindowFeed& feed() { return *feed_; }
  [[nodiscard]] device::HandGuide& hand() { return *guide_; }
  [[nodiscard]] const render::SceneInput& input() const { return loaded_.input; }
  [[nodiscard]] double stiffness_n_per_mm() const {
    return loaded_.input.models.front().surface.stiffness_n_per_mm;
  }

 private:
  /// A hand holds the device at this place of it.
  void hold(const Vec3& device_mm, const Clock& clock) {
    plant_.reset();
    guide_ = std::make_shared<device::HandGuide>(device_mm);
    script_ = std::make_unique<device::HandScript>(device::HandScript::guided("mouse", guide_));
    plant_ = device::simulated_rig("omni", "hand").value().make(*script_, clock, 1e-3);
  }

  scene::LoadedScene loaded_;
  std::shared_ptr<device::HandGuide> guide_;
  std::unique_ptr<device::HandScript> script_;
  std::unique_ptr<device::SimulatedPlant> plant_;
  std::unique_ptr<device::Mixer> mixer_;
  std::unique_ptr<device::Servo> servo_;
  std::shared_ptr<WindowFeed> feed_;
  std::shared_ptr<const ShownScene> scene_;
  std::shared_ptr<const ShownSession> shown_;
};

/// The same on a virtual clock, with a loop of its own.
class VirtualSession {
 public:
  explicit VirtualSession(const std::string& scene,
                          const std::vector<std::string>& renderers = {"cloud", "cloud-smooth"},
                          const std::optional<Vec3>& free_mm = std::nullopt, bool times_frames = false)
      : session(scene, renderers, clock, free_mm, times_frames ? &frames : nullptr),
        observers_{&session.feed()} {
    EXPECT_TRUE(session.servo().start(free_mm.value_or(Vec3(0.0, 0.0, 10.0))).ok());
    loop_ = device::ServoLoop::create(session.servo(), clock, 1000, observers_).value();
  }
  void run(double seconds) {
    const auto until_ns = clock.now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    device::run_accelerated(*loop_, clock, until_ns, [] { return true; });
  }
  [[nodiscard]] device::ServoLoop& loop() { return *loop_; }

  VirtualClock clock;
  TimedFrames frames{clock};
  WindowSession session;

 private:
  std::vector<device::TickObserver*> observers_;
  std::unique_ptr<device::ServoLoop> loop_;
};

/// A window over a link, where there is a display.
class WindowTest : public testing::Test {
 protected:
  WindowTest() { window_options.paced = false; }
  void SetUp() override {
    auto opened = Window::open(link, window_options);
    if (!opened)
      GTEST_SKIP() << "needs a display with OpenGL 3.3, which xvfb-run gives: " << opened.error().message();
    window = std::move(*opened);
  }
  void TearDown() override {
    if (window && !picture_folder().empty()) {
      const auto* info = testing::UnitTest::GetInstance()->current_test_info();
      (void)window->screenshot(picture_folder() + "/" + info->name() + ".png");
    }
  }
  static constexpr double kBegun = 0.6;  ///< s: the governor's soft start is over
  /// A session of its own, shown after so long; the picture is whole.
  void show(const std::string& scene, double seconds = 0.0,
            const std::vector<std::string>& renderers = {"cloud", "cloud-smooth"},
            std::function<void()> rearm = {}, std::function<std::string()> homing_prompt = {}) {
    live = std::make_unique<VirtualSession>(scene, renderers);
    live->session.show_in(link, std::move(rearm), std::move(homing_prompt));
    if (seconds > 0.0) live->run(seconds);
    settle();
  }
  void run_and_draw(double seconds) {
    live->run(seconds);
    ASSERT_TRUE(window->frame());
  }
  /// So long of the session, with a picture every 20 ms.
  void watch(double seconds) {
    for (double t = 0.0; t < seconds; t += 0.02) ASSERT_NO_FATAL_FAILURE(run_and_draw(0.02));
  }
  /// A tick that comes a tenth of a second late, a fault of the governor, and its picture.
  void tick_late() {
    live->clock.advance(0.1);
    live->loop().tick();
    ASSERT_TRUE(window->frame());
  }
  [[nodiscard]] const cloud::Cloud& shown_cloud() const {
    return *live->session.input().models.front().cloud;
  }
  [[nodiscard]] const device::Tick& drawn() const { return window->drawn_tick().tick; }
  [[nodiscard]] const device::TrackedFrame& felt() const {
    const device::MixedFrame& mixed = window->drawn_tick().mixed;
    return mixed.tracked[mixed.felt];
  }
  void press(char key) {
    for (const bool down : {true, false}) window->key(key, down);
  }
  /// Until every point is drawn and nothing is awaited.
  void settle() {
    constexpr int kMostFrames = 2'000;
    for (int i = 0; i < kMostFrames; ++i) {
      ASSERT_TRUE(window->frame());
      const SplatDrawer& splats = window->scene().splats();
      if (*window->scene().awaited() == '\0' && splats.points() > 0 && splats.drawn() == splats.points())
        return;
    }
    FAIL() << "the picture was never whole";
  }
  [[nodiscard]] Pixel seen(const Vec3& world_mm) const {
    return *project(window->camera().clip_from_world(window->view_width(), window->view_height()), world_mm,
                    window->view_width(), window->view_height());
  }
  /// Down and up in two pictures, with one before that shows where the mouse is.
  void click_at(double x, double y) {
    window->mouse_at(x, y);
    ASSERT_TRUE(window->frame());
    for (const bool down : {true, false}) {
      window->mouse_button(Window::Button::kLeft, down);
      ASSERT_TRUE(window->frame());
    }
  }
  void point_at(const Vec3& world_mm) {
    const Pixel at = seen(world_mm);
    window->mouse_at(at.x, at.y);
  }

  WindowOptions window_options;
  SessionLink link;
  std::unique_ptr<Window> window;
  std::unique_ptr<VirtualSession> live;
};

}  // namespace palpate::experiments
