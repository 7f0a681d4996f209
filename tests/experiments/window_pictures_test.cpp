// Pictures of the window on the dragon, for docs/how-to/feel-live.md: made where PALPATE_PICTURES names a
// folder and PALPATE_DATA has the scans.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/experiments/program.h"
#include "tests/experiments/window_rig.h"

namespace palpate::experiments {
namespace {

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
  VirtualSession live(dragon("dragon_vrip.ply.gz"), {"cloud", "cloud-smooth"}, free_mm, true);
  live.session.show_in(link, [&] { live.loop().request_rearm(); });
  const auto run = [&](double seconds) {
    for (double t = 0.0; t < seconds; t += 0.02) {
      live.run(0.02);
      ASSERT_TRUE(window->frame());
    }
  };
  run(1.0);
  stand_before();
  window->panel().workspace = false;
  settle();
  const double x = 0.6 * window->view_width(), y = 0.4 * window->view_height();
  window->mouse_at(x, y);
  run(2.0);
  window->mouse_button(Window::Button::kLeft, true);
  run(0.8);
  window->wheel(2.0);
  run(1.5);
  EXPECT_TRUE(window->drawn_tick().tick.frame.contact);
  settle();
  keep("points");
  // Under one hand, in contact: half of a fade.
  window->key('2', true);
  window->key('2', false);
  for (int ms = 0; ms < 400 && window->drawn_tick().mixed.state != device::MixState::kFading; ++ms) {
    live.run(0.001);
    ASSERT_TRUE(window->frame());
  }
  live.run(0.07);
  ASSERT_TRUE(window->frame());
  EXPECT_EQ(window->drawn_tick().mixed.state, device::MixState::kFading);
  settle();
  keep("fade");
  run(1.0);
  // From near, what is about the touched place. The hand stays there, whatever the mouse is over.
  const WatchedTick touching = window->drawn_tick();
  const Vec3 place_mm = touching.tick.frame.god_object_mm;
  window->mouse_button(Window::Button::kLeft, false);
  window->mouse_at(window->view_width() + 50.0, 5.0);
  run(0.1);
  live.session.hand().aim(
      touching.map.device_mm(place_mm - 6.0 * touching.map.world_n(touching.tick.sent_n).normalized()));
  run(0.8);
  Camera near = window->camera();
  const Pixel centre = seen(window->drawn_tick().tick.frame.god_object_mm);
  near.pan(0.5 * window->view_width() - centre.x, 0.5 * window->view_height() - centre.y,
           window->view_height());
  near.zoom(22.0);
  window->look_from(near);
  window->panel().near.boxes = window->panel().near.facets = true;
  for (int i = 0; i < 50; ++i) settle();
  run(0.5);
  settle();
  EXPECT_TRUE(window->drawn_tick().tick.frame.contact);
  keep("near");
  window->panel().near = {};
  stand_before();
  run(0.5);
  live.clock.advance(0.1);
  live.loop().tick();
  ASSERT_TRUE(window->frame());
  settle();
  EXPECT_EQ(window->drawn_tick().tick.fault, device::Fault::kLate);
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
