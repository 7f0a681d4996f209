// A session under a window for tests: a scene, two renderers on a mixer, a simulated device, on a virtual
// clock; and a window over it, where there is a display.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "device/servo/servo_loop.h"
#include "device/simulated/arm_models.h"
#include "experiments/session/session.h"
#include "experiments/window/window.h"
#include "toolkit/scene/scene.h"

namespace palpate::experiments {

/// A generated scene, loaded.
inline scene::LoadedScene loaded_scene(const std::string& name) {
  const auto file = scene::open_scene(name);
  EXPECT_TRUE(file.ok());
  return scene::load(*file, all_readers(), {}, no_progress()).value();
}

/// Owns everything that ticks, in the order in which it may end. The hand goes where `guide` says.
class WindowSession {
 public:
  WindowSession(const std::string& scene, const std::vector<std::string>& renderers, const Clock& clock)
      : loaded_(loaded_scene(scene)) {
    const render::Registry registry = all_renderers();
    guide_ = std::make_shared<device::HandGuide>(Vec3(0.0, 0.0, 10.0));
    script_ = std::make_unique<device::HandScript>(device::HandScript::guided("mouse", guide_));
    plant_ = device::simulated_rig("omni", "hand").value().make(*script_, clock, 1e-3);
    device::SwitchOptions switching;
    switching.device_force_max_n = plant_->limits().force_max_n;
    switching.force_limit_n = plant_->limits().force_max_n;
    mixer_ = std::make_unique<device::Mixer>(switching, clock);
    for (const std::string& name : renderers) {
      auto renderer = registry.make(name, {}).value();
      EXPECT_TRUE(renderer->prepare(loaded_.input, {}).ok()) << name;
      mixer_->add(std::move(renderer));
    }
    servo_ = std::make_unique<device::Servo>(*mixer_, device::GovernorOptions{}, *plant_, clock,
                                             device::DeviceMap{});
    feed_ =
        std::make_shared<WindowFeed>(*servo_, *mixer_, std::vector<std::shared_ptr<render::MovingModel>>{});
    scene_ = std::make_shared<const ShownScene>(ShownScene{scene, loaded_.input.models});
    ShownSession shown;
    shown.device = "sim:omni";
    shown.labels = renderers;
    shown.limits = plant_->limits();
    shown.force_limit_n = 0.7 * shown.limits.force_max_n;
    shown.feed = feed_;
    shown.hand = guide_;
    shown_ = std::make_shared<const ShownSession>(std::move(shown));
  }

  /// Shows it in a window.
  void show_in(SessionLink& link, std::function<void()> rearm = {}) {
    link.show(scene_);
    SessionActions actions;
    actions.switch_to = [this](const device::SwitchRequest& request) { mixer_->request(request); };
    actions.rearm = std::move(rearm);
    link.running(shown_, std::move(actions));
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
                          const std::vector<std::string>& renderers = {"cloud", "cloud-smooth"})
      : session(scene, renderers, clock), observers_{&session.feed()} {
    EXPECT_TRUE(session.servo().start(Vec3(0.0, 0.0, 10.0)).ok());
    loop_ = device::ServoLoop::create(session.servo(), clock, 1000, observers_).value();
  }
  void run(double seconds) {
    const auto until_ns = clock.now_ns() + static_cast<std::int64_t>(seconds * 1e9);
    device::run_accelerated(*loop_, clock, until_ns, [] { return true; });
  }
  [[nodiscard]] device::ServoLoop& loop() { return *loop_; }

  VirtualClock clock;
  WindowSession session;

 private:
  std::vector<device::TickObserver*> observers_;
  std::unique_ptr<device::ServoLoop> loop_;
};

}  // namespace palpate::experiments
