// Whole sessions under a window, driven by program as a person would: what is dropped, typed, pressed,
// closed.
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include <chrono>
#include <cstring>
#include <thread>

#include <palpate/clock.h>
#include "experiments/live/changes.h"
#include "experiments/live/live.h"
#include "experiments/window/sound.h"
#include "tests/experiments/program.h"
#include "tests/experiments/pulled_falcon.h"
#include "tests/experiments/window_rig.h"
#include "toolkit/cloud/statistics.h"

namespace palpate::experiments {
namespace {

constexpr double kLongestTestS = 120.0;

void close_window() {
  glfwSetWindowShouldClose(glfwGetCurrentContext(), GLFW_TRUE);
}

/// What the window system does where a file is dropped.
void drop_file(const std::string& path) {
  GLFWwindow* const window = glfwGetCurrentContext();
  const GLFWdropfun callback = glfwSetDropCallback(window, nullptr);
  glfwSetDropCallback(window, callback);
  ASSERT_NE(callback, nullptr);
  const char* const paths[] = {path.c_str()};
  callback(window, 1, const_cast<const char**>(paths));
}

/// A click takes pictures: there, down, up. One at a time.
class Clicker {
 public:
  /// True once it was hit. Where the button is not there it waits for it; what moves away under the mouse,
  /// as other lines of the panel come and go, is clicked again, as a person would.
  bool click(Window& window, const std::string& words) {
    if (step_ > 0 && window.panel().uses != uses_ && window.panel().used == words) {
      window.mouse_button(Window::Button::kLeft, false);  // a field is hit when it is pressed
      step_ = 0;
      return true;
    }
    const auto at = window.place_of(words);
    if (!at && step_ == 0) return false;
    if (at) window.mouse_at((*at)[0], (*at)[1]);
    if (step_ == 0) uses_ = window.panel().uses;
    if (step_ == 1) window.mouse_button(Window::Button::kLeft, true);
    if (step_ == 2) window.mouse_button(Window::Button::kLeft, false);
    constexpr int kPictures = 5;  // the last one tells whether it was hit
    step_ = (step_ + 1) % kPictures;
    return false;
  }

 private:
  int step_ = 0;
  std::size_t uses_ = 0;
};

void type(Window& window, const std::string& words) {
  for (const char c : words) window.text(static_cast<unsigned char>(c));
}

/// Steps in order, each called after every picture until it answers true; then the window is closed.
class Script {
 public:
  using Step = std::function<bool(Window&)>;
  Script& then(const std::string& name, Step step) {
    steps_.push_back({name, std::move(step)});
    return *this;
  }
  Script& click(const std::string& words) {
    return then("click " + words, [this, words](Window& window) { return clicker_.click(window, words); });
  }
  void operator()(Window& window) {
    if (at_ < steps_.size() && steps_[at_].step(window)) ++at_;
    if (at_ < steps_.size() && watch_.ms() > 1e3 * kLongestTestS) {
      ADD_FAILURE() << "never came beyond: " << steps_[at_].name;
      at_ = steps_.size();
    }
    if (at_ == steps_.size()) close_window();
  }
  [[nodiscard]] bool done() const { return at_ == steps_.size(); }

 private:
  struct Named {
    std::string name;
    Step step;
  };
  std::vector<Named> steps_;
  std::size_t at_ = 0;
  Clicker clicker_;
  Stopwatch watch_;
};

class DrivenWindow : public InFolder {
 protected:
  void SetUp() override {
    {
      SessionLink link;
      const auto opened = Window::open(link, {});
      if (!opened) GTEST_SKIP() << opened.error().message();
    }
    before_ = std::filesystem::current_path();
    std::filesystem::current_path(folder_);
  }
  void TearDown() override {
    if (!before_.empty()) std::filesystem::current_path(before_);
  }
  LiveArguments arguments(const std::string& scene, const std::string& renderers) {
    LiveArguments a;
    a.run.scene = scene;
    a.run.renderers = renderers;
    a.run.out = in("results");
    a.window = true;
    a.rearm = true;  // a busy machine stands still for longer than the watchdog allows
    return a;
  }
  static int live(const LiveArguments& a, const std::function<void(Window&)>& each_picture,
                  const device::Drivers& drivers = session_drivers()) {
    ProgressBar progress;
    Context context{progress, "palpate live"};
    return run_live_in_window(a, drivers, context, each_picture);
  }
  static bool ticks(Window& window) { return window.drawn_tick().ticks > 0; }

