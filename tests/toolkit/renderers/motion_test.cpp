// Models that move.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/joint_contact.h"

namespace palpate::render {
namespace {

constexpr double kMotionDt = 1e-3;

SceneInput moving(const ScriptedMotion& motion, ModelInput model) {
  SceneInput scene;
  auto simulation = std::make_shared<ScriptedSimulation>();
  ScriptedMotion placed = motion;
  placed.start = model.world_from_model;
  model.motion = simulation->add(placed);
  scene.models.push_back(std::move(model));
  scene.simulation = std::move(simulation);
  return scene;
}

TEST(Motion, AScriptedTurnIsExactBetweenThePublishedPoses) {
  ScriptedMotion motion;
  motion.start.translation_mm = Vec3(10, 0, 0);
  motion.about_mm = Vec3(1, 2, 3);
  motion.velocity_mm_s = Vec3(0, 5, 0);
  motion.angular_velocity_rad_s = Vec3(0, 0, 2);
  motion.start_s = 0.1;
  motion.stop_s = 0.9;
  const Vec3 p(0.3, -0.7, 0.2);
  for (double t = 0.0; t < 1.2; t += 0.0137) {
    const double moved = std::clamp(t - 0.1, 0.0, 0.8);
    const Vec3 about = motion.about_mm + motion.velocity_mm_s * moved;
    const Vec3 expected =
        about + Eigen::AngleAxisd(2 * moved, Vec3::UnitZ()) * (motion.start * p - motion.about_mm);
    EXPECT_LT((motion.at(t).world_from_model * p - expected).norm(), 1e-12) << t;
    // What a frame makes of an older pose of the same stretch.
    const PoseState older = motion.at(t);
    if (t > 0.1 && t + 0.004 < 0.9) {
      EXPECT_LT((older.at(t + 0.004) * p - motion.at(t + 0.004).world_from_model * p).norm(), 1e-12) << t;
    }
  }
}

// Section 3.3.1: a plane that rises past a still probe is felt in every frame from then on.
TEST(Motion, APlaneRisingPastARestingProbeIsFeltAndNeverLost) {
  for (const char* name : {"cloud", "heightfield"})
    for (const double speed : {5.0, 20.0, 50.0, 100.0, 200.0, 500.0})
      for (int run = 0; run < 4; ++run) {
        SCOPED_TRACE(testing::Message() << name << ", " << speed << " mm/s, run " << run);
        ScriptedMotion motion;
        motion.velocity_mm_s = Vec3(0, 0, speed);
        motion.stop_s = 3.0 / speed;  // 1 mm below the probe to 2 mm above it
        const SceneInput scene = moving(motion, plane_at(Vec3(0.37 * run, 0.21 * run, -1.0)));
        const auto renderer = on_clock(scene, name);
        const Vec3 hip(0.1 + 0.013 * run, 0.2, 0);
        renderer->restart(hip);
        const int frames = static_cast<int>(3.0 / speed / kMotionDt) + 200;
        Frame frame;
        int lost = 0;
        for (int i = 0; i < frames; ++i) {
          const bool before = frame.contact;
          frame = renderer->step(hip, kMotionDt);
          lost += before && !frame.contact;
        }
        EXPECT_EQ(lost, 0);
        EXPECT_TRUE(frame.contact);
        EXPECT_NEAR(frame.force_n.z(), 0.5 * 2.0, 1e-6);
      }
}

/// A model that stands where it is put: jumps of a motion that no script can write.
class Placed final : public Simulation {
 public:
  Placed(const geometry::RigidTransform& start, const geometry::RigidTransform& then, double at_s)
      : start_(start), then_(then), at_s_(at_s), model_(std::make_shared<MovingModel>(state(0.0))) {}
  [[nodiscard]] const std::shared_ptr<MovingModel>& model() const noexcept { return model_; }
  void reset() noexcept override {
    next_s_ = 0.0;
    advance(0.0);
  }
  /// Five publications at once where five are due: what the first of them changed must outlive the others.
  void advance(double t_s) noexcept override {
    for (; next_s_ <= t_s; next_s_ += kTickS) model_->publish(state(next_s_));
  }
  [[nodiscard]] double next_s() const noexcept override { return next_s_; }

