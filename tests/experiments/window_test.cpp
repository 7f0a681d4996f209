// The window as a person sees it: input is put in, the picture is read back and compared by what is in it.
#include "experiments/window/window.h"

#include <chrono>
#include <thread>

#include <palpate/device/servo_thread.h>
#include "experiments/window/overlay.h"
#include "experiments/window/scene_view.h"
#include "tests/experiments/program.h"
#include "tests/experiments/window_rig.h"

namespace palpate::experiments {
namespace {

TEST_F(WindowTest, PointsStandWhereTheModelProjects) {
  show(kWindowWaves);
  window->panel().workspace = false;
  ASSERT_TRUE(window->frame());
  const ColourImage image = window->picture();
  const cloud::Cloud& cloud = shown_cloud();
  int seen_points = 0, painted = 0;
  for (std::size_t i = 0; i < cloud.size(); i += 101) {
    const Pixel at = seen(cloud.point_mm(i));
    ++seen_points;
    painted += is_paper(image.at(static_cast<int>(at.x), static_cast<int>(at.y))) ? 0 : 1;
  }
  EXPECT_EQ(painted, seen_points) << "where a point is, nothing was drawn";
  // And nothing where none is: at places of the picture farther from every point than a splat is wide.
  constexpr double kSplatPx = 16.0;
  std::vector<Pixel> places;
  for (std::size_t i = 0; i < cloud.size(); ++i) places.push_back(seen(cloud.point_mm(i)));
  int stray = 0, empty = 0;
  for (int y = 20; y < image.height; y += 40)
    for (int x = 20; x < static_cast<int>(window->view_width()); x += 40) {
      const bool far = std::none_of(places.begin(), places.end(), [&](const Pixel& p) {
        return std::abs(p.x - x) < kSplatPx && std::abs(p.y - y) < kSplatPx;
      });
      if (!far) continue;
      ++empty;
      stray += is_paper(image.at(x, y)) ? 0 : 1;
    }
  EXPECT_GT(empty, 50);
  EXPECT_EQ(stray, 0);
}

TEST_F(WindowTest, ColoursAreThoseOfWhatWasChosen) {
  show("sinusoid:points=10201:extent_mm=60:wavelength_mm=60:amplitude_mm=6");
  window->panel().workspace = false;
  window->panel().lit = false;
  window->scene().colour(ColourBy::kHeight);
  settle();
  ASSERT_TRUE(window->frame());
  const ColourImage image = window->picture();
  const cloud::Cloud& cloud = shown_cloud();
  const ColourScale& scale = window->scene().scale();
  EXPECT_NEAR(scale.high - scale.low, cloud.box_mm().extent_mm().z(), 1e-4);
  int right = 0, looked = 0;
  for (std::size_t i = 0; i < cloud.size(); i += 97) {
    const Pixel at = seen(cloud.point_mm(i));
    const auto hit = window->scene().splats().at(at.x, at.y);
    // Behind a hill another point is seen.
    if (!hit) continue;
    const Vec3 stands_mm = window->scene().on_surface(*hit, window->camera().eye_mm()).place_mm;
    if ((stands_mm - cloud.point_mm(i)).norm() > 1.5) continue;
    const Rgba expected = ramp((cloud.point_mm(i).z() - scale.low) / (scale.high - scale.low));
    ++looked;
    right += apart(image.at(static_cast<int>(at.x), static_cast<int>(at.y)),
                   {expected[0], expected[1], expected[2]}) < 40.0
                 ? 1
                 : 0;
  }
  EXPECT_GT(looked, 60);
  EXPECT_GT(right, 95 * looked / 100);
  // Points of a formula lie on it: one colour, and no error beyond rounding.
  window->scene().colour(ColourBy::kError);
  settle();
  EXPECT_LT(window->scene().scale().high, 1e-3);
  window->scene().colour(ColourBy::kFile);
  settle();
  EXPECT_FALSE(window->scene().scale().nothing.empty()) << "a generated model has no columns";
}

TEST_F(WindowTest, GoesOnWithThePictureAndBeginsAnewWhenTheCameraMoves) {
  show("sinusoid:points=400000");
  const SplatDrawer& splats = window->scene().splats();
  const std::uint64_t begun = splats.begun();
  Camera camera = window->camera();
  camera.turn(0.1, 0.0);
  window->look_from(camera);
  std::size_t pictures = 0, drawn = 0;
  do {
    ASSERT_TRUE(window->frame());
    ++pictures;
    EXPECT_GT(splats.drawn(), drawn);
    drawn = splats.drawn();
    EXPECT_EQ(splats.begun(), begun + 1);
    EXPECT_EQ(splats.whole_after() > 0, drawn == splats.points());
  } while (drawn < splats.points() && pictures < 1'000);
  EXPECT_GT(pictures, 1u) << "all at once: nothing to go on with";
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(window->frame());
  EXPECT_EQ(splats.whole_after(), pictures) << "nothing moved";
  EXPECT_EQ(splats.begun(), begun + 1);
}

TEST_F(WindowTest, TheMouseHoversPressesAndTheArrowIsTheForce) {
  show(kWindowWaves, kBegun);
  const Vec3 place_mm = shown_cloud().point_mm(5050);
  point_at(place_mm);
  watch(1.0);
  const WatchedTick hovering = window->drawn_tick();
  EXPECT_FALSE(hovering.tick.frame.contact);
  EXPECT_NEAR((hovering.tick.hip_mm - place_mm).norm(), MouseHand::kHoverMm, 0.6)
      << "over the place under the cursor";
  window->mouse_button(Window::Button::kLeft, true);
  watch(1.0);
  const WatchedTick pressing = window->drawn_tick();
  ASSERT_TRUE(pressing.tick.frame.contact);
  const double force_n = pressing.tick.sent_n.norm();
  EXPECT_GT(force_n, 0.2);
  // The same numbers: what a spring of the surface's stiffness gives, through the governor as it stands.
  const double depth_mm = (pressing.tick.frame.god_object_mm - pressing.tick.hip_mm).norm();
  EXPECT_NEAR(force_n, live->session.stiffness_n_per_mm() * depth_mm, 0.02);
  window->panel().workspace = false;
  const ColourImage image = window->picture();
  const Spot arrow = spot_of(image, kForceColour, window->view_width());
  const Pixel god_object = seen(pressing.tick.frame.god_object_mm);
  const Pixel tip = seen(pressing.tick.frame.god_object_mm + pressing.tick.sent_n);
  ASSERT_GT(arrow.count, 30) << "no arrow";
  const double along = std::hypot(tip.x - god_object.x, tip.y - god_object.y);
  const double cosine = ((arrow.x - god_object.x) * (tip.x - god_object.x) +
                         (arrow.y - god_object.y) * (tip.y - god_object.y)) /
                        (along * std::hypot(arrow.x - god_object.x, arrow.y - god_object.y));
  EXPECT_GT(cosine, 0.99) << "the arrow does not point as the force does";
  // The wheel presses deeper, and the force grows.
  window->wheel(4.0);
  watch(0.6);
  EXPECT_GT(drawn().sent_n.norm(), 1.2 * force_n);
  window->mouse_button(Window::Button::kLeft, false);
  watch(0.6);
  EXPECT_FALSE(drawn().frame.contact);
  EXPECT_GT(link.view().felt_s, 0.0) << "the first touch was noticed";
  window->mouse_button(Window::Button::kLeft, true);
  watch(0.6);
}

TEST_F(WindowTest, TheArrowIsSeenFromVeryNear) {
  show(kWindowWaves, kBegun);
  point_at(shown_cloud().point_mm(5050));
  window->mouse_button(Window::Button::kLeft, true);
  watch(1.2);
  // Nothing runs from here on: the eye goes to the contact, and the contact stays.
  const WatchedTick pressing = window->drawn_tick();
  ASSERT_TRUE(pressing.tick.frame.contact);
  const Vec3 god_object_mm = pressing.tick.frame.god_object_mm;
  const Vec3 way = pressing.map.world_n(pressing.tick.sent_n).normalized();
  Camera near = window->camera();
  ASSERT_GT((-near.forward()).dot(way), 0.0) << "the force points towards who looks";
  // The eye just before the god object: the tip is then behind it.
  constexpr double kBeforeRadii = 0.005;
  const double before_mm = kBeforeRadii * near.radius_mm();
  const double beyond_mm = (god_object_mm - near.target_mm()).dot(near.forward());
  ASSERT_LT(beyond_mm, 0.0) << "nearer than what the camera turns about";
  near.zoom(near.distance_mm() / (before_mm - beyond_mm));
  ASSERT_NEAR((god_object_mm - near.eye_mm()).dot(near.forward()), before_mm, 1e-9);
  const Vec3 aside = god_object_mm - near.eye_mm();
  const double pixels = near.pixels_per_mm(window->view_height());
  near.pan(-aside.dot(near.right()) * pixels, aside.dot(near.up()) * pixels, window->view_height());
  window->look_from(near);
  settle();
  ASSERT_TRUE(drawn().frame.contact);
  const Pixel god_object = seen(god_object_mm);
  ASSERT_NEAR(god_object.x, 0.5 * window->view_width(), 1.0);
  ASSERT_NEAR(god_object.y, 0.5 * window->view_height(), 1.0);
  constexpr double kLeastArrowRadii = 0.02;  // of a force of a thirtieth of the limit
  ASSERT_LT((god_object_mm + kLeastArrowRadii * near.radius_mm() * way - near.eye_mm()).dot(near.forward()),
            0.0)
      << "the tip is behind the eye";
  const Spot arrow = spot_of(window->picture(), kForceColour, window->view_width());
  EXPECT_GT(arrow.count, 100) << "the arrow is seen all the same";
  const Pixel along = seen(god_object_mm + 0.1 * before_mm * way);
  EXPECT_GT((arrow.x - god_object.x) * (along.x - god_object.x) +
                (arrow.y - god_object.y) * (along.y - god_object.y),
            0.0)
      << "it goes the way of the force";
}

TEST(SeenLine, IsCutAtTheNearPlaneAndNowhereElse) {
  const Camera camera = Camera::of({Vec3::Constant(-10.0), Vec3::Constant(10.0)});
  constexpr double kWidth = 800.0, kHeight = 600.0;
  const Mat4 clip = camera.clip_from_world(kWidth, kHeight);
  const auto line = [&](const Vec3& a, const Vec3& b) { return project_line(clip, a, b, kWidth, kHeight); };
  const Vec3 eye = camera.eye_mm(), forward = camera.forward(), right = camera.right();
  const Vec3 before = eye + camera.distance_mm() * forward, behind = eye - 5.0 * forward + right;
  const auto whole = line(before, before + right).value();
  EXPECT_FALSE(whole.cut_a || whole.cut_b);
  const Pixel end = *project(clip, before + right, kWidth, kHeight);
  EXPECT_EQ(whole.b.x, end.x);
  EXPECT_EQ(whole.b.y, end.y);
  // One end behind the eye: what is left ends on the near plane, on the same line.
  for (const bool turned : {false, true}) {
    const auto cut = (turned ? line(behind, before) : line(before, behind)).value();
    EXPECT_EQ(cut.cut_a, turned);
    EXPECT_EQ(cut.cut_b, !turned);
    const Pixel& at = turned ? cut.a : cut.b;
    EXPECT_NEAR(at.depth, 0.0, 1e-12);
    const Vec3 place = unproject(clip, at, kWidth, kHeight);
    EXPECT_NEAR((place - before).cross(behind - before).norm() / (behind - before).norm(), 0.0, 1e-9);
    EXPECT_GT((place - eye).dot(forward), 0.0);
    EXPECT_LT((place - eye).dot(forward), camera.distance_mm());
  }
  // Between the eye and the near plane, and behind the eye: nothing is seen.
  EXPECT_FALSE(line(eye + 1e-6 * forward, eye + 2e-6 * forward + right));
  EXPECT_FALSE(line(behind, behind + right));
}

TEST_F(WindowTest, PlotsMoveAndAButtonSwitches) {
  show(kWindowWaves, 1.0);
  const std::size_t samples = window->history().samples().size();
  EXPECT_GT(samples, 990u);
  const ColourImage before = window->picture();
  live->session.hand().aim(Vec3(0.0, 0.0, -4.0));
  run_and_draw(2.0);
  const ColourImage after = window->picture();
  EXPECT_GT(window->history().samples().size(), samples + 1900);
  // The force plot's ink has moved, within the panel.
  const auto ink = [&](const ColourImage& image) {
    std::vector<int> of_column;
    for (int x = static_cast<int>(window->view_width()); x < image.width; ++x) {
      int highest = 0;
      for (int y = 0; y < image.height && highest == 0; ++y)
        if (apart(image.at(x, y), kForceColour) < 12.0) highest = y;
      of_column.push_back(highest);
    }
    return of_column;
  };
  const std::vector<int> first = ink(before), second = ink(after);
  EXPECT_GT(std::count_if(first.begin(), first.end(), [](int y) { return y > 0; }), 20);
  EXPECT_NE(first, second);
  // The second renderer's button.
  ASSERT_EQ(felt().lane, 0);
  live->session.hand().aim(Vec3(0.0, 0.0, 15.0));
  live->run(1.5);
  press('2');
  run_and_draw(1.5);
  EXPECT_EQ(felt().lane, 1);
  // By the mouse, where the button's words are: back to the first.
  bool pressed = false;
  for (int y = 60; y < 260 && !pressed; y += 6) {
    ASSERT_NO_FATAL_FAILURE(click_at(window->view_width() + 100.0, y));
    run_and_draw(0.5);
    pressed = felt().lane == 0;
  }
  EXPECT_TRUE(pressed) << "no button answered the mouse";
}

TEST_F(WindowTest, AFaultIsShownWithItsRemedyAndTheButtonArmsAgain) {
  show(kWindowWaves, kBegun, {"cloud", "cloud-smooth"}, [&] { live->loop().request_rearm(); });
  const ColourImage before = window->picture();
  tick_late();
  ASSERT_EQ(drawn().fault, device::Fault::kLate);
  ASSERT_TRUE(window->frame());
  const ColourImage faulted = window->picture();
  if (!picture_folder().empty()) (void)write_png(faulted, picture_folder() + "/fault.png");
  const auto red = [](const ColourImage& image) {
    const std::uint8_t* pixel = image.at(500, 8);
    return pixel[0] > 100 && pixel[1] < 60;
  };
  EXPECT_FALSE(red(before));
  EXPECT_TRUE(red(faulted)) << "no banner";
  // Its button is the only one over the cloud.
  bool armed = false;
  for (int y = 30; y < 90 && !armed; y += 8) {
    ASSERT_NO_FATAL_FAILURE(click_at(60.0, y));
    run_and_draw(0.1);
    armed = drawn().fault == device::Fault::kNone;
  }
  EXPECT_TRUE(armed);
  for (int fault = 1; fault <= static_cast<int>(device::Fault::kOutOfRange); ++fault)
    EXPECT_STRNE(fault_remedy(static_cast<device::Fault>(fault)), "");
}

/// Whether the cells that the way into the surface crosses are asked for, or what is near.
class WindowNear : public WindowTest, public testing::WithParamInterface<bool> {};

TEST_P(WindowNear, IsShownAboutTheTouchedPlaceOnRequest) {
  const bool cells = GetParam();
  show("sinusoid:points=2601:extent_mm=60:wavelength_mm=60:amplitude_mm=3", kBegun,
       {cells ? "cloud-vertices" : "cloud"});
  live->session.hand().aim(Vec3(2.0, 3.0, -4.0));
  live->run(1.0);
  window->panel().workspace = false;
  ASSERT_TRUE(window->frame());
  ASSERT_TRUE(drawn().frame.contact);
  const auto shown = [&] {
    return spot_of(window->picture(), cells ? kCellColour : kNearColour, window->view_width());
  };
  EXPECT_EQ(shown().count, 0);
  window->panel().near = {!cells, !cells, !cells, cells};
  for (int i = 0; i < (cells ? 5 : 50); ++i) {
    ASSERT_TRUE(window->frame());
    settle();
  }
  const Spot spot = shown();
  const Pixel god_object = seen(drawn().frame.god_object_mm);
  ASSERT_GT(spot.count, cells ? 40 : 30);
  EXPECT_LT(std::hypot(spot.x - god_object.x, spot.y - god_object.y), cells ? 60.0 : 25.0);
}

INSTANTIATE_TEST_SUITE_P(Cells, WindowNear, testing::Bool());

TEST_F(WindowTest, TheServoTicksOnWhileTheWindowStandsStill) {
  MonotonicClock clock;
  WindowSession session(kWindowWaves, {"cloud"}, clock);
  device::ServoThreadOptions options;
  options.free_mm = Vec3(0.0, 0.0, 10.0);
  const std::vector<device::TickObserver*> observers = {&session.feed()};
  auto thread = device::ServoThread::create(session.servo(), clock, options, observers).value();
  ASSERT_TRUE(thread->start().ok());
  session.show_in(link, [&] { thread->request_rearm(); });
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(window->frame());
  const std::uint64_t before = session.feed().ticks(), drawn = window->drawn_tick().ticks;
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // the window's thread stands still
  const std::uint64_t after = session.feed().ticks();
  const device::LoopStatistics loop = thread->histograms().statistics();
  EXPECT_EQ(window->drawn_tick().ticks, drawn);
  // Each of the 300 periods was either ticked or, on a machine that gave it no time, counted as missed.
  EXPECT_GE(after - before + loop.missed, 280u);
  EXPECT_GT(after - before, 0u);
  ASSERT_TRUE(window->frame());
  EXPECT_GE(window->drawn_tick().ticks, after) << "the newest tick is shown, not one of the past";
  EXPECT_EQ(session.feed().samples().lost(), 0u) << "a moment fits into the ring";
  link.ended();
  thread->stop();
}

TEST(HandGuide, FollowsSmoothlyAndNoFasterThanAHand) {
  using device::HandGuide;
  HandGuide guide(Vec3::Zero());
  guide.aim(Vec3(100.0, 0.0, 0.0));
  double last_mm = 0.0;
  for (int ms = 1; ms <= 1'000; ++ms) {
    const device::Goal goal = guide.at(1e-3 * ms);
    EXPECT_GE(goal.position_mm.x(), last_mm) << "never back";
    EXPECT_LE(goal.position_mm.x() - last_mm, 1e-3 * HandGuide::kFastestMmS + 1e-12);
    EXPECT_LE(goal.velocity_mm_s.norm(), HandGuide::kFastestMmS + 1e-9);
    last_mm = goal.position_mm.x();
  }
  EXPECT_NEAR(last_mm, 100.0, 1e-3) << "it arrives";
  // What is no place is not gone to, and a pause is no jump.
  guide.aim(Vec3(std::nan(""), 0.0, 0.0));
  EXPECT_EQ(guide.at(1.1).position_mm.x(), last_mm);
  guide.aim(Vec3::Zero());
  EXPECT_GE(guide.at(60.0).position_mm.x(), last_mm - HandGuide::kFastestMmS * HandGuide::kLongestS);
  // A new session begins at 0 where the hand is.
  const double there_mm = guide.at(60.001).position_mm.x();
  EXPECT_EQ(guide.at(0.0).position_mm.x(), there_mm);
}

class LiveInAWindow : public OnCommandLine {
 protected:
  const Words line = words("live", kWindowWaves, "--renderers cloud --out", in("out"));
};

TEST_F(LiveInAWindow, OpensPreparesTouchesAndEndsByItself) {
  {
    SessionLink link;
    const auto window = Window::open(link, {});
    if (!window) GTEST_SKIP() << window.error().message();
  }
  const ProcessOutcome run = palpate_process(words(line, "--window --hand press --seconds 2 --rearm"));
  ASSERT_TRUE(ended_well(run.exit_code, in("out/live.json"))) << run.err;
  EXPECT_NE(run.err.find("touchable after"), std::string::npos) << run.err;
  EXPECT_NE(run.err.find("first touch after"), std::string::npos) << run.err;
  EXPECT_NE(text_in("out/live.json").find("\"hand\": \"press\""), std::string::npos);
}
TEST_F(LiveInAWindow, WhatCannotBeIsRefusedWithAReason) {
  refuses("--accelerated", line, "--window --accelerated");
  refuses("--window", line, "--hand mouse");
}

TEST(WindowFeed, LosesSamplesAndNothingElseWhereNobodyReads) {
  VirtualSession virtual_session(kWindowWaves, {"cloud"});
  virtual_session.run(20.0);
  WindowFeed& feed = virtual_session.session.feed();
  EXPECT_EQ(feed.ticks(), 20'001u);
  EXPECT_EQ(feed.samples().lost(), 20'001u - SampleRing::kSize);
  ASSERT_TRUE(feed.acquire());
  EXPECT_EQ(feed.newest().ticks, 20'001u);
  std::vector<TickSample> samples;
  EXPECT_EQ(feed.samples().drain(samples), SampleRing::kSize);
  for (std::size_t i = 1; i < samples.size(); ++i) ASSERT_GT(samples[i].t_s, samples[i - 1].t_s);
}

}  // namespace
}  // namespace palpate::experiments
