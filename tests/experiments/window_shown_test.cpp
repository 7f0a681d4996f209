// What the window shows beyond points and contact: errors against the truth, dents, cells, other axes up.

#include "experiments/window/overlay.h"
#include "experiments/window/window.h"
#include "tests/experiments/program.h"
#include "tests/experiments/window_rig.h"
#include "toolkit/deformation/deformer.h"

namespace palpate::experiments {
namespace {

using WindowShows = WindowTest;

TEST_F(WindowShows, ErrorsInRedAboveTheTruthAndInBlueBelow) {
  constexpr float kOffMm = 0.3f;
  render::ModelInput model =
      loaded_scene("sinusoid:points=10201:extent_mm=60:wavelength_mm=60:amplitude_mm=2").input.models.front();
  auto cloud = std::make_shared<cloud::Cloud>(*model.cloud);
  for (std::size_t i = 0; i < cloud->size(); ++i) cloud->z_mm[i] += cloud->x_mm[i] > 0.0f ? kOffMm : -kOffMm;
  model.cloud = cloud;
  link.show(std::make_shared<const ShownScene>(ShownScene{"off", {model}}));
  ASSERT_TRUE(window->frame());
  window->panel().lit = false;
  window->scene().colour(ColourBy::kError);
  settle();
  ASSERT_TRUE(window->frame());
  EXPECT_NEAR(window->scene().scale().high, static_cast<double>(kOffMm), 0.02);
  EXPECT_NEAR(window->scene().scale().low, -window->scene().scale().high, 1e-12);
  const ColourImage image = window->picture();
  int above = 0, red = 0, below = 0, blue = 0;
  for (std::size_t i = 0; i < cloud->size(); i += 53) {
    const Vec3 at_mm = cloud->point_mm(i);
    if (std::abs(at_mm.x()) < 4.0) continue;
    const Pixel at = seen(at_mm);
    const std::uint8_t* pixel = image.at(static_cast<int>(at.x), static_cast<int>(at.y));
    (at_mm.x() > 0.0 ? above : below) += 1;
    red += at_mm.x() > 0.0 && pixel[0] > pixel[2] + 60 ? 1 : 0;
    blue += at_mm.x() < 0.0 && pixel[2] > pixel[0] + 60 ? 1 : 0;
  }
  EXPECT_GT(above, 60);
  EXPECT_GT(below, 60);
  EXPECT_GT(red, 95 * above / 100);
  EXPECT_GT(blue, 95 * below / 100);
}

class WindowDents : public WindowShows {
 protected:
  void SetUp() override {
    WindowShows::SetUp();
    scene_ = testing::TempDir() + "/palpate-window-dents-" + std::to_string(::getpid()) + ".toml";
    write_text(scene_,
               "[[model]]\ngenerate = \"sinusoid\"\npoints = 10201\nextent_mm = 60\nwavelength_mm = 60\n"
               "amplitude_mm = 1\n  [model.surface]\n  stiffness_n_per_mm = 0.5\n  dent = { yield_mm = 0.3, "
               "radius_mm = "
               "4, rate_mm_s = 20 }\n");
  }
  void TearDown() override {
    WindowShows::TearDown();
    std::filesystem::remove(scene_);
  }
  std::string scene_;
};

TEST_F(WindowDents, PointsThatGaveWayStandWhereTheyAreAndGoBack) {
  live = std::make_unique<VirtualSession>(scene_, std::vector<std::string>{"cloud"});
  live->session.show_in(link);
  live->run(kBegun);
  // From above: a dent hides its ground from who looks along the surface.
  ASSERT_TRUE(window->frame());
  Camera camera = window->camera();
  camera.turn(0.0, 0.9);
  window->look_from(camera);
  settle();
  window->panel().workspace = false;
  const Vec3 place_mm = shown_cloud().point_mm(5050);
  const Pixel at = seen(place_mm);
  ASSERT_TRUE(window->scene().splats().at(at.x, at.y));
  EXPECT_EQ(window->scene().shifted(), 0u);
  window->mouse_at(window->view_width() + 50.0, 5.0);  // away: the hand is this test's
  live->session.hand().aim(place_mm - Vec3{0.0, 0.0, 6.0});
  for (int i = 0; i < 40; ++i) run_and_draw(0.05);
  ASSERT_TRUE(drawn().frame.contact);
  live->session.hand().aim(place_mm + Vec3{0.0, 0.0, 10.0});
  live->run(1.0);
  for (int i = 0; i < 10; ++i) run_and_draw(0.01);
  settle();
  EXPECT_GT(window->scene().shifted(), 20u);
  // Every one where the renderer has it, and in the picture by the depth that was drawn.
  const auto* editable = dynamic_cast<const deformation::Editable*>(felt().renderer);
  ASSERT_NE(editable, nullptr);
  const cloud::Cloud& cloud = shown_cloud();
  std::size_t moved = 0;
  double deepest_mm = 0.0;
  std::uint32_t deepest = 0;
  for (std::uint32_t i = 0; i < cloud.size(); ++i) {
    const double away_mm = (*editable->point_position_mm(0, i) - cloud.local_mm(i)).norm();
    moved += away_mm > 0.0 ? 1u : 0u;
    if (away_mm <= deepest_mm) continue;
    deepest_mm = away_mm;
    deepest = i;
  }
  EXPECT_GT(deepest_mm, 0.5);
  EXPECT_GE(window->scene().shifted(), moved * 9 / 10);
  const Vec3 now_mm = cloud.origin_mm + *editable->point_position_mm(0, deepest);
  const Pixel there = seen(now_mm);
  const auto hit = window->scene().splats().at(there.x, there.y).value();
  EXPECT_LT((hit.place_mm - now_mm).norm(), 0.5 * deepest_mm) << "the picture has it where it was";
  // What is taken back is seen to go.
  const_cast<deformation::Editable*>(editable)->restore(0);
  for (int i = 0; i < 100 && window->scene().shifted() > 0; ++i) run_and_draw(0.01);
  EXPECT_EQ(window->scene().shifted(), 0u);
}

int ink_in(const ColourImage& image, const std::array<std::uint8_t, 3>& colour, int left, int top, int right,
           int bottom) {
  int count = 0;
  for (int y = std::max(0, top); y < std::min(bottom, image.height); ++y)
    for (int x = std::max(0, left); x < std::min(right, image.width); ++x)
      count += apart(image.at(x, y), colour) <= 2.0 ? 1 : 0;
  return count;
}

TEST_F(WindowShows, WhatHomesTheDeviceOverEverythingElse) {
  std::string prompt =
      "Pull the grip all the way out, slowly, and push it back in (0 of 3 legs know their zero)";
  show("sinusoid:points=10201:extent_mm=60", kBegun, {"cloud"}, {}, [&] { return prompt; });
  tick_late();  // with a fault's banner too: what homes comes first
  ASSERT_TRUE(window->frame());
  EXPECT_EQ(window->panel().homing, prompt);
  const ColourImage asked = window->picture();
  const int wide = static_cast<int>(window->view_width()), high = asked.height;
  const Spot paper = spot_of(asked, kHomingPaper, window->view_width());
  EXPECT_GT(paper.count, 50'000) << "big";
  EXPECT_NEAR(paper.x, 0.5 * wide, 30.0) << "in the middle of the cloud";
  EXPECT_NEAR(paper.y, 0.5 * high, 60.0);
  // Nothing of the cloud within it, and letters.
  const int left = wide / 2 - 200, right = wide / 2 + 200, top = high / 2 - 20, bottom = high / 2 + 20;
  EXPECT_GT(ink_in(asked, {255, 255, 255}, left, top, right, bottom), 300) << "no letters";
  int strange = 0;  // paper and letters are bluish or white; the cloud is ivory, the banner red
  for (int y = top; y < bottom; ++y)
    for (int x = left; x < right; ++x) {
      const std::uint8_t* pixel = asked.at(x, y);
      strange += pixel[2] < pixel[1] || pixel[1] < pixel[0] ? 1 : 0;
    }
  EXPECT_EQ(strange, 0) << "something else shows through";
  prompt.clear();
  ASSERT_TRUE(window->frame());
  EXPECT_TRUE(window->panel().homing.empty());
  EXPECT_EQ(spot_of(window->picture(), kHomingPaper, window->view_width()).count, 0);
  link.ended();
  EXPECT_TRUE(link.homing_prompt().empty());
}

/// The colours of the plots.
constexpr std::array<std::uint8_t, 3> kLimitLine = {255, 90, 80}, kPlotLetters = {150, 160, 175};

TEST_F(WindowShows, TheLimitsLineTouchesNoLabel) {
  show("sinusoid:points=10201:extent_mm=60", kBegun, {"cloud"});
  // As far as the governor lets it.
  live->session.hand().aim(Vec3(0.0, 0.0, -25.0));
  run_and_draw(1.5);
  const ColourImage image = window->picture();
  const int left = static_cast<int>(window->view_width());
  int line = -1;
  for (int y = 0; y < image.height && line < 0; ++y)
    if (ink_in(image, kLimitLine, left, y, image.width, y + 1) > 200) line = y;
  ASSERT_GT(line, 0) << "the force never reached the limit";
  const int above = ink_in(image, kPlotLetters, left + 8, line - 18, left + 70, line - 1);
  EXPECT_GT(above, 20) << "no label above the line";
  EXPECT_EQ(ink_in(image, kPlotLetters, left + 8, line - 1, left + 70, line + 2), 0)
      << "the label touches it";
  EXPECT_EQ(ink_in(image, kPlotLetters, left + 8, line + 2, left + 70, line + 12), 0);
}

class SmallWindow : public WindowShows {
 protected:
  SmallWindow() {
    window_options.width = 900;
    window_options.height = 600;
  }
};

TEST_F(SmallWindow, HasAllOfThePanel) {
  live = std::make_unique<VirtualSession>("sinusoid:points=10201:extent_mm=60");
  live->session.show_in(link);
  live->run(kBegun);
  window->scene().colour(ColourBy::kHeight);
  settle();
  live->session.hand().aim(Vec3(0.0, 0.0, -25.0));
  run_and_draw(1.5);
  ASSERT_TRUE(window->frame());
  EXPECT_LE(window->panel().bottom, 600.0) << "something has to be scrolled to";
  EXPECT_GT(window->panel().bottom, 450.0);
  EXPECT_LE(window->panel().right, 900.0) << "something is cut off";
  for (const char* words :
       {"Next", "Record", "Mark", "Change", "Screenshot", "sound", "cells", "workspace"}) {
    const auto at = window->place_of(words);
    ASSERT_TRUE(at) << words;
    EXPECT_LT((*at)[1], 600.0) << words;
  }
  // A banner's words wrap: nothing of it is under the panel.
  tick_late();
  ASSERT_TRUE(window->frame());
  ASSERT_EQ(drawn().fault, device::Fault::kLate);
}

TEST_F(WindowShows, TheColoursBesideTheirNumbers) {
  show("sinusoid:points=10201:extent_mm=60:amplitude_mm=5", 0.0, {"cloud"});
  const int left = static_cast<int>(window->view_width());
  const auto has = [&](double share) {
    const Rgba ink = ramp(share);
    const ColourImage image = window->picture();
    return ink_in(image, {ink[0], ink[1], ink[2]}, left, 0, image.width, image.height) > 20;
  };
  EXPECT_FALSE(has(0.5 / 64) && has(63.5 / 64));
  window->scene().colour(ColourBy::kHeight);
  settle();
  ASSERT_TRUE(window->frame());
  EXPECT_TRUE(has(0.5 / 64)) << "the lowest colour";
  EXPECT_TRUE(has(63.5 / 64)) << "the highest colour";
}

TEST_F(WindowShows, AnyAxisUp) {
  show(kWindowWaves, 0.0, {"cloud"});
  const std::vector<Vec3> axes = {Vec3::UnitZ(),  Vec3::UnitY(),  Vec3::UnitX(),
                                  -Vec3::UnitZ(), -Vec3::UnitY(), -Vec3::UnitX()};
  const cloud::Cloud& cloud = shown_cloud();
  for (std::size_t k = 0; k < axes.size(); ++k) {
    ASSERT_EQ(window->camera().up_axis(), kUps[k]);
    EXPECT_EQ(up_named(up_name(kUps[k])), kUps[k]);
    const Camera& camera = window->camera();
    EXPECT_GT(camera.up().dot(axes[k]), 0.8);
    EXPECT_NEAR(camera.right().dot(axes[k]), 0.0, 1e-12) << "level";
    EXPECT_NEAR(camera.right().cross(camera.forward()).dot(camera.up()), 1.0, 1e-12) << "no mirror";
    settle();
    const ColourImage image = window->picture();
    int painted = 0, looked = 0;
    for (std::size_t i = 0; i < cloud.size(); i += 211) {
      const Pixel at = seen(cloud.point_mm(i));
      ++looked;
      painted += is_paper(image.at(static_cast<int>(at.x), static_cast<int>(at.y))) ? 0 : 1;
    }
    EXPECT_GE(painted, looked * 9 / 10) << up_name(kUps[k]);
    press('U');
  }
  EXPECT_EQ(window->camera().up_axis(), Up::kZ) << "once round";
  EXPECT_FALSE(up_named("w"));
}

// ---- Pictures of the window on the dragon, for docs/how-to/feel-live.md: made where PALPATE_PICTURES names
// a folder and PALPATE_DATA has the scans.

class WindowPictures : public WindowTest {
 protected:
  void SetUp() override {
    const char* data = std::getenv("PALPATE_DATA");
    folder_ = std::string(data != nullptr ? data : "") + "/stanford/";
    if (picture_folder().empty() || !std::filesystem::exists(folder_ + "dragon_vrip.ply.gz"))
      GTEST_SKIP() << "needs PALPATE_PICTURES, and PALPATE_DATA with the dragon";
    std::filesystem::current_path(testing::TempDir());  // so that the title says no folder
    WindowTest::SetUp();
  }
  void TearDown() override {}
  /// The dragon in mm as a scene file.
  std::string dragon(const std::string& file) {
    const std::string path = std::string("dragon.toml");
    write_text(path, "[[model]]\ncloud = \"" + folder_ + file +
                         "\"\nunit = \"m\"\n  [model.surface]\n  stiffness_n_per_mm = 0.5\n");
    return path;
  }
  void stand_before() {
    Camera camera = Camera::of(window->scene().box_mm(), Up::kY);
    camera.turn(0.35, -0.3);
    camera.zoom(1.35);
    window->look_from(camera);
  }
  void keep(const char* name) {
    ASSERT_TRUE(window->screenshot(picture_folder() + "/window-" + name + ".png").ok());
  }

  std::string folder_;
};

TEST_F(WindowPictures, OnTheDragon) {
  const Vec3 free_mm{-6.0, 125.0, 46.0};
  live = std::make_unique<VirtualSession>(dragon("dragon_vrip.ply.gz"),
                                          std::vector<std::string>{"cloud", "cloud-smooth"}, free_mm, true);
  live->session.show_in(link, [&] { live->loop().request_rearm(); });
  watch(1.0);
  stand_before();
  window->panel().workspace = false;
  settle();
  const double x = 0.6 * window->view_width(), y = 0.4 * window->view_height();
  window->mouse_at(x, y);
  watch(2.0);
  window->mouse_button(Window::Button::kLeft, true);
  watch(0.8);
  window->wheel(2.0);
  watch(1.5);
  EXPECT_TRUE(drawn().frame.contact);
  settle();
  keep("points");
  // Under one hand, in contact: half of a fade.
  press('2');
  for (int ms = 0; ms < 400 && window->drawn_tick().mixed.state != device::MixState::kFading; ++ms)
    run_and_draw(0.001);
  run_and_draw(0.07);
  EXPECT_EQ(window->drawn_tick().mixed.state, device::MixState::kFading);
  settle();
  keep("fade");
  watch(1.0);
  // From near, what is about the touched place. The hand stays there, whatever the mouse is over.
  const WatchedTick touching = window->drawn_tick();
  const Vec3 place_mm = touching.tick.frame.god_object_mm;
  window->mouse_button(Window::Button::kLeft, false);
  window->mouse_at(window->view_width() + 50.0, 5.0);
  watch(0.1);
  live->session.hand().aim(
      touching.map.device_mm(place_mm - 6.0 * touching.map.world_n(touching.tick.sent_n).normalized()));
  watch(0.8);
  Camera near = window->camera();
  const Pixel centre = seen(drawn().frame.god_object_mm);
  near.pan(0.5 * window->view_width() - centre.x, 0.5 * window->view_height() - centre.y,
           window->view_height());
  near.zoom(22.0);
  window->look_from(near);
  window->panel().near.boxes = window->panel().near.facets = true;
  for (int i = 0; i < 50; ++i) settle();
  watch(0.5);
  settle();
  EXPECT_TRUE(drawn().frame.contact);
  keep("near");
  window->panel().near = {};
  stand_before();
  watch(0.5);
  tick_late();
  settle();
  EXPECT_EQ(drawn().fault, device::Fault::kLate);
  keep("fault");
}

/// The dragon of 100 thousand points against the faces of the one of 437 thousand.
TEST_F(WindowPictures, ErrorsOfACoarserDragon) {
  render::ModelInput model = loaded_scene(dragon("dragon_vrip_res2.ply.gz")).input.models.front();
  model.original_mesh = loaded_scene(dragon("dragon_vrip.ply.gz")).input.models.front().original_mesh;
  link.show(std::make_shared<const ShownScene>(
      ShownScene{"dragon_vrip_res2 against the faces of dragon_vrip", {model}}));
  ASSERT_TRUE(window->frame());
  stand_before();
  window->scene().colour(ColourBy::kError);
  settle();
  ASSERT_TRUE(window->frame());
  keep("errors");
}

}  // namespace
}  // namespace palpate::experiments
