// Models that move.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/toolkit/renderers/scenes.h"

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

TEST(Motion, APlaneRisingPastARestingProbeIsFeltAndNeverLost) {
  int lost = 0, runs = 0;
  for (const double speed : {5.0, 20.0, 50.0, 100.0, 200.0, 500.0})
    for (int run = 0; run < 20; ++run) {
      ScriptedMotion motion;
      motion.velocity_mm_s = Vec3(0, 0, speed);
      motion.stop_s = 3.0 / speed;  // 1 mm below the probe to 2 mm above it
      const SceneInput scene = moving(motion, plane_at(Vec3(0.37 * run, 0.21 * run, -1.0)));
      const auto renderer = on_clock(scene, "cloud");
      const Vec3 hip(0.1 + 0.013 * run, 0.2, 0);
      renderer->restart(hip);
      const int frames = static_cast<int>(3.0 / speed / kMotionDt) + 200;
      bool before = false;
      bool missing = false;
      double force = 0.0;
      for (int i = 0; i < frames; ++i) {
        const Frame frame = renderer->step(hip, kMotionDt);
        missing |= before && !frame.contact;
        before = frame.contact;
        force = frame.force_n.z();
      }
      ++runs;
      lost += missing || !before;
      EXPECT_NEAR(force, 0.5 * 2.0, 1e-6) << speed << " mm/s, run " << run;
    }
  EXPECT_EQ(lost, 0) << "of " << runs;
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
  const Scene still = generated("sphere:points=20000:extent_mm=20");
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
  const Scene still = generated("sphere:points=20000:extent_mm=20");
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
  const auto count = [&] { return model.courses()->load(); };
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

TEST(Motion, ATurningPlaneIsNeverLost) {
  ScriptedMotion motion;
  motion.angular_velocity_rad_s = Vec3(1, 0, 0);
  motion.start_s = 0.5;
  motion.stop_s = 0.7;
  const SceneInput scene = moving(motion, plane_at(Vec3::Zero(), 0.2));
  const auto renderer = on_clock(scene, "cloud");
  renderer->restart(Vec3(0, 3, 1));
  for (int i = 0; i < 500; ++i) (void)renderer->step(Vec3(0, 3, 1 - 0.004 * i), kMotionDt);
  for (int i = 0; i < 400; ++i) ASSERT_TRUE(renderer->step(Vec3(0, 3, -1), kMotionDt).contact) << i;
  // The angle is 0.2 rad; the force is square to the plane and as deep as the probe is.
  const Frame last = renderer->step(Vec3(0, 3, -1), kMotionDt);
  const Vec3 normal(0, -std::sin(0.2), std::cos(0.2));
  EXPECT_NEAR(last.force_n.norm(), -0.5 * normal.dot(Vec3(0, 3, -1)), 1e-3);
  EXPECT_LT(last.force_n.normalized().cross(normal).norm(), 1e-3);
}

TEST(Motion, MovingModelAndMovingProbeAreTheSameThing) {
  // A sphere that moves on to the probe answers as a probe that moves on to the sphere.
  const Scene still = generated("sphere:points=20000");
  const double radius = 0.5 * still.input.models[0].cloud->box_mm().extent_mm().x();
  const Vec3 centre = still.input.models[0].cloud->box_mm().centre_mm();
  ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(30, 0, 0);
  const SceneInput scene = moving(motion, still.input.models[0]);
  const auto moved = on_clock(scene, "cloud");
  const auto rested = prepared(still.input, "cloud");
  const Vec3 hip = centre + Vec3(radius + 1.0, 0.3, 0.2);
  moved->restart(hip);
  rested->restart(hip);
  for (int i = 1; i <= 100; ++i) {
    const Frame a = moved->step(hip, kMotionDt);
    const Frame b = rested->step(hip - Vec3(30, 0, 0) * (kMotionDt * i), kMotionDt);
    ASSERT_EQ(a.contact, b.contact) << i;
    EXPECT_LT((a.force_n - b.force_n).norm(), 1e-6) << i;
  }
}

// The oracle reads every point in the model's own frame of that instant.
TEST(Motion, TheOracleFollowsAndAgrees) {
  const Scene still = generated("sphere:points=3000");
  const cloud::Cloud& cloud = *still.input.models[0].cloud;
  const Vec3 centre = cloud.box_mm().centre_mm();
  const double radius = 0.5 * cloud.box_mm().extent_mm().x();
  ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(10, 0, 3);
  motion.angular_velocity_rad_s = Vec3(0.3, 0.2, -0.5);
  motion.about_mm = centre;
  const SceneInput scene = moving(motion, still.input.models[0]);
  const auto moved = on_clock(scene, "brute-force");
  const auto cloud_moved = on_clock(scene, "cloud:shading=none");
  const auto rested = prepared(still.input, "brute-force");
  const Vec3 hip = centre + Vec3(radius + 1.0, 0.3, 0.2);
  moved->restart(hip);
  cloud_moved->restart(hip);
  rested->restart(hip);
  int contacts = 0, agree = 0;
  for (int i = 1; i <= 300; ++i) {
    const geometry::RigidTransform pose = motion.at(kMotionDt * i).world_from_model;
    const Frame a = moved->step(hip, kMotionDt), b = rested->step(pose.inverse() * hip, kMotionDt),
                c = cloud_moved->step(hip, kMotionDt);
    ASSERT_EQ(a.contact, b.contact) << i;
    EXPECT_LT((a.force_n - pose.rotate(b.force_n)).norm(), 1e-9) << i;
    EXPECT_LT((a.god_object_mm - (b.contact ? Vec3(pose * b.god_object_mm) : hip)).norm(), 1e-9) << i;
    contacts += a.contact;
    agree += a.contact && c.contact && (a.force_n - c.force_n).norm() < 1e-9;
  }
  EXPECT_GT(contacts, 150);
  EXPECT_GT(agree, 0.95 * contacts);
}

}  // namespace
}  // namespace palpate::render