 private:
  std::filesystem::path before_;
};

TEST_F(DrivenWindow, ChangesRecordsMarksExportsAndOpensWhatIsDropped) {
  std::string points;
  for (int x = -20; x <= 20; ++x)
    for (int y = -20; y <= 20; ++y)
      points +=
          std::to_string(x) + " " + std::to_string(y) + " " + std::to_string(0.1 * std::sin(0.3 * x)) + "\n";
  write_text(in("dropped.xyz"), points);
  bool recorded = false;
  std::uint32_t generation = 0;
  Script script;
  script.then("touchable", ticks)
      .click("change to")
      .then("type", [](Window& window) { return type(window, "cloud:stiffness=0.8"), true; })
      .click("Change")
      .then("changed",
            [&](Window& window) {
              for (const device::TrackedFrame& one : window.drawn_tick().mixed.tracked)
                if (one.present && one.lane == 0) generation = std::max(generation, one.generation);
              return generation > 1;
            })
      .click("Record")
      .then("records",
            [&](Window& window) {
              return recorded = window.place_of("Stop recording").has_value() && ticks(window);
            })
      .click("remark")
      .then("type", [](Window& window) { return type(window, "just here"), true; })
      .click("Mark")
      .click("export frames")
      .then("exports", [&](Window&) { return std::filesystem::exists(in("palpate-frame-000002.png")); })
      .click("export frames")
      .click("Screenshot")
      .then("is written", [&](Window&) { return std::filesystem::exists(in("palpate-001.png")); })
      .then("drop",
            [&](Window& window) {
              EXPECT_EQ(window.scene().scene()->name.find("dropped"), std::string::npos);
              drop_file(in("dropped.xyz"));
              return true;
            })
      .then("touchable again", [](Window& window) {
        return window.scene().scene() != nullptr &&
               window.scene().scene()->name.find("dropped") != std::string::npos && ticks(window);
      });
  const int status = live(arguments(kWindowWaves, "cloud,cloud-smooth"), std::ref(script));
  EXPECT_TRUE(ended_well(status, in("results/live.json")));
  ASSERT_TRUE(script.done());
  EXPECT_TRUE(recorded);
  EXPECT_NE(file_text(in("live-001.palrec")).find("mark: just here"), std::string::npos);
  const std::string png = file_text(in("palpate-001.png"));
  EXPECT_EQ(png.rfind("\x89PNG", 0), 0u);
  const std::string json = file_text(in("results/live.json"));
  EXPECT_NE(json.find("just here"), std::string::npos) << "the mark is in the document of its session";
}

TEST_F(DrivenWindow, ClosingItWhileSomethingIsPreparedIsNoErrorAndLeavesNothing) {
  LiveArguments a = arguments("sinusoid:points=1002001", "cloud-smooth");
  a.stand_in = 0.0;
  // As soon as there is a window; and as soon as the scene is seen, when renderers are prepared.
  for (const bool seen : {false, true}) {
    bool was_touchable = false;
    const int status = live(a, [&](Window& window) {
      was_touchable = was_touchable || ticks(window);
      if (!seen || window.scene().scene() != nullptr) close_window();
    });
    EXPECT_EQ(status, kExitOk);
    EXPECT_FALSE(was_touchable) << "it was closed too late to test anything";
    EXPECT_FALSE(std::filesystem::exists(in("results")));
  }
}

TEST_F(DrivenWindow, ALargeSceneIsTouchedCoarselyUntilItIsPrepared) {
  LiveArguments a = arguments("sinusoid:points=160801", "cloud,cloud-smooth");
  a.stand_in = 10'000.0;
  bool coarse = false;
  Script script;
  script.then("touchable", ticks)
      .then("coarse",
            [&](Window& window) {
              for (const device::TrackedFrame& one : window.drawn_tick().mixed.tracked)
                coarse = coarse || (one.present && one.generation == SessionLink::kFirstGeneration);
              return true;
            })
      .then("whole", [](Window& window) {
        int whole = 0, present = 0;
        for (const device::TrackedFrame& one : window.drawn_tick().mixed.tracked) {
          present += one.present ? 1 : 0;
          whole += one.present && one.generation > SessionLink::kFirstGeneration ? 1 : 0;
        }
        return present == 2 && whole == 2;
      });
  EXPECT_TRUE(ended_well(live(a, std::ref(script)), in("results/live.json")));
  ASSERT_TRUE(script.done());
  EXPECT_TRUE(coarse) << "nothing stood in for anything";
  const std::string json = file_text(in("results/live.json"));
  EXPECT_NE(json.find("cloud was prepared on all points"), std::string::npos);
  EXPECT_NE(json.find("cloud-smooth was prepared on all points"), std::string::npos);
  EXPECT_NE(json.find(" of 160801 points"), std::string::npos);
  EXPECT_EQ(json.find("was not prepared when the session ended"), std::string::npos);
}

TEST_F(DrivenWindow, AMovingModelIsDrawnWhereItIs) {
  write_text(
      in("moving.toml"),
      "[[model]]\ngenerate = \"sinusoid\"\npoints = 10201\nextent_mm = 40\nwavelength_mm = 40\n"
      "amplitude_mm = 2\n  [model.motion]\n  velocity_mm_s = [20, 0, 0]\n  start_s = 0.5\n  stop_s = 1.5\n");
  LiveArguments a = arguments(in("moving.toml"), "cloud");
  int looked = 0, there = 0, left = 0, left_painted = 0;
  int still = 0;
  Script script;
  script.then("touchable", ticks).then("arrived and whole", [&](Window& window) {
    window.panel().workspace = false;
    const SplatDrawer& splats = window.scene().splats();
    const bool arrived = window.drawn_tick().world_from_model[0].translation_mm.x() > 19.9;
    still = arrived && splats.drawn() == splats.points() && *window.scene().awaited() == '\0' ? still + 1 : 0;
    if (still < 3) return false;
    const ColourImage image = window.picture();
    const geometry::RigidTransform& now = window.drawn_tick().world_from_model[0];
    const cloud::Cloud& cloud = *window.scene().scene()->models[0].cloud;
    const Mat4 clip = window.camera().clip_from_world(window.view_width(), window.view_height());
    const auto painted = [&](const Vec3& world_mm) -> std::optional<bool> {
      const auto at = project(clip, world_mm, window.view_width(), window.view_height());
      if (!at || at->x < 0 || at->y < 0 || at->x >= window.view_width() || at->y >= image.height)
        return std::nullopt;
      const std::uint8_t* pixel = image.at(static_cast<int>(at->x), static_cast<int>(at->y));
      return !(pixel[0] < 60 && pixel[1] < 65 && pixel[2] < 70);
    };
    for (std::size_t i = 0; i < cloud.size(); i += 37) {
      const Vec3 began = cloud.point_mm(i);
      if (const auto ink = painted(now * began)) {
        ++looked;
        there += *ink ? 1 : 0;
      }
      // Where it was at first and is not now: the first third of its extent.
      if (began.x() > -8.0) continue;
      if (const auto ink = painted(began)) {
        ++left;
        left_painted += *ink ? 1 : 0;
      }
    }
    return true;
  });
  EXPECT_TRUE(ended_well(live(a, std::ref(script)), in("results/live.json")));
  ASSERT_TRUE(script.done());
  EXPECT_GT(looked, 50);
  EXPECT_EQ(there, looked) << "the model is not drawn where it is";
  EXPECT_GT(left, 30);
  EXPECT_LE(left_painted, left / 20) << "it is still drawn where it was";
}

TEST_F(DrivenWindow, ADeviceThatHasToBeHomedAsksInTheWindow) {
  constexpr int kCommandsALeg = 500;  // half a second each, once it is pulled
  std::atomic<bool> pulled{false};
  device::Drivers drivers;
  drivers.add({"falcon", "simulation",
               [] {
                 return std::vector<device::DeviceEntry>{
                     {"pretended", "for tests", device::DeviceStatus::kReady, {}}};
               },
               [&pulled](const device::DeviceRequest&, const Clock& clock) -> Result<device::MadeDevice> {
                 return pulled_falcon(clock, kCommandsALeg, &pulled);
               }});
  LiveArguments a = arguments(kSmallWaves, "cloud");
  a.device.device = "falcon";
  std::vector<std::string> asked;
  int big = 0;
  Script script;
  script
      .then("asked",
            [&](Window& window) {
              const std::string now = window.panel().homing;
              if (now.empty()) return false;
              asked.push_back(now);
              big = spot_of(window.picture(), kHomingPaper, window.view_width()).count;
              pulled.store(true, std::memory_order_release);
              return true;
            })
      .then("homed", [&](Window& window) {
        const std::string now = window.panel().homing;
        if (!now.empty() && now != asked.back()) asked.push_back(now);
        return now.empty() && spot_of(window.picture(), kHomingPaper, window.view_width()).count == 0;
      });
  EXPECT_TRUE(ended_well(live(a, std::ref(script), drivers), in("results/live.json")));
  ASSERT_TRUE(script.done());
  ASSERT_FALSE(asked.empty());
  EXPECT_NE(asked.front().find("Pull the grip all the way out"), std::string::npos) << asked.front();
  EXPECT_GT(asked.size(), 1u) << "what is left to do changes";
  EXPECT_GT(big, 50'000);
}

TEST_F(DrivenWindow, AScenesFileSaysWhatIsUpAndTheOptionWins) {
  const std::string scene = in("lying.toml");
  const std::string model = "[[model]]\ngenerate = \"sinusoid\"\npoints = 2601\n[view]\nup = ";
  write_text(scene, model + "\"-y\"\n");
  for (const auto& [option, up] : {std::pair{"", Up::kMinusY}, std::pair{"x", Up::kX}}) {
    LiveArguments a = arguments(scene, "cloud");
    a.up = option;
    a.run.out = in(std::string("results") + option);
    Script script;
    script.then("touchable", ticks);
    std::optional<Up> seen;
    const int status = live(a, [&](Window& window) {
      if (window.scene().scene() != nullptr) seen = window.camera().up_axis();
      script(window);
    });
    EXPECT_TRUE(ended_well(status, a.run.out + "/live.json"));
    EXPECT_EQ(seen, up);
  }
  write_text(scene, model + "\"w\"\n");
  testing::internal::CaptureStderr();
  EXPECT_EQ(live(arguments(scene, "cloud"), [](Window&) { ADD_FAILURE() << "a window opened"; }),
            kExitBadInput);
  const std::string said = testing::internal::GetCapturedStderr();
  EXPECT_NE(said.find("lying.toml:5"), std::string::npos) << said;
  EXPECT_NE(said.find("choose from"), std::string::npos) << said;
  LiveArguments named = arguments(kWindowWaves, "cloud");
  named.up = "w";
  EXPECT_EQ(live(named, [](Window&) { ADD_FAILURE() << "a window opened"; }), kExitBadInput);
}

TEST(StandIn, SpreadsEvenlyAndTakesThePropertiesAlong) {
  cloud::Cloud cloud = *loaded_scene("sinusoid:points=160801").input.models.front().cloud;
  cloud::Property number{"number", {}};
  for (std::size_t i = 0; i < cloud.size(); ++i) number.values.push_back(static_cast<float>(i));
  cloud.properties = {number};
  const std::vector<std::uint32_t> kept = thinned(cloud, 8'000);
  const cloud::Cloud thin = cloud::subset_of(cloud, kept);
  EXPECT_GT(kept.size(), 6'000u);
  EXPECT_LT(kept.size(), 10'000u);
  EXPECT_EQ(kept, thinned(cloud, 8'000)) << "the same every time";
  ASSERT_EQ(thin.size(), kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    ASSERT_TRUE(i == 0 || kept[i] > kept[i - 1]);
    ASSERT_EQ(thin.point_mm(i), cloud.point_mm(kept[i]));
    ASSERT_EQ(thin.properties[0].values[i], static_cast<float>(kept[i]));
  }
  // Nowhere a hole: every point has one that was kept within a few of the new spacings.
  const geometry::Aabb box = cloud.box_mm();
  const double spacing_mm = box.extent_mm().norm() / std::sqrt(static_cast<double>(kept.size()));
  double farthest_mm = 0.0;
  for (std::size_t i = 0; i < cloud.size(); i += 501) {
    double nearest = 1e300;
    for (std::size_t k = 0; k < thin.size(); ++k)
      nearest = std::min(nearest, (thin.point_mm(k) - cloud.point_mm(i)).norm());
    farthest_mm = std::max(farthest_mm, nearest);
  }
  EXPECT_LT(farthest_mm, 2.0 * spacing_mm);
  EXPECT_EQ(thinned(cloud, cloud.size()).size(), cloud.size());
  EXPECT_GE(thinned(cloud, 1).size(), 1u);
}

// ---- The force as a tone: what the samples hold, and that the audio system is given them.

/// Whole waves a second, by upward crossings of zero, and the loudest sample.
struct Heard {
  double hz = 0.0;
  int loudest = 0;
};
Heard heard(const std::vector<std::int16_t>& samples) {
  Heard of;
  int crossings = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    of.loudest = std::max(of.loudest, std::abs(static_cast<int>(samples[i])));
    if (i > 0 && samples[i - 1] < 0 && samples[i] >= 0) ++crossings;
  }
  of.hz = crossings * static_cast<double>(ForceTone::kRateHz) / static_cast<double>(samples.size());
  return of;
}

TEST(ForceTone, IsHigherAndLouderWithTheForceAndSilentWithoutOne) {
  ForceTone tone;
  std::vector<std::int16_t> second(ForceTone::kRateHz);
  tone.fill(second, 0.0);
  EXPECT_EQ(heard(second).loudest, 0);
  Heard last;
  for (const double share : {0.25, 0.5, 0.75, 1.0, 2.0}) {
    tone.fill(second, share);
    tone.fill(second, share);
    const Heard now = heard(second);
    const double reached = std::min(share, 1.0);
    EXPECT_NEAR(now.hz,
                ForceTone::kLowestHz * std::pow(ForceTone::kHighestHz / ForceTone::kLowestHz, reached), 2.0);
    EXPECT_NEAR(now.loudest, 32'767.0 * ForceTone::kLoudest * reached, 20.0);
    EXPECT_GE(now.hz, last.hz);
    last = now;
  }
  tone.fill(second, std::nan(""));
  tone.fill(second, std::nan(""));
  EXPECT_LT(heard(second).loudest, 2) << "what is no number is not heard";
  // A step of the force does not click: from sample to sample no more than the tone itself moves.
  std::vector<std::int16_t> step(2'000);
  ForceTone quiet;
  quiet.fill(step, 1.0);
  constexpr double kSteepest = 2.0 * 3.15 * ForceTone::kHighestHz / ForceTone::kRateHz * ForceTone::kLoudest;
  for (std::size_t i = 1; i < step.size(); ++i)
    ASSERT_LT(std::abs(step[i] - step[i - 1]), 32'767.0 * (kSteepest + 0.01));
}

class PlayedSound : public InFolder {};

TEST_F(PlayedSound, GetsTheNewestForce) {
  // SDL's driver that writes what it is given into a file.
  const Environment driver("SDL_AUDIODRIVER", "disk"), file("SDL_DISKAUDIOFILE", in("heard.raw").c_str());
  std::atomic<float> force_n{1.5f};
  {
    const auto sound = Sound::open(force_n, 3.0);
    if (!sound) GTEST_SKIP() << sound.error().message();
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
  const std::string bytes = file_text(in("heard.raw"));
  std::vector<std::int16_t> samples(bytes.size() / sizeof(std::int16_t));
  std::memcpy(samples.data(), bytes.data(), samples.size() * sizeof(std::int16_t));
  ASSERT_GT(samples.size(), 4'000u);
  const std::vector<std::int16_t> later(samples.begin() + 2'000, samples.end());
  EXPECT_NEAR(heard(later).hz, 2.0 * ForceTone::kLowestHz, 0.06 * 2.0 * ForceTone::kLowestHz)
      << "half of the limit is an octave up";
  EXPECT_NEAR(heard(later).loudest, 0.5 * ForceTone::kLoudest * 32'767.0, 100.0);
}

}  // namespace
}  // namespace palpate::experiments
