// The hunt: that what breaks a promise is seen, that trials are the same from run to run, and the command.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include <palpate/accuracy.h>
#include "experiments/hunt/found.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

/// A plane of 400 points, a stroke through its middle and a way back.
Quarry stroke_through_a_plane() {
  Quarry quarry;
  quarry.shape = "plane";
  quarry.points = 400;
  quarry.sampling = "grid";
  quarry.way = {{Waypoint::Kind::kFree, {0, 0, -20}, 0, 0, 50},
                {Waypoint::Kind::kFree, {0, 0, 20}, 0, 0, 50}};
  return quarry;
}

/// A hand on a plane of 2,500 points, half a millimetre apart.
Quarry hand_on_a_plane() {
  Quarry quarry;
  quarry.shape = "plane";
  quarry.points = 2500;
  quarry.scale = 0.25;
  quarry.sampling = "grid";
  quarry.hand = HandWay{0.6, 60.0, 0.5, 3};
  return quarry;
}

/// Feels the plane z = 0 from above, as it should or otherwise.
class Fake final : public render::SceneFreeRenderer {
 public:
  using Spoil = std::function<void(const Vec3& hip, render::Frame& frame)>;
  explicit Fake(Spoil spoil) : spoil_(std::move(spoil)) {}
  render::Frame step(const Vec3& hip, double) noexcept override {
    render::Frame frame;
    frame.contact = hip.z() < 0.0;
    frame.god_object_mm = frame.contact ? Vec3(hip.x(), hip.y(), 0.0) : hip;
    frame.model = frame.contact ? 0 : -1;
    spoil_(hip, frame);
    frame.force_n += 0.5 * (frame.god_object_mm - hip);
    return frame;
  }
  render::Description describe() const override { return {}; }

 private:
  Spoil spoil_;
};

Trial tried(Fake::Spoil spoil, const Quarry& quarry = stroke_through_a_plane()) {
  const HuntScene scene = make_scene(quarry).value();
  Fake fake(std::move(spoil));
  return try_scene(scene, fake).value();
}
double score(const Trial& trial, HuntGoal goal) {
  return trial.worst[static_cast<std::size_t>(goal)].score;
}

TEST(Hunt, FindsNothingInARendererThatKeepsItsPromises) {
  const Trial trial = tried([](const Vec3&, render::Frame&) {});
  EXPECT_EQ(trial.fault, "");
  EXPECT_EQ(score(trial, HuntGoal::kStick), 0.0);
  EXPECT_EQ(score(trial, HuntGoal::kEnergy), 0.0);
  // Along a straight stroke the spring is as long as the way in it.
  EXPECT_GT(score(trial, HuntGoal::kForce), 0.9);
  EXPECT_LE(score(trial, HuntGoal::kForce), 1.0 + 1e-12);
  EXPECT_LE(score(trial, HuntGoal::kJump), 1.0 + 1e-9);
}

TEST(Hunt, SeesWhatIsBroken) {
  const auto nothing = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(tried([&](const Vec3&, render::Frame& f) { f.force_n.x() = nothing; }).fault, "");
  EXPECT_NE(tried([&](const Vec3&, render::Frame& f) { f.god_object_mm.z() = nothing; }).fault, "");
  EXPECT_NE(tried([](const Vec3&, render::Frame& f) { f.status = render::FrameStatus::kBoundHit; }).fault,
            "");
  EXPECT_NE(tried([](const Vec3&, render::Frame& f) { f.force_n.x() = f.contact ? 0.0 : 1.0; }).fault, "");
  int frames = 0;
  EXPECT_NE(tried([&](const Vec3&, render::Frame& f) { f.force_n.x() = f.contact ? ++frames : 0; }).fault,
            "");
}

