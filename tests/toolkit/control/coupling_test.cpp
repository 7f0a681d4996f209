// The virtual coupling: two springs in a row, a damper that never pulls, and Colgate's condition.
#include <gtest/gtest.h>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>

#include "tests/stepped.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/control/controlled_renderer.h"
#include "toolkit/control/virtual_coupling.h"
#include "toolkit/core/random.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"

namespace palpate::control {
namespace {

constexpr double kDt = 1e-3;
const Vec3 kUp = Vec3::UnitZ();

Vec3 resting(const Coupling& coupling, double depth_mm, double model_n) {
  VirtualCoupling c(coupling);
  Vec3 force_n;
  for (int i = 0; i < 2; ++i) force_n = c.couple(-depth_mm * kUp, Vec3::Zero(), model_n * kUp, true, kDt);
  return force_n;
}

TEST(VirtualCoupling, TwoSpringsInARow) {
  // 1 mm of a 0.5 N/mm model behind 0.5 N/mm: 0.25 N/mm. Behind 1.5: 3/8.
  EXPECT_NEAR(resting({0.5, 0.0}, 1.0, 0.5).z(), 0.25, 1e-15);
  EXPECT_NEAR(resting({1.5, 0.0}, 1.0, 0.5).z(), 0.375, 1e-15);
  EXPECT_NEAR(resting({1.5, 0.01}, 1.0, 0.5).z(), 0.375, 1e-15) << "a damper at rest does nothing";
}

TEST(VirtualCoupling, NothingIsStifferThanTheCoupling) {
  for (const double scale : {1e-3, 1.0, 1e6}) {
    EXPECT_NEAR(resting({0.7, 0.0}, 2.0 * scale, 1e12 * scale).z() / scale, 1.4, 1e-9) << "rigid";
    EXPECT_NEAR(resting({0.7, 0.0}, 2.0 * scale, 2e-9 * scale).z() / scale, 2e-9, 1e-16) << "soft";
  }
}

TEST(VirtualCoupling, TheRenderersDirectionStays) {
  VirtualCoupling c({0.5, 0.0});
  const Vec3 shaded(0.1, -0.05, 0.4);
  const Vec3 f = c.couple(Vec3(0, 0, -1), Vec3::Zero(), shaded, true, kDt);
  EXPECT_LT(f.cross(shaded).norm(), 1e-16);
  EXPECT_GT(f.dot(shaded), 0.0);
}

TEST(VirtualCoupling, TheDamperResistsGoingInAndNeverPullsBack) {
  VirtualCoupling c({1.0, 0.002});
  const auto at = [&](double z) {
    return c.couple(Vec3(0, 0, z), Vec3::Zero(), Vec3(0, 0, -1e9 * z), true, kDt).z();
  };
  EXPECT_NEAR(at(-0.1), 0.1 + 0.002 * 100.0, 1e-8);  // 0.1 mm in 1 ms
  EXPECT_NEAR(at(-0.2), 0.2 + 0.2, 1e-8);
  EXPECT_NEAR(at(-0.19), 0.19 - 0.02, 1e-8);  // out at 10 mm/s
  EXPECT_EQ(at(-0.05), 0.0) << "out at 140 mm/s the damper would pull with 0.28 N";
}

TEST(VirtualCoupling, AtDepthZeroThereIsNothingToPullAlong) {
  // A god object that a carved surface leaves at the HIP: contact, and no depth.
  VirtualCoupling c({1.0, 0.002});
  (void)c.couple(Vec3(0, 0, -0.01), Vec3::Zero(), Vec3(0, 0, 1e9), true, kDt);
  EXPECT_EQ(c.couple(Vec3::Zero(), Vec3::Zero(), Vec3::Zero(), true, kDt), Vec3::Zero());
}

TEST(VirtualCoupling, NeverPullsToTheSurfaceWhateverTheSurfaceDoes) {
  // A plane around z = 0 under a hand that moves at random: the force may never point down.
  const auto model =
      cloud::generate(parse_named_options("plane:extent_mm=20:spacing_mm=0.5").value()).value();
  render::SceneInput scene;
  scene.models.emplace_back();
  scene.models[0].cloud = std::make_shared<cloud::Cloud>(model.cloud);
  const Vec3 middle = model.cloud.box_mm().centre_mm();
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  ControlOptions control;
  control.coupling = Coupling{0.5, 0.002};
  for (const double friction : {0.0, 0.9})
    for (const double carved_mm : {0.0, 0.2}) {
      SCOPED_TRACE(testing::Message() << "friction " << friction << ", carved " << carved_mm << " mm");
      scene.models[0].surface.friction = {friction, 0.7 * friction};
      scene.models[0].surface.texture = {};
      if (carved_mm > 0.0) {
        scene.models[0].surface.texture.kind = surface::TextureKind::kGrating;
        scene.models[0].surface.texture.depth_mm = carved_mm;
        scene.models[0].surface.texture.wavelength_mm = 2.0;
      }
      const test::Stepped renderer = wrap(registry.make("cloud", {}).value(), control);
      ASSERT_TRUE(renderer->prepare(scene, {}));
      Random random(41);
      Vec3 at(0, 0, 1), speed = Vec3::Zero();
      renderer->restart(middle + at);
      int contacts = 0, pulled = 0;
      double most = 0.0;
      for (int i = 0; i < 20'000; ++i) {
        speed = 0.97 * speed - Vec3(1, 1, 3).cwiseProduct(at + Vec3(0, 0, 0.3)) +
                8.0 * Vec3(random.normal(), random.normal(), random.normal());
        at += kDt * speed;
        const render::Frame frame = renderer->step(middle + at, kDt);
        contacts += frame.contact;
        pulled += frame.force_n.z() < 0.0;
        most = std::max(most, frame.force_n.z());
      }
      EXPECT_GT(contacts, 5000);
      EXPECT_LT(contacts, 19'900);
      EXPECT_GT(most, 0.1);
      EXPECT_EQ(pulled, 0) << "seed 41";
    }
}

TEST(VirtualCoupling, ExactlyZeroWhenFreeAndNoMemoryOfTheLastContact) {
  VirtualCoupling c({1.0, 0.002});
  (void)c.couple(Vec3(0, 0, -1), Vec3::Zero(), Vec3(0, 0, 1), true, kDt);
  EXPECT_EQ(c.couple(Vec3(0, 0, 1), Vec3(0, 0, 1), Vec3::Zero(), false, kDt), Vec3::Zero());
  const Vec3 again = c.couple(Vec3(0, 0, -0.01), Vec3::Zero(), Vec3(0, 0, 1e9), true, kDt);
  EXPECT_NEAR(again.z(), 0.01 + 0.002 * 10.0, 1e-8);
}

TEST(VirtualCoupling, NeverNan) {
  Random random(21);
  VirtualCoupling c({1.0, 0.002});
  const double odd[] = {0.0, 1e-300, 1e300, 5e-324, std::numeric_limits<double>::infinity(), std::nan("")};
  const auto pick = [&] { return random.below(2) == 0 ? odd[random.below(6)] : random.uniform(-1, 1); };
  for (int i = 0; i < 20000; ++i) {
    const Vec3 hip(pick(), pick(), pick()), god(pick(), pick(), pick()), force(pick(), pick(), pick());
    ASSERT_TRUE(is_finite(c.couple(hip, god, force, random.below(4) != 0, pick()))) << "seed 21, frame " << i;
  }
}

TEST(CouplingStability, ColgatesCondition) {
  // Literature: K = 0.5 N/mm needs b > 0.25 N s/m at 1 kHz, 0.05 at 5 kHz. 1 N s/m = 0.001 N s/mm.
  const CouplingStability at_1 = coupling_stability({0.5, 0.0}, 0.3e-3, 1e-3);
  EXPECT_TRUE(at_1.passive);
  EXPECT_NEAR(at_1.needed_n_s_per_mm, 0.25e-3, 1e-12);
  EXPECT_NEAR(at_1.most_stiffness_n_per_mm, 0.6, 1e-12);
  EXPECT_NEAR(coupling_stability({0.5, 0.0}, 0.3e-3, 0.2e-3).needed_n_s_per_mm, 0.05e-3, 1e-12);
  EXPECT_FALSE(coupling_stability({0.5, 0.1e-3}, 0.3e-3, 1e-3).passive)
      << "its own damping counts against it";
  EXPECT_FALSE(coupling_stability({0.6, 0.0}, 0.3e-3, 1e-3).passive) << "the condition is strict";
  EXPECT_EQ(coupling_stability({0.5, 1e-3}, 0.3e-3, 1e-3).most_stiffness_n_per_mm, 0.0);
}

/// One axis of a device (45 g, damping b) held at a point by a coupling, the force held for a period: by what
/// factor its swing grows from the first second to the third.
double growth(double stiffness_n_per_mm, double device_damping_n_s_per_mm) {
  constexpr int kParts = 100, kSecond = 1000;
  constexpr double kMassNs2PerMm = 0.045e-3;
  VirtualCoupling coupling({stiffness_n_per_mm, 0.0});
  double z = 0.1, v = 0.0, first = 0.0, third = 0.0;
  for (int frame = 0; frame < 3 * kSecond; ++frame) {
    const Vec3 hip(0, 0, z), rigid = -1e12 * hip;
    const double f = coupling.couple(hip, Vec3::Zero(), rigid, true, kDt).z();
    for (int part = 0; part < kParts; ++part) {
      v += (f - device_damping_n_s_per_mm * v) / kMassNs2PerMm * kDt / kParts;
      z += v * kDt / kParts;
    }
    if (frame < kSecond) first = std::max(first, std::abs(z));
    if (frame >= 2 * kSecond) third = std::max(third, std::abs(z));
  }
  return third / first;
}

TEST(CouplingStability, TheConditionIsWhereASwingBeginsToGrow) {
  const double b = 0.3e-3;
  const double most = coupling_stability({1.0, 0.0}, b, kDt).most_stiffness_n_per_mm;
  // The damping that is left is b - k T / 2: at 5 % from the border a swing changes by exp(-+ 0.17 / s x 2
  // s).
  EXPECT_LT(growth(0.95 * most, b), 0.8);
  EXPECT_GT(growth(1.05 * most, b), 1.2);
}

TEST(Coupling, WrongNumbersAreNamed) {
  EXPECT_TRUE(check(Coupling{1.0, 0.0}));
  for (const Coupling wrong : {Coupling{0.0, 0.0}, Coupling{-1.0, 0.0}, Coupling{std::nan(""), 0.0}})
    EXPECT_NE(check(wrong).error().what.find("stiffness_n_per_mm"), std::string::npos);
  EXPECT_NE(check(Coupling{1.0, -1e-9}).error().what.find("damping_n_s_per_mm"), std::string::npos);
}

}  // namespace
}  // namespace palpate::control
