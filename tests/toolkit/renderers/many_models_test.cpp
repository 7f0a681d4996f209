// Many models at once: together, one by one, and the broad phase that tells which are near.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::render {
namespace {

constexpr double kDt = 1e-3;

// The upper of two parallel planes holds the god object out of both: the lower one pushes nothing.
TEST(ManyModels, TheOracleIsHeldJointlyWithFrictionAndRefusesWhatItCannotDo) {
  SceneInput scene;
  scene.models.push_back(plane_at(Vec3::Zero()));
  scene.models.push_back(plane_at(Vec3(0, 0, 0.4)));
  scene.models[1].surface.friction = {0.5, 0.5};
  scene.models[0].surface.deformation = 0.25;
  const auto renderer = prepared(scene, "brute-force:shading=facet");
  renderer->restart(Vec3(-3, 0.1, 2));
  Frame frame;
  for (int i = 0; i <= 300; ++i) frame = renderer->step(Vec3(-3, 0.1, 2 - 0.01 * i), kDt);
  for (int i = 0; i <= 300; ++i) frame = renderer->step(Vec3(-3 + 0.02 * i, 0.1, -1), kDt);
  ASSERT_TRUE(frame.contact);
  EXPECT_EQ(frame.model, 1);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * 1.4, 1e-6);
  EXPECT_NEAR(frame.force_n.x(), -0.5 * 0.5 * 1.4, 1e-6);
  Registry registry;
  register_toolkit_renderers(registry);
  scene.models[1].surface.dent = {0.5, 3.0, 20.0};
  const Status dented = registry.check_supports(*registry.find("brute-force"), scene);
  ASSERT_FALSE(dented);
  EXPECT_NE(dented.error().message().find("dent"), std::string::npos) << dented.error().message();
}

TEST(ManyModels, TwoWallsOfACornerConstrainJointly) {
  SceneInput scene;
  scene.models.push_back(plane_at(Vec3::Zero()));
  ModelInput wall = plane_at(Vec3::Zero());
  wall.world_from_model.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY()));
  wall.world_from_model.translation_mm =
      -(wall.world_from_model.rotation * wall.cloud->box_mm().centre_mm());  // the plane x = 0
  scene.models.push_back(wall);
  for (const char* spec : {"cloud", "brute-force:shading=facet", "analytic", "heightfield"}) {
    SCOPED_TRACE(spec);
    const auto joint = prepared(scene, spec);
    joint->restart(Vec3(2, 0, 2));
    Frame frame;
    for (int i = 0; i <= 400; ++i) frame = joint->step(Vec3(2 - 0.0075 * i, 0.1, 2 - 0.01 * i), kDt);
    ASSERT_TRUE(frame.contact);
    EXPECT_LT((frame.god_object_mm - Vec3(0, 0.1, 0)).norm(), 1e-9);
    EXPECT_LT((frame.force_n - 0.5 * Vec3(1, 0, 2)).norm(), 1e-9);
  }
}

TEST(ManyModels, SteepWallsAddUpInTheSumAndNotJointly) {
  // Two planes at 10 degrees to each other: together they push hardly more than one.
  SceneInput scene;
  scene.models.push_back(plane_at(Vec3::Zero()));
  ModelInput tilted = plane_at(Vec3::Zero());
  const Eigen::AngleAxisd turn(10 * std::numbers::pi / 180, Vec3::UnitY());
  tilted.world_from_model.rotation = turn;
  tilted.world_from_model.translation_mm = -(turn * tilted.cloud->box_mm().centre_mm());
  scene.models.push_back(tilted);
  const Vec3 hip(0, 0, -1);
  const auto force = [&](const std::string& spec) {
    const auto renderer = prepared(scene, spec);
    renderer->restart(Vec3(0, 0, 1));
    Frame frame;
    for (int i = 0; i <= 200; ++i) frame = renderer->step(Vec3(0, 0, 1 - 0.01 * i), kDt);
    return frame.force_n;
  };
  EXPECT_NEAR(force("cloud:combine=sum").norm(), 0.5 * (1.0 + std::cos(10 * std::numbers::pi / 180)), 0.01);
  for (const char* spec : {"cloud:combine=joint", "analytic", "heightfield"}) {
    const Vec3 joint = force(spec);
    EXPECT_LT((joint - Vec3(0, 0, 0.5)).norm(), 1e-6) << spec << ": " << joint.transpose();
  }
  // The literal sum, bare: the middle points of both planes are the nearest, 1 mm straight above the HIP.
  EXPECT_LT((force("cloud-literal:box_mm=0.6:shading=none:cells=adjacent") - Vec3(0, 0, 2 * 0.5)).norm(),
            1e-6);
}

