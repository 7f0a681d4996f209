// A simulated hand that feels: its path stays at the surface, and goes by what it feels alone.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "toolkit/cloud/generate.h"
#include "toolkit/trace/paths.h"

namespace palpate::trace {
namespace {

constexpr double kFeltNPerMm = 0.5;

/// A sphere's points, and the sphere as what is felt.
class HandOnSphere : public testing::Test {
 protected:
  void SetUp() override {
    target_.cloud = &made_.cloud;
    target_.box_mm = made_.cloud.box_mm();
    target_.stiffness_n_per_mm = kFeltNPerMm;
    target_.felt = [this]() -> Result<Feel> {
      ++asked_;
      return Feel([this](const Vec3& hip_mm) -> Vec3 {
        const Vec3 local = target_.world_from_model.inverse() * hip_mm;
        const double r = local.norm();
        if (r >= radius_ || r == 0.0) return Vec3::Zero();
        return target_.world_from_model.rotate(local / r * (kFeltNPerMm * (radius_ - r)));
      });
    };
  }
  [[nodiscard]] ProbePath path(const std::string& spec) const {
    auto made = make_path(parse_named_options(spec).value(), target_);
    EXPECT_TRUE(made) << (made ? "" : made.error().message());
    return made ? *std::move(made) : ProbePath{};
  }

  cloud::GeneratedModel made_ =
      cloud::generate(parse_named_options("sphere:points=20000:extent_mm=100").value()).value();
  double radius_ = 50.0;
  int asked_ = 0;
  PathTarget target_;
};

TEST_F(HandOnSphere, PressesDragsAndLifts) {
  const ProbePath all = path("hand:frames=40000:force_n=0.6:seed=3");
  ASSERT_EQ(all.size(), 40000u);
  EXPECT_EQ(asked_, 1);
  EXPECT_GT(all.hip_mm.front().norm(), radius_) << "it starts free";
  int touched = 0, entries = 0;
  double deepest = 0.0, highest = 0.0, way = 0.0, fastest = 0.0;
  bool before = false;
  Vec3 low = all.hip_mm.front(), high = low;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double depth = radius_ - all.hip_mm[i].norm();
    touched += depth > 0.0;
    entries += depth > 0.0 && !before;
    before = depth > 0.0;
    deepest = std::max(deepest, depth);
    highest = std::max(highest, -depth);
    low = low.cwiseMin(all.hip_mm[i]);
    high = high.cwiseMax(all.hip_mm[i]);
    if (i == 0) continue;
    const double step = (all.hip_mm[i] - all.hip_mm[i - 1]).norm();
    way += step;
    fastest = std::max(fastest, step * 1000.0);
  }
  EXPECT_GT(touched, 24000) << "a hand mostly touches";
  EXPECT_LT(touched, 39000);
  EXPECT_GT(entries, 10) << "and lifts";
  EXPECT_LT(deepest, 1.3 * 0.6 / kFeltNPerMm) << "never deeper than it presses";
  EXPECT_GT(deepest, 0.7 * 0.6 / kFeltNPerMm);
  EXPECT_LT(highest, 10.0);
  EXPECT_GT(way, 600.0) << "mm in 40 s";
  EXPECT_LE(fastest, 2.5 * 60.0 * (1.0 + 1e-9));
  EXPECT_GT((high - low).minCoeff(), 20.0) << "it gets around";
}

TEST_F(HandOnSphere, IsTheSameBitsAndAnotherWithAnotherSeed) {
  const ProbePath a = path("hand:frames=3000"), b = path("hand:frames=3000"),
                  c = path("hand:frames=3000:seed=2");
  EXPECT_EQ(a.hip_mm, b.hip_mm);
  EXPECT_NE(a.hip_mm, c.hip_mm);
  EXPECT_NE(a.name.find("force_n=0.6"), std::string::npos) << a.name;
}

TEST_F(HandOnSphere, AModelThatStandsElsewhereIsTouchedThere) {
  const ProbePath here = path("hand:frames=5000");
  target_.world_from_model.translation_mm = Vec3(300, -20, 7);
  target_.world_from_model.rotation = Eigen::Quaterniond(0.0, 0.0, 1.0, 0.0);
  const ProbePath there = path("hand:frames=5000");
  for (std::size_t i = 0; i < here.size(); i += 100)
    EXPECT_LT((target_.world_from_model * here.hip_mm[i] - there.hip_mm[i]).norm(), 1e-6) << i;
}

TEST_F(HandOnSphere, SlowSamplesAreStillSteppedFinely) {
  const ProbePath slow = path("hand:frames=400:rate_hz=20");
  double deepest = 0.0;
  for (const Vec3& hip : slow.hip_mm) deepest = std::max(deepest, radius_ - hip.norm());
  EXPECT_GT(deepest, 0.5);
  EXPECT_LT(deepest, 1.3 * 0.6 / kFeltNPerMm);
}

TEST_F(HandOnSphere, WhatLosesItsHandIsNotDivedThrough) {
  // It stops to push where the sphere is entered: the hand must not go through to the other side.
  target_.felt = []() -> Result<Feel> { return Feel([](const Vec3&) -> Vec3 { return Vec3::Zero(); }); };
  const ProbePath all = path("hand:frames=20000");
  for (const Vec3& hip : all.hip_mm) EXPECT_GT(hip.norm(), 0.8 * radius_);
}

TEST_F(HandOnSphere, RefusesWhatCannotBe) {
  const auto refusal = [&](const std::string& spec) {
    const auto made = make_path(parse_named_options(spec).value(), target_);
    return made ? std::string("accepted") : made.error().message();
  };
  EXPECT_NE(refusal("hand:slowest_mm_s=50:fastest_mm_s=20").find("more than"), std::string::npos);
  EXPECT_NE(refusal("hand:force_n=0").find("force_n"), std::string::npos);
  target_.felt = []() -> Result<Feel> { return Error{"it cannot be prepared", "", {}, 0}; };
  EXPECT_NE(refusal("hand").find("cannot be prepared"), std::string::npos);
  target_.felt = {};
  EXPECT_NE(refusal("hand").find("nothing is there to be felt"), std::string::npos);
}

/// Half a model: the hand stays on the points' own side and comes back from the border.
TEST(HandOnPlane, ComesBackFromTheBorderOfAnOpenScan) {
  const cloud::GeneratedModel made =
      cloud::generate(parse_named_options("plane:points=10000:extent_mm=60").value()).value();
  PathTarget target;
  target.cloud = &made.cloud;
  target.box_mm = made.cloud.box_mm();
  target.stiffness_n_per_mm = kFeltNPerMm;
  const geometry::Aabb box = made.cloud.box_mm();
  target.felt = [&]() -> Result<Feel> {
    return Feel([&](const Vec3& hip) -> Vec3 {
      const bool over = hip.x() >= box.low_mm.x() && hip.x() <= box.high_mm.x() &&
                        hip.y() >= box.low_mm.y() && hip.y() <= box.high_mm.y();
      return over && hip.z() < 0.0 ? Vec3(0.0, 0.0, -kFeltNPerMm * hip.z()) : Vec3(Vec3::Zero());
    });
  };
  const ProbePath all = make_path(parse_named_options("hand:frames=40000").value(), target).value();
  int touched = 0;
  for (const Vec3& hip : all.hip_mm) {
    EXPECT_GT(hip.z(), -8.0);
    EXPECT_LT((hip - box.centre_mm()).norm(), 60.0);
    touched += hip.z() < 0.0;
  }
  EXPECT_GT(touched, 16000);
}

}  // namespace
}  // namespace palpate::trace
