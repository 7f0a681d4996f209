// The least renderer to control: an elastic wall, matter below z = 0, made wrong in known ways.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <typeinfo>
#include <vector>

#include <palpate/control.h>
#include <palpate/renderer.h>
#include "tests/stepped.h"
#include "tests/toolkit/messages.h"
#include "toolkit/control/coupling_and_passivity.h"
#include "toolkit/core/random.h"

namespace palpate::control {
namespace {
class Wall final : public render::HapticRenderer {
 public:
  double stiffness_n_per_mm = 0.5;
  double out_stiffness_n_per_mm = 0.5;  ///< on the way out: more than on the way in is energy from nowhere
  double limit_n = -1.0;                ///< as prepare() saw it

  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& /*context*/) const override {
    render::Decisions decided;
    decided.decisions.push_back(render::force_limit_decision(scene.force_limit_n));
    return decided;
  }
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& /*context*/) override {
    limit_n = scene.force_limit_n;
    render::PrepareReport report;
    report.bytes = 1;
    report.decisions = decide(scene, {}).value();
    return report;
  }
  void restart(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    release_contact(hip_mm);
    counters_ = {};
  }
  void release_contact(const Vec3& hip_mm) noexcept override { last_z_mm_ = hip_mm.z(); }
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double /*t_s*/) noexcept override {
    ++counters_.frames;
    render::Frame frame;
    frame.god_object_mm = hip_mm;
    if (!is_finite(hip_mm)) {
      frame.status = render::FrameStatus::kNonFinite;
      return frame;
    }
    if (hip_mm.z() < 0.0) {
      frame.contact = true;
      frame.model = 0;
      frame.god_object_mm.z() = 0.0;
      const double k = hip_mm.z() > last_z_mm_ ? out_stiffness_n_per_mm : stiffness_n_per_mm;
      frame.force_n = render::limited(Vec3(0, 0, -k * hip_mm.z()), limit_n);
    }
    last_z_mm_ = hip_mm.z();
    return frame;
  }
  [[nodiscard]] render::FrameCounters counters() const noexcept override { return counters_; }
  [[nodiscard]] render::Description describe() const override {
    return {"wall", "a wall", "here", "none", {}};
  }

 private:
  double last_z_mm_ = 0.0;
  render::FrameCounters counters_;
};

// The observer against energies worked out by hand, the controller against renderers that give energy away.

constexpr double kPassivityDt = 1e-3;
constexpr EnergyRule kRules[] = {EnergyRule::kTrapezoid, EnergyRule::kPrinted, EnergyRule::kHold};

TEST(PassivityObserver, ASpringByHand) {
  // 0.5 N/mm, in 2 mm and out again in steps of 1 mm: F = 0, 0.5, 1, 0.5, 0.
  const double in_mj[] = {1.0, 1.5, 0.5};    // trapezoid; F(n): 0.5 + 1; F(n-1): 0 + 0.5
  const double out_mj[] = {0.0, 1.0, -1.0};  // k dh^2 / 2 = 0.25 too much or too little in each of 4 steps
  for (int rule = 0; rule < 3; ++rule) {
    PassivityObserver observer(kRules[rule]);
    for (const double z : {0.0, -1.0, -2.0}) observer.observe(Vec3(0, 0, z), Vec3(0, 0, -0.5 * z));
    EXPECT_DOUBLE_EQ(observer.energy_mj(), in_mj[rule]);
    for (const double z : {-1.0, 0.0}) observer.observe(Vec3(0, 0, z), Vec3(0, 0, -0.5 * z));
    EXPECT_DOUBLE_EQ(observer.energy_mj(), out_mj[rule]);
    EXPECT_DOUBLE_EQ(observer.min_energy_mj(), std::min(0.0, out_mj[rule]));
  }
}

TEST(PassivityObserver, TheTrapezoidIsExactOnEveryClosedPathThroughASpring) {
  Random random(41);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    const Vec3 around = scale * Vec3(1000, -2000, 500);
    std::vector<Vec3> path;
    for (int i = 0; i < 500; ++i)
      path.push_back(around +
                     scale * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)));
    path.push_back(path.front());
    PassivityObserver observer;
    double most = 0.0;
    for (const Vec3& h : path) {
      observer.observe(h, -0.5 * (h - around));
      most = std::max(most, std::abs(observer.energy_mj()));
    }
    EXPECT_LE(std::abs(observer.energy_mj()), 1e-9 * most) << "seed 41";
    EXPECT_GT(most, 0.0);
  }
}

TEST(PassivityObserver, PassesOverWhatIsNotFinite) {
  PassivityObserver observer;
  observer.observe(Vec3::Zero(), Vec3(0, 0, 1));
  observer.observe(Vec3(0, 0, std::nan("")), Vec3(0, 0, 1));
  observer.observe(Vec3(0, 0, -1), Vec3(0, 0, std::numeric_limits<double>::infinity()));
  observer.observe(Vec3(0, 0, -1), Vec3(0, 0, 1));
  EXPECT_DOUBLE_EQ(observer.energy_mj(), 1.0);
  observer.forget_surplus();
  EXPECT_DOUBLE_EQ(observer.energy_mj(), 0.0);
  observer.observe(Vec3(0, 0, 0), Vec3(0, 0, 1));
  observer.forget_surplus();
  EXPECT_DOUBLE_EQ(observer.energy_mj(), -1.0) << "what is owed is never forgotten";
}