// More models touched at once than are answered together: the deepest are, wherever they stand in the scene.
// The last one has more points than the others, so that a place on it is none of theirs.
TEST(ManyModels, OfMoreThanEightTouchedTheDeepestAnswer) {
  Random random(17);
  for (int trial = 0; trial < 10; ++trial) {
    SCOPED_TRACE(testing::Message() << "seed 17, trial " << trial);
    const std::size_t count = kMaxTouched + 1 + random.below(6);
    SceneInput scene;
    std::vector<double> height;
    for (std::size_t i = 0; i < count; ++i) {
      height.push_back(0.5 * random.uniform());
      scene.models.push_back(plane_at(Vec3(0, 0, height[i]), i + 1 == count ? 0.5 : 2.0));
    }
    if (trial % 2 == 0) {  // the ninth and last is the deepest, found when eight are there already
      height.back() = 0.7;
      scene.models.back() = plane_at(Vec3(0, 0, 0.7), 0.5);
    }
    const Vec3 hip(0.3 + random.uniform(), 0.2, -0.1 - random.uniform());
    const auto force = [&](const std::string& spec, FrameStatus& status) {
      const auto renderer = prepared(scene, spec);
      const Vec3 start(0.1, 0.2, 2), down = hip - start;
      renderer->restart(start);
      Frame frame;
      for (int i = 0; i <= 200; ++i) frame = renderer->step(start + down * (i / 200.0), kDt);
      // To and fro under all of them: nothing of another model's state may come into it.
      for (int i = 0; i <= 200; ++i)
        frame = renderer->step(hip + Vec3(8 * std::sin(0.1 * i), 5 * std::sin(0.07 * i), 0), kDt);
      frame = renderer->step(hip, kDt);
      status = frame.status;
      EXPECT_TRUE(frame.contact);
      const auto deepest = std::max_element(height.begin(), height.end());
      EXPECT_EQ(frame.model, deepest - height.begin());
      for (int i = 0; i <= 200; ++i) {
        const Frame free = renderer->step(hip - down * (i / 200.0), kDt);
        if (i == 200) {
          EXPECT_FALSE(free.contact);
        }
      }
      return frame.force_n;
    };
    std::vector<double> sorted = height;
    std::sort(sorted.rbegin(), sorted.rend());
    double sum = 0.0;
    for (std::size_t i = 0; i < kMaxTouched; ++i) sum += 0.5 * (sorted[i] - hip.z());
    FrameStatus status = FrameStatus::kOk;
    EXPECT_LT((force("cloud", status) - Vec3(0, 0, 0.5 * (sorted[0] - hip.z()))).norm(), 1e-6);
    EXPECT_EQ(status, FrameStatus::kBoundHit) << "some are left out, and the frame says so";
    EXPECT_LT((force("cloud:combine=sum", status) - Vec3(0, 0, sum)).norm(), 1e-6);
    EXPECT_EQ(status, FrameStatus::kBoundHit);
  }
}