 private:
  static constexpr double kTickS = 2e-4;
  [[nodiscard]] PoseState state(double t_s) const noexcept {
    PoseState out;
    out.t_s = t_s;
    out.world_from_model = t_s < at_s_ ? start_ : then_;
    return out;
  }
  geometry::RigidTransform start_, then_;
  double at_s_, next_s_ = 0.0;
  std::shared_ptr<MovingModel> model_;
};

TEST(Motion, AModelThatJumpsIsFeltAtOnce) {
  constexpr double kFar = 40.0, kDepth = 1.5;
  const Scene still = generated("sphere:points=6000:extent_mm=20");
  for (const char* name : {"cloud", "cloud-smooth", "cloud-literal"})
    for (int phase = 0; phase < 20; phase += 3) {
      SceneInput scene;
      scene.models.push_back(still.input.models[0]);
      geometry::RigidTransform from, to;
      from.translation_mm = Vec3(0, 0, -kFar);
      to.translation_mm = Vec3(0, 0, -10.0 + kDepth);
      auto simulation = std::make_shared<Placed>(from, to, 0.2 + 1e-3 * phase);
      scene.models[0].motion = simulation->model();
      scene.simulation = std::move(simulation);
      const auto renderer = on_clock(scene, name);
      renderer->restart(Vec3::Zero());
      Frame frame;
      for (int i = 0; i < 199; ++i) EXPECT_FALSE(renderer->step(Vec3::Zero(), kMotionDt).contact);
      for (int i = 0; i < 30; ++i) frame = renderer->step(Vec3::Zero(), kMotionDt);
      ASSERT_TRUE(frame.contact) << name << ", phase " << phase;
      EXPECT_NEAR(frame.force_n.z(), 0.5 * kDepth, 0.05) << name << ", phase " << phase;
    }
}

// What is near a resting probe is asked 50 times a second: a model that begins, turns back or stops in
// between is felt all the same, at any phase of that.
TEST(Motion, AModelThatTakesAnotherCourseIsFeltAtOnce) {
  constexpr double kSpeed = 200.0, kGap = 2.5, kWay = 4.0;
  const Scene still = generated("sphere:points=6000:extent_mm=20");
  for (const char* name : {"cloud", "cloud-smooth", "cloud-literal"})
    for (int phase = 0; phase < 20; phase += 3) {
      ScriptedMotion motion;
      motion.velocity_mm_s = Vec3(0, 0, kSpeed);
      motion.start_s = 0.2 + 1e-3 * phase;
      motion.stop_s = motion.start_s + kWay / kSpeed;
      const auto renderer = on_clock(moving(motion, still.input.models[0]), name);
      const Vec3 hip(0, 0, 10.0 + kGap);
      renderer->restart(hip);
      Frame frame;
      for (int i = 0; i < 200; ++i) EXPECT_FALSE(renderer->step(hip, kMotionDt).contact);
      for (int i = 0; i < 60; ++i) frame = renderer->step(hip, kMotionDt);
      ASSERT_TRUE(frame.contact) << name << ", phase " << phase;
      EXPECT_NEAR(frame.force_n.z(), 0.5 * (kWay - kGap), 0.05) << name << ", phase " << phase;
    }
}

TEST(Motion, AJumpOfAModelIsAnotherCourseAndARestIsNot) {
  PoseState state;
  MovingModel model(state);
  const auto count = [&] { return model.motion_version()->load(); };
  state.t_s = 0.005;
  model.publish(state);
  EXPECT_EQ(count(), 0u);
  state.world_from_model.translation_mm = Vec3(0, 0, 1);
  state.about_mm = Vec3(0, 0, 1);
  model.publish(state);
  EXPECT_EQ(count(), 1u);
  // From now on it goes on as it says.
  state.velocity_mm_s = Vec3(3, 0, 0);
  state.angular_velocity_rad_s = Vec3(0, 2, 0);
  model.publish(state);
  EXPECT_EQ(count(), 2u);
  const PoseState from = state;
  for (int i = 1; i < 100; ++i) {
    state.t_s = from.t_s + 0.005 * i;
    state.world_from_model = from.at(state.t_s);
    state.about_mm = from.about_mm + from.velocity_mm_s * (state.t_s - from.t_s);
    model.publish(state);
  }
  EXPECT_EQ(count(), 2u);
  state.angular_velocity_rad_s = Vec3(0, -2, 0);
  model.publish(state);
  EXPECT_EQ(count(), 3u);
}

// A model that moves and turns answers like a resting one does to the HIP in the model's own frame.
TEST(Motion, AMovingModelIsFeltAsItIsInItsOwnFrame) {
  const Scene still = generated("sphere:points=3000");
  const geometry::Aabb box = still.input.models[0].cloud->box_mm();
  ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(10, 0, 3);
  motion.angular_velocity_rad_s = Vec3(0.3, 0.2, -0.5);
  motion.about_mm = box.centre_mm();
  const SceneInput scene = moving(motion, still.input.models[0]);
  const Vec3 hip = box.centre_mm() + Vec3(0.5 * box.extent_mm().x() + 1.0, 0.3, 0.2);
  for (const auto& [name, near_n] :
       {std::pair("brute-force", 1e-9), std::pair("cloud", 1e-6), std::pair("cloud-smooth", 1e-6)}) {
    const auto moved = on_clock(scene, name), rested = prepared(still.input, name);
    moved->restart(hip);
    rested->restart(hip);
    int contacts = 0;
    for (int i = 1; i <= 300; ++i) {
      const geometry::RigidTransform pose = motion.at(kMotionDt * i).world_from_model;
      const Frame a = moved->step(hip, kMotionDt), b = rested->step(pose.inverse() * hip, kMotionDt);
      ASSERT_EQ(a.contact, b.contact) << name << ", frame " << i;
      EXPECT_LT((a.force_n - pose.rotate(b.force_n)).norm(), near_n) << name << ", frame " << i;
      EXPECT_LT((a.god_object_mm - (b.contact ? Vec3(pose * b.god_object_mm) : hip)).norm(), near_n) << name;
      contacts += a.contact;
    }
    EXPECT_GT(contacts, 150) << name;
  }
}

// Many models at once: together, one by one, and the broad phase that tells which are near.

// The upper of two parallel planes holds the god object out of both: the lower one pushes nothing.
TEST(ManyModels, TheOracleIsHeldJointlyWithFrictionAndRefusesWhatItCannotDo) {
  SceneInput scene;
  scene.models.push_back(plane_at(Vec3::Zero()));
  scene.models.push_back(plane_at(Vec3(0, 0, 0.4)));
  scene.models[1].surface.friction = {0.5, 0.5};
  scene.models[0].surface.deformation = 0.25;
  const auto renderer = prepared(scene, "brute-force");
  renderer->restart(Vec3(-3, 0.1, 2));
  (void)glide(renderer, Vec3(-3, 0.1, 2), Vec3(-3, 0.1, -1), 300);
  const Frame frame = glide(renderer, Vec3(-3, 0.1, -1), Vec3(3, 0.1, -1), 300);
  ASSERT_TRUE(frame.contact);
  EXPECT_EQ(frame.model, 1);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * 1.4, 1e-6);
  EXPECT_NEAR(frame.force_n.x(), -0.5 * 0.5 * 1.4, 1e-6);
  scene.models[1].surface.dent = {0.5, 3.0, 20.0};
  const Registry& registry = toolkit_renderers();
  EXPECT_TRUE(test::refused(registry.check_supports(*registry.find("brute-force"), scene), "dent"));
}

TEST(ManyModels, TwoWallsOfACornerConstrainJointly) {
  SceneInput scene;
  scene.models.push_back(plane_at(Vec3::Zero()));
  ModelInput wall = plane_at(Vec3::Zero());
  wall.world_from_model.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2, Vec3::UnitY()));
  wall.world_from_model.translation_mm =
      -(wall.world_from_model.rotation * wall.cloud->box_mm().centre_mm());  // the plane x = 0
  scene.models.push_back(wall);
  for (const char* spec : {"cloud", "brute-force", "analytic", "heightfield"}) {
    SCOPED_TRACE(spec);
    const auto joint = prepared(scene, spec);
    joint->restart(Vec3(2, 0, 2));
    const Frame frame = glide(joint, Vec3(2, 0.1, 2), Vec3(-1, 0.1, -2), 400);
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
  const auto force = [&](const std::string& spec) {
    const auto renderer = prepared(scene, spec);
    renderer->restart(Vec3(0, 0, 1));
    return glide(renderer, Vec3(0, 0, 1), Vec3(0, 0, -1), 200).force_n;
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
      const Vec3 start(0.1, 0.2, 2);
      renderer->restart(start);
      (void)glide(renderer, start, hip, 200);
      // To and fro under all of them: nothing of another model's state may come into it.
      for (int i = 0; i <= 200; ++i)
        (void)renderer->step(hip + Vec3(8 * std::sin(0.1 * i), 5 * std::sin(0.07 * i), 0), kMotionDt);
      const Frame frame = renderer->step(hip, kMotionDt);
      status = frame.status;
      EXPECT_TRUE(frame.contact);
      const auto deepest = std::max_element(height.begin(), height.end());
      EXPECT_EQ(frame.model, deepest - height.begin());
      EXPECT_FALSE(glide(renderer, hip, start, 200).contact);
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

// None is dropped because others came first: as many planes as three vertices of meshes give.
TEST(ManyModels, JointPlanesKnowTheirOwners) {
  Random random(23);
  const auto unit = [&] { return Vec3(random.normal(), random.normal(), random.normal()).normalized(); };
  JointPlanes planes;
  for (std::size_t i = 0; i < 48; ++i) {  // of eight touches at vertices of six facets
    const geometry::HalfSpace plane{unit(), -random.uniform()};
    planes.begin(i % 5);
    planes.add(plane);
    ASSERT_EQ(planes.planes().size(), i + 1);
    EXPECT_EQ(planes.owner(i), i % 5);
    EXPECT_EQ(planes.planes()[i].normal, plane.normal);
    EXPECT_EQ(planes.planes()[i].offset, plane.offset);
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
    (void)renderer->step(over, kMotionDt);  // a jump from one place in free space to another
    const Vec3 way(0.3, 0.2, -7.0);
    alone->restart(over - Vec3(60.0 * model, 0, 0));
    for (int i = 1; i <= 100; ++i) {
      const Vec3 h = over + way * (0.01 * i);
      const Frame a = renderer->step(h, kMotionDt);
      const Frame b = alone->step(h - Vec3(60.0 * model, 0, 0), kMotionDt);
      ASSERT_EQ(a.contact, b.contact) << visit << " " << i;
      if (a.contact) {
        EXPECT_EQ(a.model, static_cast<std::int32_t>(model));
        EXPECT_LT((a.force_n - b.force_n).norm(), 1e-9);
      }
    }
    (void)renderer->step(over, kMotionDt);
  }
}

TEST(ManyModels, OneThatIsTouchedStaysHoweverDeep) {
  const SceneInput scene = row_of(3);
  const auto renderer = prepared(scene, "cloud");
  renderer->restart(Vec3(60, 0, 5));
  for (int i = 0; i <= 500; ++i) {
    const Frame frame = renderer->step(Vec3(60.2, 0.1, 5 - 0.2 * i), kMotionDt);
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
  for (int i = 0; i < 600; ++i) frame = renderer->step(hip, kMotionDt);
  EXPECT_TRUE(frame.contact);
  EXPECT_EQ(frame.model, 20);
  EXPECT_NEAR(frame.force_n.z(), 0.5 * 1.0, 1e-6);
}

}  // namespace
}  // namespace palpate::render