/// In 2 mm and out at 20 mm/s, ten times, resting at the bottom.
std::vector<Vec3> taps(double step_mm = 0.02) {
  std::vector<Vec3> path;
  for (int tap = 0; tap < 10; ++tap) {
    for (double z = 0.5; z > -2.0; z -= step_mm) path.emplace_back(0, 0, z);
    for (int i = 0; i < 20; ++i) path.emplace_back(0, 0, -2.0);
    for (double z = -2.0; z < 0.5; z += step_mm) path.emplace_back(0, 0, z);
  }
  return path;
}

struct Outcome {
  double min_energy_mj = 0.0;
  double last_mj = 0.0;
  std::uint64_t damped = 0;
  double most_change_n = 0.0;  ///< of what the controller added
};
Outcome run(double out_stiffness, const PassivityOptions& options, EnergyRule judge) {
  Wall wall;
  wall.out_stiffness_n_per_mm = out_stiffness;
  PassivityController controller(options);
  PassivityObserver observer(judge);
  Outcome outcome;
  wall.restart(Vec3(0, 0, 0.5), 0.0);
  double t_s = 0.0;
  for (const Vec3& h : taps()) {
    const Vec3 wanted_n = wall.step(h, t_s += kPassivityDt).force_n;
    const Vec3 force_n = controller.control(h, wanted_n, kPassivityDt);
    observer.observe(h, force_n);
    outcome.damped += force_n != wanted_n;
    outcome.most_change_n = std::max(outcome.most_change_n, (force_n - wanted_n).norm());
  }
  outcome.min_energy_mj = observer.min_energy_mj();
  outcome.last_mj = observer.energy_mj();
  return outcome;
}

constexpr double kPlenty = 1e6;  // a damping limit that is never reached

TEST(PassivityController, LeavesAPassiveWallAlone) {
  const Outcome o = run(0.5, {EnergyRule::kTrapezoid, kPlenty}, EnergyRule::kTrapezoid);
  EXPECT_LT(o.most_change_n, 1e-9) << "a spring: nothing but rounding";
}

TEST(PassivityController, TakesBackAllThatAnActiveWallGives) {
  // Twice as stiff on the way out: 2 mJ for 1 mJ put in, ten times.
  const Outcome off = run(1.0, {EnergyRule::kTrapezoid, 1e-30}, EnergyRule::kTrapezoid);
  EXPECT_NEAR(off.last_mj, -10.0, 0.3);
  for (const EnergyRule rule : {EnergyRule::kTrapezoid, EnergyRule::kPrinted}) {
    const Outcome on = run(1.0, {rule, kPlenty}, rule);
    EXPECT_GE(on.min_energy_mj, -1e-12) << "by its own rule nothing is ever given away";
    EXPECT_GT(on.damped, 100u);
  }
  // The rule of the printed form counts k dh^2 / 2 too much a step: judged exactly, a little gets away.
  const Outcome printed = run(1.0, {EnergyRule::kPrinted, kPlenty}, EnergyRule::kTrapezoid);
  EXPECT_LT(printed.min_energy_mj, -1e-3);
  EXPECT_GT(printed.min_energy_mj, -0.5);
}

TEST(PassivityController, DampingStaysWithinItsLimit) {
  const double limit = kDampingLimitNSPerMm;
  const Outcome o = run(1.0, {EnergyRule::kTrapezoid, limit}, EnergyRule::kTrapezoid);
  EXPECT_LE(o.most_change_n, limit * 20.0 * (1 + 1e-9)) << "20 mm/s";
  EXPECT_GT(o.most_change_n, 0.9 * limit * 20.0);
  EXPECT_GT(o.last_mj, -10.0) << "it takes what it may";
}

TEST(PassivityController, WhatFrictionTookDoesNotPayForAKick) {
  PassivityController controller({EnergyRule::kTrapezoid, kPlenty});
  const auto at = [&](double z, double force) {
    return controller.control(Vec3(0, 0, z), Vec3(0, 0, force), kPassivityDt).z();
  };
  (void)at(0.0, 0.0);
  for (int i = 1; i <= 10; ++i) (void)at(-0.1 * i, 1.0);  // a mJ is dissipated ..
  (void)at(-1.0, 0.0);                                    // .. and the contact ends
  (void)at(-1.0, 1.0);
  EXPECT_LT(at(-0.9, 1.0), 0.2) << "a push out of nothing is taken back at once";
  EXPECT_NEAR(controller.observer().energy_mj(), 0.0, 1e-12);
}

