// The window as a person sees it: input is put in, the picture is read back and compared by what is in it.
#include "experiments/window/window.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <thread>

#include "device/servo/servo_thread.h"
#include "experiments/window/mouse_hand.h"
#include "experiments/window/overlay.h"
#include "experiments/window/screenshot.h"
#include "tests/experiments/window_rig.h"

namespace palpate::experiments {
namespace {

const char* const kWaves = "sinusoid:points=10201:extent_mm=60:wavelength_mm=30:amplitude_mm=3";

/// Where tests leave their pictures for people; empty: nowhere.
std::string picture_folder() {
  const char* folder = std::getenv("PALPATE_PICTURES");
  return folder != nullptr ? folder : "";
}

class WindowTest : public testing::Test {
 protected:
  void SetUp() override {
    WindowOptions options;
    options.paced = false;
    auto opened = Window::open(link, options);
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
  void point_at(const Vec3& world_mm) {
    const Pixel at = seen(world_mm);
    window->mouse_at(at.x, at.y);
  }

  SessionLink link;
  std::unique_ptr<Window> window;
};

bool is_paper(const std::uint8_t* pixel) {
  return pixel[0] < 60 && pixel[1] < 65 && pixel[2] < 70;
}

double apart(const std::uint8_t* pixel, const std::array<std::uint8_t, 3>& colour) {
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
Spot spot_of(const ColourImage& image, const std::array<std::uint8_t, 3>& colour, double width) {
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

TEST_F(WindowTest, PointsStandWhereTheModelProjects) {
  VirtualSession virtual_session(kWaves);
  virtual_session.session.show_in(link);
  settle();
  window->panel().workspace = false;
  ASSERT_TRUE(window->frame());
  const ColourImage image = window->picture();
  const cloud::Cloud& cloud = *virtual_session.session.input().models.front().cloud;
  int seen_points = 0, painted = 0;
  for (std::size_t i = 0; i < cloud.size(); i += 101) {
    const Pixel at = seen(cloud.point_mm(i));
    ++seen_points;
    painted += is_paper(image.at(static_cast<int>(at.x), static_cast<int>(at.y))) ? 0 : 1;
  }
  EXPECT_EQ(painted, seen_points) << "where a point is, nothing was drawn";
  // And nothing where none is: beyond the box.
  int stray = 0, empty = 0;
  const geometry::Aabb box = window->scene().box_mm();
  for (int k = 0; k < 40; ++k) {
    const double turn = 2.0 * 3.14159265358979 * k / 40.0;
    const Pixel at = seen(box.centre_mm() +
                          1.05 * window->scene().radius_mm() * Vec3(std::cos(turn), std::sin(turn), 0.0));
    if (at.x < 1 || at.y < 1 || at.x >= window->view_width() - 1 || at.y >= window->view_height() - 1)
      continue;
    ++empty;
    stray += is_paper(image.at(static_cast<int>(at.x), static_cast<int>(at.y))) ? 0 : 1;
  }
  EXPECT_GT(empty, 10);
  EXPECT_EQ(stray, 0);
}

TEST_F(WindowTest, GoesOnWithThePictureAndBeginsAnewWhenTheCameraMoves) {
  VirtualSession virtual_session("sinusoid:points=400000");
  virtual_session.session.show_in(link);
  ASSERT_TRUE(window->frame());
  const SplatDrawer& splats = window->scene().splats();
  const std::size_t first = splats.drawn();
  EXPECT_GT(first, 0u);
  EXPECT_LT(first, splats.points()) << "all at once: nothing to go on with";
  ASSERT_TRUE(window->frame());
  EXPECT_GT(splats.drawn(), first);
  settle();
  const std::uint64_t begun = splats.begun();
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(window->frame());
  EXPECT_EQ(splats.begun(), begun) << "nothing moved";
  Camera camera = window->camera();
  camera.turn(0.1, 0.0);
  window->look_from(camera);
  ASSERT_TRUE(window->frame());
  EXPECT_EQ(splats.begun(), begun + 1);
  EXPECT_LT(splats.drawn(), splats.points());
}

TEST_F(WindowTest, TheMouseHoversPressesAndTheArrowIsTheForce) {
  VirtualSession virtual_session(kWaves);
  WindowSession& session = virtual_session.session;
  session.show_in(link);
  virtual_session.run(0.6);  // the governor's soft start
  settle();
  const Vec3 place_mm = session.input().models.front().cloud->point_mm(5050);
  point_at(place_mm);
  const auto live = [&](double seconds) {
    for (double t = 0.0; t < seconds; t += 0.02) {
      virtual_session.run(0.02);
      ASSERT_TRUE(window->frame());
    }
  };
  live(1.0);
  const WatchedTick hovering = window->drawn_tick();
  EXPECT_FALSE(hovering.tick.frame.contact);
  EXPECT_NEAR((hovering.tick.hip_mm - place_mm).norm(), MouseHand::kHoverMm, 0.6)
      << "over the place under the cursor";
  window->mouse_button(Window::Button::kLeft, true);
  live(1.0);
  const WatchedTick pressing = window->drawn_tick();
  ASSERT_TRUE(pressing.tick.frame.contact);
  const double force_n = pressing.tick.sent_n.norm();
  EXPECT_GT(force_n, 0.2);
  // The same numbers: what a spring of the surface's stiffness gives, through the governor as it stands.
  EXPECT_NEAR(
      force_n,
      session.stiffness_n_per_mm() * (pressing.tick.frame.god_object_mm - pressing.tick.hip_mm).norm(), 0.02);
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
  live(0.6);
  EXPECT_GT(window->drawn_tick().tick.sent_n.norm(), 1.2 * force_n);
  window->mouse_button(Window::Button::kLeft, false);
  live(0.6);
  EXPECT_FALSE(window->drawn_tick().tick.frame.contact);
  EXPECT_GT(link.view().felt_s, 0.0) << "the first touch was noticed";
  window->mouse_button(Window::Button::kLeft, true);
  live(0.6);
}

}  // namespace
}  // namespace palpate::experiments