TEST(Hunt, ScoresContactThatSticksEnergyAndForce) {
  bool stuck = false;
  const Trial sticks = tried([&](const Vec3& hip, render::Frame& f) {
    stuck = stuck || f.contact;
    f.contact = stuck;
    f.god_object_mm = stuck ? Vec3(hip.x(), hip.y(), 0.0) : hip;
  });
  EXPECT_GT(score(sticks, HuntGoal::kStick), 10.0);
  // On the way back the spring is twice as long.
  double low = 0.0;
  const Trial kicks = tried([&](const Vec3& hip, render::Frame& f) {
    if (f.contact && hip.z() > low) f.god_object_mm.z() = -2.0 * hip.z();
    low = std::min(low, hip.z());
    if (!f.contact) low = 0.0;
  });
  EXPECT_GT(score(kicks, HuntGoal::kEnergy), 0.5);
  const Trial pushes = tried([](const Vec3&, render::Frame& f) {
    if (f.contact) f.force_n.z() = 100.0;
  });
  EXPECT_GT(score(pushes, HuntGoal::kForce), 2.0);
}

TEST(Hunt, FindsWhatAHandFeelsAsWrong) {
  const Quarry hand = hand_on_a_plane();
  const Trial right = tried([](const Vec3&, render::Frame&) {}, hand);
  EXPECT_EQ(right.fault, "");
  for (const HuntGoal goal : {HuntGoal::kCaught, HuntGoal::kLost}) EXPECT_EQ(score(right, goal), 0.0);
  EXPECT_LT(score(right, HuntGoal::kKick), 1e-12);

  const Trial caught =
      tried([](const Vec3&, render::Frame& f) { f.god_object_mm.x() += f.contact * 1.5; }, hand);
  EXPECT_GT(score(caught, HuntGoal::kCaught), 100.0);
  EXPECT_EQ(score(caught, HuntGoal::kLost), 0.0);
  const Trial lost = tried(
      [](const Vec3& hip, render::Frame& f) {
        f.contact = f.contact && hip.z() > -0.5;
        if (!f.contact) f.god_object_mm = hip;
      },
      hand);
  EXPECT_GT(score(lost, HuntGoal::kLost), 100.0);
  EXPECT_EQ(score(lost, HuntGoal::kCaught), 0.0);
  const Trial kick = tried(
      [](const Vec3& hip, render::Frame& f) {
        if (hip.z() < -0.5) f.force_n.z() = 2.0;
      },
      hand);
  EXPECT_NEAR(score(kick, HuntGoal::kKick), 2.0, 0.05);
  EXPECT_EQ(score(kick, HuntGoal::kCaught), 0.0);
}

TEST(Hunt, AHandIsJudgedWhereItsPointsTellTheShape) {
  Quarry quarry = hand_on_a_plane();
  ASSERT_TRUE(make_scene(quarry).ok());
  quarry.shape = "slab";  // 12.5 x 12.5 mm; points are 0.35 mm apart
  quarry.form.set("thickness_mm", "8");
  quarry.hand->force_n = 0.2;
  EXPECT_TRUE(make_scene(quarry).ok());
  quarry.hand->force_n = 0.6;
  EXPECT_FALSE(make_scene(quarry).ok()) << "pressed by 1.2 mm, deeper than a quarter of its two";
  quarry.hand->force_n = 0.1;
  quarry.form.set("thickness_mm", "4");
  EXPECT_FALSE(make_scene(quarry).ok()) << "thinner than four spacings";
}

TEST(Hunt, AQuarryIsWrittenAndReadToTheBit) {
  const render::Registry registry = all_renderers();
  const Ground ground{registry.find("cloud")->options, false};
  Random random(7);
  Quarry quarry = random_quarry(random, ground);
  int hands = 0;
  for (int k = 0; k < 200; ++k) {
    hands += quarry.hand.has_value();
    const std::string text = to_text(quarry);
    Quarry read;
    ASSERT_TRUE(from_text(text, read));
    EXPECT_EQ(to_text(read), text);
    quarry = k % 20 == 0 ? random_quarry(random, ground) : mutated(quarry, random, ground);
  }
  EXPECT_GT(hands, 0);
  EXPECT_LT(hands, 200);
  EXPECT_FALSE(from_text("{\"shape\": 3}", quarry));
}