TEST(PassivityController, NothingInFreeSpaceAndNothingAtRest) {
  PassivityController controller({EnergyRule::kTrapezoid, kPlenty});
  (void)controller.control(Vec3::Zero(), Vec3(0, 0, 1), kPassivityDt);
  // A force that grew at rest: nothing can be taken while nothing moves.
  EXPECT_EQ(controller.control(Vec3::Zero(), Vec3(0, 0, 2), kPassivityDt), Vec3(0, 0, 2));
  PassivityController owing({EnergyRule::kTrapezoid, 1e-12});
  (void)owing.control(Vec3::Zero(), Vec3(0, 0, 1), kPassivityDt);
  (void)owing.control(Vec3(0, 0, 1), Vec3(0, 0, 1), kPassivityDt);
  EXPECT_LT(owing.observer().energy_mj(), -0.9);
  EXPECT_EQ(owing.control(Vec3(0, 0, 2), Vec3::Zero(), kPassivityDt), Vec3::Zero());
  EXPECT_LT(owing.observer().energy_mj(), -0.9) << "the debt stays";
}

TEST(PassivityController, KeepsTheForceLimit) {
  Random random(42);
  PassivityController controller({EnergyRule::kTrapezoid, 1.0});
  for (int i = 0; i < 5000; ++i) {
    const Vec3 h(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
    const Vec3 f(random.normal(), random.normal(), random.normal());
    ASSERT_LE(controller.control(h, 3.0 * f, kPassivityDt, 3.3).norm(), 3.3 * (1 + 1e-12));
  }
}

// Control around a renderer: only what is asked for, in the order written, the force limit last.

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
      t_s += kPassivityDt;
      const double dt_s = t_s - last_s;
      z = std::clamp(z + random.uniform(-0.1, 0.1), -3.0, 1.0);
      const Vec3 hip(0.01 * i, 0, z);
      render::Frame expected = wall.step(hip, t_s);
      Vec3 f = expected.force_n;
      if (o.coupling) f = coupling.couple(hip, expected.god_object_mm, f, expected.contact, dt_s);
      if (o.filter.any()) f = filter.filter(f, dt_s);
      f = o.passivity ? controller.control(hip, f, dt_s, 0.8) : render::limited(f, 0.8);
      const render::Frame frame = renderer->step(hip, kPassivityDt);
      ASSERT_EQ(frame.force_n, f) << "set " << set << ", frame " << i;
      ASSERT_EQ(frame.contact, expected.contact);
      ASSERT_EQ(frame.god_object_mm, expected.god_object_mm);
      ASSERT_EQ(frame.model, expected.model);
      ASSERT_LE(frame.force_n.norm(), 0.8 * (1 + 1e-12));
    }
    EXPECT_EQ(renderer->counters().frames, 3000u);
  }
}

TEST(Wrap, ANonFiniteHipGivesNoForceAndChangesNothing) {
  const auto a = prepared(options(true, true, true)), b = prepared(options(true, true, true));
  for (int i = 0; i < 200; ++i) {
    const Vec3 hip(0, 0, 0.5 - 0.01 * i);
    if (i % 7 == 0) {
      const render::Frame odd = a->step(Vec3(0, std::nan(""), 0), kPassivityDt);
      EXPECT_EQ(odd.status, render::FrameStatus::kNonFinite);
      EXPECT_EQ(odd.force_n, Vec3::Zero());
    }
    ASSERT_EQ(a->step(hip, kPassivityDt).force_n, b->step(hip, kPassivityDt).force_n) << i;
  }
}

TEST(Wrap, RestartGivesTheSameTraceAgain) {
  const auto renderer = prepared(options(true, true, true), 3.0, 1.0);
  std::vector<Vec3> first;
  for (int pass = 0; pass < 2; ++pass) {
    renderer->restart(Vec3(0, 0, 1));
    for (int i = 0; i < 500; ++i) {
      const Vec3 f = renderer->step(Vec3(0, 0, std::cos(0.05 * i)), kPassivityDt).force_n;
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
  EXPECT_TRUE(test::contains(d.summary, "virtual coupling of 0.5 N/mm", "50 N/s", "passivity"));
  auto again = wrap(std::make_unique<Wall>(), options(true, false, false));
  const auto report = test::value_of(again->prepare({}, {}));
  ASSERT_EQ(report.notes.size(), 1u);
  EXPECT_TRUE(test::contains(report.notes[0], "0.5 N/mm and 0 N s/mm", "more than 0.00025 N s/mm"));
}

TEST(Wrap, ReportsTheDelayThatEachLimitAdds) {
  ControlOptions o;
  o.filter.rate_limit_n_per_s = 100.0;
  o.filter.turn_limit_deg_per_s = 50.0;
  const std::vector<std::string> lines = describe(o);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_TRUE(test::contains(lines[0], "100 N/s", "63 % in 6 ms", "95 % in 9 ms"));
  EXPECT_TRUE(test::contains(lines[1], "50 degrees/s", "63 % in 125 ms", "95 % in 189 ms", "never"));
  o.filter = {1e-6, 0.0};
  EXPECT_TRUE(test::contains(describe(o)[0], "does not arrive"));
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