// As many planes as three vertices of meshes give: none may be dropped because others came first.
TEST(ManyModels, JointPlanesAreSolvedHoweverMany) {
  Random random(23);
  const auto unit = [&] { return Vec3(random.normal(), random.normal(), random.normal()).normalized(); };
  for (int trial = 0; trial < 300; ++trial) {
    SCOPED_TRACE(testing::Message() << "seed 23, trial " << trial);
    constexpr std::size_t kMost = 48;  // of eight touches at vertices of six facets
    const std::size_t count = 1 + random.below(kMost);
    const Vec3 hip = 3.0 * unit();
    JointPlanes planes;
    for (std::size_t i = 0; i < count; ++i) {  // all contain the origin, so there is room
      planes.begin(i % 5);
      planes.add({unit(), -random.uniform()});
    }
    const geometry::NearestAllowed solved = geometry::nearest_allowed(planes.planes(), hip, 1e-9);
    const Vec3 found = solved.point;
    // Karush, Kuhn and Tucker: allowed, reached by pushes along planes that hold it, none of them a pull.
    Vec3 sum = hip;
    for (std::size_t i = 0; i < count; ++i) {
      const geometry::HalfSpace& plane = planes.planes()[i];
      const double over = plane.normal.dot(found) - plane.offset;
      EXPECT_GE(over, -1e-8);
      EXPECT_GE(solved.push_of(i), 0.0);
      if (solved.push_of(i) > 0.0) {
        EXPECT_LT(over, 1e-8);
      }
      EXPECT_EQ(planes.owner(i), i % 5);
      sum += solved.push_of(i) * plane.normal;
    }
    EXPECT_LT((sum - found).norm(), 1e-8);
  }
}

/// n planes in a row, 60 mm apart.
SceneInput row_of(std::size_t n) {
  SceneInput scene;
  const ModelInput plane = plane_at(Vec3::Zero(), 2.0);
  for (std::size_t i = 0; i < n; ++i) {
    scene.models.push_back(plane);
    scene.models.back().world_from_model.translation_mm.x() += 60.0 * static_cast<double>(i);
  }
  return scene;
}

TEST(ManyModels, AnyModelOfAThousandIsFeltAsIfItWereAlone) {
  const SceneInput scene = row_of(1000);
  const auto renderer = prepared(scene, "cloud");
  const auto alone = prepared(row_of(1), "cloud");
  renderer->restart(Vec3(0, 0, 5));
  Random random(3);
  for (int visit = 0; visit < 60; ++visit) {
    const double model = std::floor(1000.0 * random.uniform());
    const Vec3 over(60.0 * model + 3.0 * random.uniform(), 2.0, 5.0);
    (void)renderer->step(over, kDt);  // a jump from one place in free space to another
    const Vec3 way(0.3, 0.2, -7.0);
    alone->restart(over - Vec3(60.0 * model, 0, 0));
    for (int i = 1; i <= 100; ++i) {
      const Vec3 h = over + way * (0.01 * i);
      const Frame a = renderer->step(h, kDt);
      const Frame b = alone->step(h - Vec3(60.0 * model, 0, 0), kDt);
      ASSERT_EQ(a.contact, b.contact) << visit << " " << i;
      if (a.contact) {
        EXPECT_EQ(a.model, static_cast<std::int32_t>(model));
        EXPECT_LT((a.force_n - b.force_n).norm(), 1e-9);
      }
    }
    (void)renderer->step(over, kDt);
  }
}

TEST(ManyModels, OneThatIsTouchedStaysHoweverDeep) {
  const SceneInput scene = row_of(3);
  const auto renderer = prepared(scene, "cloud");
  renderer->restart(Vec3(60, 0, 5));
  for (int i = 0; i <= 500; ++i) {
    const Frame frame = renderer->step(Vec3(60.2, 0.1, 5 - 0.2 * i), kDt);
    if (5 - 0.2 * i < -1e-6) {
      ASSERT_TRUE(frame.contact) << i;
    }
  }
}

TEST(ManyModels, OneMovesThroughTheListsOfOthers) {
  // A plane flies in from 500 mm away at 1 m/s to a resting probe among other models.
  SceneInput scene = row_of(20);
  auto simulation = std::make_shared<ScriptedSimulation>();
  ScriptedMotion motion;
  ModelInput flying = plane_at(Vec3(570, 0, -500), 2.0);
  motion.start = flying.world_from_model;
  motion.velocity_mm_s = Vec3(0, 0, 1000);
  motion.stop_s = 0.511;
  flying.motion = simulation->add(motion);
  scene.models.push_back(flying);
  scene.simulation = simulation;
  const auto renderer = on_clock(scene, "cloud");
  const Vec3 hip(570, 0.2, 10);
  renderer->restart(hip);
  Frame frame;
  for (int i = 0; i < 600; ++i) frame = renderer->step(hip, kDt);
  EXPECT_TRUE(frame.contact);
  EXPECT_EQ(frame.model, 20);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * 1.0, 1e-6);
}

}  // namespace
}  // namespace palpate::render