TEST(Hunt, WhatWasFoundIsGoneOnWith) {
  HuntState state;
  state.quests.push_back({{"cloud", "cloud", {}, {}}, {}, {}, 3, 1, 2, 1});
  state.quests[0].worst[1] = Found{0.75, 17, 4, stroke_through_a_plane()};
  state.quests[0].faults.push_back({"what", 18, stroke_through_a_plane()});
  state.next_trial = 19;
  HuntState again;
  again.quests.push_back({{"cloud", "cloud", {}, {}}, {}, {}, 0, 0, 0, 0});
  ASSERT_TRUE(from_text(to_text(state), again));
  EXPECT_EQ(to_text(again), to_text(state));
  HuntState other;
  other.quests.push_back({{"heightfield", "heightfield", {}, {}}, {}, {}, 0, 0, 0, 0});
  EXPECT_FALSE(from_text(to_text(state), other));
}

class HuntCommand : public OnCommandLine {};

TEST_F(HuntCommand, AHandsCaseIsThePointsThePathAndTheTruthThatWereTried) {
  Quarry quarry = hand_on_a_plane();
  quarry.shape = "relief";
  quarry.form.set("finest_mm", "50");
  quarry.noise = 0.2;
  const HuntScene tried = make_scene(quarry).value();
  const OutputFolder folder = OutputFolder::open(in("case")).value();
  ASSERT_TRUE(folder.begin("case").ok());
  ASSERT_TRUE(write_case(folder, "one", quarry, {"cloud", {}}).ok());
  StageRequest request;
  request.scene = scene::open_scene(in("case/one.toml")).value();
  request.path = in("case/one.csv");
  const Stage stage = set_up(request, io::Readers(), no_progress()).value();
  EXPECT_EQ(trace::path_hash(stage.path), trace::path_hash(tried.path));
  EXPECT_EQ(trace::trace_hash(metrics::as_trace(*stage.reference)),
            trace::trace_hash(metrics::as_trace(*tried.truth)));
  const cloud::Cloud &read = *stage.scene.input.models[0].cloud, &had = *tried.input.models[0].cloud;
  EXPECT_EQ(read.z_mm, had.z_mm);
  EXPECT_EQ(stage.reference->frames.back().local_resolution_mm,
            tried.truth->frames.back().local_resolution_mm);
}

TEST_F(HuntCommand, TheSameTrialsFindTheSameAndACaseReplaysAlone) {
  json first;
  for (const char* out : {"one", "two"}) {
    succeeds("test hunt --renderers cloud,heightfield --as-given --trials 24 --seed 3 --out", in(out));
    const std::string text = text_in(std::string(out) + "/hunt.json");
    expect_valid("hunt", text);
    json found = json::parse(text);
    found["spent_s"] = 0.0;
    for (json& renderer : found["renderers"])
      for (json& worst : renderer["worst"]) worst["command"] = "";
    if (first.is_null()) first = found;
    EXPECT_EQ(found, first);
  }
  const json& worst = first["renderers"][0]["worst"];
  ASSERT_FALSE(worst.empty());
  const std::string scene = in("one/" + worst[0]["case"].get<std::string>());
  const std::string path = scene.substr(0, scene.rfind('.')) + ".csv";
  succeeds("compare", scene, "--path", path, "--reference none --passes 1 --out @/alone --renderers auto");
}

TEST_F(HuntCommand, BadInputIsRefused) {
  refuses({}, "test hunt --renderers clod --trials 2 --out @/out");
  refuses({}, "test hunt --minutes -1 --out @/out");
}

}  // namespace
}  // namespace palpate::experiments
