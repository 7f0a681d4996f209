// Control around a renderer: only what is asked for, in the order written, the force limit last.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <typeinfo>

#include "tests/stepped.h"
#include "tests/toolkit/control/wall.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/core/random.h"

namespace palpate::control {
namespace {

constexpr double kWrapDt = 1e-3;

ControlOptions options(bool couple, bool filter, bool passive) {
  ControlOptions o;
  if (couple) o.coupling = Coupling{0.5, 0.0};
  if (filter) o.filter.rate_limit_n_per_s = 50.0;
  if (passive) o.passivity = PassivityOptions{};
  return o;
}

test::Stepped prepared(const ControlOptions& o, double limit_n = 0.0, double out_stiffness = 0.5) {
  auto wall = std::make_unique<Wall>();
  wall->out_stiffness_n_per_mm = out_stiffness;
  test::Stepped renderer(wrap(std::move(wall), o));
  render::SceneInput scene;
  scene.force_limit_n = limit_n;
  EXPECT_TRUE(renderer->prepare(scene, {}));
  renderer->restart(Vec3(0, 0, 1));
  return renderer;
}

TEST(Wrap, NothingAskedForIsTheRendererItself) {
  auto wall = std::make_unique<Wall>();
  const render::HapticRenderer* const inner = wall.get();
  const auto same = wrap(std::move(wall), {});
  EXPECT_EQ(same.get(), inner);
  const render::HapticRenderer& r = *same;
  EXPECT_EQ(typeid(r), typeid(Wall));
}

/// Every combination against the stages called by hand.
TEST(Wrap, ComposesWhatIsAskedForInOrder) {
  for (int set = 1; set < 8; ++set) {
    const ControlOptions o = options((set & 1) != 0, (set & 2) != 0, (set & 4) != 0);
    const auto renderer = prepared(o, 0.8, 1.5);
    Wall wall;
    wall.out_stiffness_n_per_mm = 1.5;
    VirtualCoupling coupling(o.coupling.value_or(Coupling{}));
    ForceFilter filter(o.filter);
    PassivityController controller(o.passivity.value_or(PassivityOptions{}));
    wall.restart(Vec3(0, 0, 1), 0.0);
    Random random(51);
    double z = 1.0, t_s = 0.0;
    for (int i = 0; i < 3000; ++i) {
      // As the renderer counts it: the difference of two times.
      const double last_s = t_s;
      t_s += kWrapDt;
      const double dt_s = t_s - last_s;
      z = std::clamp(z + random.uniform(-0.1, 0.1), -3.0, 1.0);
      const Vec3 hip(0.01 * i, 0, z);
      render::Frame expected = wall.step(hip, t_s);
      Vec3 f = expected.force_n;
      if (o.coupling) f = coupling.couple(hip, expected.god_object_mm, f, expected.contact, dt_s);
      if (o.filter.any()) f = filter.filter(f, dt_s);
      f = o.passivity ? controller.control(hip, f, dt_s, 0.8) : render::limited(f, 0.8);
      const render::Frame frame = renderer->step(hip, kWrapDt);
      ASSERT_EQ(frame.force_n, f) << "set " << set << ", frame " << i;
      ASSERT_EQ(frame.contact, expected.contact);
      ASSERT_EQ(frame.god_object_mm, expected.god_object_mm);
      ASSERT_EQ(frame.model, expected.model);
      ASSERT_LE(frame.force_n.norm(), 0.8 * (1 + 1e-12));
    }
    EXPECT_EQ(renderer->counters().frames, 3000u);
  }
}

TEST(Wrap, TheLimitIsAppliedAfterTheCouplingSawTheTrueStiffness) {
  // 10 mm of 0.5 N/mm behind 0.5 N/mm are 2.5 N; a renderer that limits to 1 N first would give 0.83.
  const auto renderer = prepared(options(true, false, false), 2.0);
  EXPECT_NEAR(renderer->step(Vec3(0, 0, -10), kWrapDt).force_n.z(), 2.0, 1e-15);
  EXPECT_NEAR(renderer->step(Vec3(0, 0, -4), kWrapDt).force_n.z(), 1.0, 1e-15);
}

TEST(Wrap, ExactlyZeroWhenFree) {
  for (int set = 1; set < 8; ++set) {
    const auto renderer = prepared(options((set & 1) != 0, (set & 2) != 0, (set & 4) != 0), 0.0, 2.0);
    for (const double z : {0.5, -0.5, -1.0, -0.5}) (void)renderer->step(Vec3(0, 0, z), kWrapDt);
    for (const double z : {0.1, 0.2, 0.3})
      EXPECT_EQ(renderer->step(Vec3(0, 0, z), kWrapDt).force_n, Vec3::Zero());
  }
}

TEST(Wrap, ANonFiniteHipGivesNoForceAndChangesNothing) {
  const auto a = prepared(options(true, true, true)), b = prepared(options(true, true, true));
  for (int i = 0; i < 200; ++i) {
    const Vec3 hip(0, 0, 0.5 - 0.01 * i);
    if (i % 7 == 0) {
      const render::Frame odd = a->step(Vec3(0, std::nan(""), 0), kWrapDt);
      EXPECT_EQ(odd.status, render::FrameStatus::kNonFinite);
      EXPECT_EQ(odd.force_n, Vec3::Zero());
    }
    ASSERT_EQ(a->step(hip, kWrapDt).force_n, b->step(hip, kWrapDt).force_n) << i;
  }
}

TEST(Wrap, RestartGivesTheSameTraceAgain) {
  const auto renderer = prepared(options(true, true, true), 3.0, 1.0);
  std::vector<Vec3> first;
  for (int pass = 0; pass < 2; ++pass) {
    renderer->restart(Vec3(0, 0, 1));
    for (int i = 0; i < 500; ++i) {
      const Vec3 f = renderer->step(Vec3(0, 0, std::cos(0.05 * i)), kWrapDt).force_n;
      if (pass == 0)
        first.push_back(f);
      else
        ASSERT_EQ(f, first[static_cast<std::size_t>(i)]) << i;
    }
  }
}

TEST(Wrap, SaysWhatItDoes) {
  const auto renderer = prepared(options(true, true, true));
  const render::Description d = renderer->describe();
  EXPECT_EQ(d.name, "wall");
  for (const char* const word : {"virtual coupling of 0.5 N/mm", "50 N/s", "passivity"})
    EXPECT_NE(d.summary.find(word), std::string::npos) << d.summary;
  auto again = wrap(std::make_unique<Wall>(), options(true, false, false));
  const Result<render::PrepareReport> report = again->prepare({}, {});
  ASSERT_TRUE(report);
  ASSERT_EQ(report->notes.size(), 1u);
  EXPECT_EQ(report->notes[0],
            "control: virtual coupling of 0.5 N/mm and 0 N s/mm, passive at 1 kHz on a device with more than "
            "0.00025 N s/mm of damping");
}

TEST(Wrap, ReportsTheDelayThatEachLimitAdds) {
  ControlOptions o;
  o.filter.rate_limit_n_per_s = 100.0;
  o.filter.turn_limit_deg_per_s = 50.0;
  const std::vector<std::string> lines = describe(o);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0],
            "force changes by at most 100 N/s: a step of 1 N arrives to 63 % in 6 ms and to 95 % in 9 ms");
  EXPECT_EQ(
      lines[1],
      "force turns by at most 50 degrees/s: a step of 10 degrees arrives to 63 % in 125 ms and to 95 % in "
      "189 ms, a steady change is never caught up with");
  o.filter = {1e-6, 0.0};
  EXPECT_NE(describe(o)[0].find("does not arrive"), std::string::npos);
}

TEST(ControlOptions, WrongNumbersAreNamed) {
  EXPECT_TRUE(check(ControlOptions{}));
  ControlOptions o = options(true, true, true);
  EXPECT_TRUE(check(o));
  o.passivity->damping_limit_n_s_per_mm = 0.0;
  EXPECT_FALSE(check(o));
  o = options(true, true, true);
  o.coupling->damping_n_s_per_mm = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(check(o));
  o = options(true, true, true);
  o.filter.turn_limit_deg_per_s = -1.0;
  EXPECT_FALSE(check(o));
}

}  // namespace
}  // namespace palpate::control
