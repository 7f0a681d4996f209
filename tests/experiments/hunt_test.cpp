// The hunt: that what breaks a promise is seen, that trials are the same from run to run, and the command.
#include <nlohmann/json.hpp>

#include <cmath>
#include <limits>
#include <map>

#include <palpate/accuracy.h>
#include "experiments/hunt/hunt.h"
#include "experiments/hunt/input_json.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "toolkit/core/instruction_counter.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

/// A plane of 400 points, a stroke through its middle and a way back.
TrialInput stroke_through_a_plane() {
  TrialInput trial_input;
  trial_input.shape = "plane";
  trial_input.points = 400;
  trial_input.sampling = "grid";
  trial_input.way = {{Waypoint::Kind::kFree, {0, 0, -20}, 0, 0, 50},
                     {Waypoint::Kind::kFree, {0, 0, 20}, 0, 0, 50}};
  return trial_input;
}

/// A hand on a plane of 2,500 points, half a millimetre apart.
TrialInput hand_on_a_plane() {
  TrialInput trial_input;
  trial_input.shape = "plane";
  trial_input.points = 2500;
  trial_input.scale = 0.25;
  trial_input.sampling = "grid";
  trial_input.hand = HandWay{0.6, 60.0, 0.5, 3};
  return trial_input;
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

Trial tried(Fake::Spoil spoil, const TrialInput& trial_input = stroke_through_a_plane()) {
  const HuntScene scene = make_scene(trial_input).value();
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
  const TrialInput hand = hand_on_a_plane();
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
  TrialInput trial_input = hand_on_a_plane();
  ASSERT_TRUE(make_scene(trial_input).ok());
  trial_input.shape = "slab";  // 12.5 x 12.5 mm; points are 0.35 mm apart
  trial_input.form.set("thickness_mm", "8");
  trial_input.hand->force_n = 0.2;
  EXPECT_TRUE(make_scene(trial_input).ok());
  trial_input.hand->force_n = 0.6;
  EXPECT_FALSE(make_scene(trial_input).ok()) << "pressed by 1.2 mm, deeper than a quarter of its two";
  trial_input.hand->force_n = 0.1;
  trial_input.form.set("thickness_mm", "4");
  EXPECT_FALSE(make_scene(trial_input).ok()) << "thinner than four spacings";
}

TEST(Hunt, AQuarryIsWrittenAndReadToTheBit) {
  const render::Registry registry = all_renderers();
  const Ground ground{registry.find("cloud")->options, false};
  Random random(7);
  TrialInput trial_input = random_trial_input(random, ground);
  int hands = 0;
  for (int k = 0; k < 200; ++k) {
    hands += trial_input.hand.has_value();
    const std::string text = to_line(trial_input);
    TrialInput read;
    ASSERT_TRUE(from_line(text, read));
    EXPECT_EQ(to_line(read), text);
    trial_input = k % 20 == 0 ? random_trial_input(random, ground) : mutated(trial_input, random, ground);
  }
  EXPECT_GT(hands, 0);
  EXPECT_LT(hands, 200);
  EXPECT_FALSE(from_line("{\"shape\": 3}", trial_input));
}

TEST(Hunt, WhatWasFoundIsGoneOnWith) {
  Quest quest{{"cloud", "cloud", {}, {}}, {}, {}, 3, 1, 2, 1, 0.5};
  quest.worst[1] = Found{0.75, 17, 4, stroke_through_a_plane()};
  quest.faults.push_back({"what", 18, stroke_through_a_plane()});
  Quest again{{"cloud", "cloud", {}, {}}, {}, {}, 0, 0, 0, 0, 0.0};
  ASSERT_TRUE(from_line(to_line(quest), again));
  EXPECT_EQ(to_line(again), to_line(quest));
  EXPECT_EQ(again.renderer.label, "cloud");
  Quest other{{"heightfield", "heightfield", {}, {}}, {}, {}, 0, 0, 0, 0, 0.0};
  EXPECT_NE(key_of(quest.renderer), key_of(other.renderer)) << "of another renderer nothing is taken";
}

class HuntCommand : public OnCommandLine {};

TEST_F(HuntCommand, AHandsCaseIsThePointsThePathAndTheTruthThatWereTried) {
  TrialInput trial_input = hand_on_a_plane();
  trial_input.shape = "relief";
  trial_input.form.set("finest_mm", "50");
  trial_input.noise = 0.2;
  const HuntScene tried = make_scene(trial_input).value();
  const OutputFolder folder = OutputFolder::open(in("case")).value();
  ASSERT_TRUE(folder.begin("case").ok());
  ASSERT_TRUE(write_case(folder, "one", trial_input, {"cloud", {}}).ok());
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
    EXPECT_FALSE(found["commit"].get<std::string>().empty());
    for (const char* of_the_run : {"spent_s", "command", "started_utc"}) found.erase(of_the_run);
    for (json& renderer : found["renderers"])
      for (json& worst : renderer["worst"]) worst["command"] = "";
    if (first.is_null()) first = found;
    EXPECT_EQ(found, first);
  }
  // The page is drawn again from what is in the folder.
  const std::string page = text_in("one/report.html");
  EXPECT_THAT(page, HasSubstr("counted steps of one frame"));
  expect_valid("page", text_in("one/page.json"));
  std::filesystem::remove(in("one/report.html"));
  succeeds("report @/one");
  EXPECT_EQ(text_in("one/report.html"), page);
  // Of a version that kept none, the command is named that does.
  std::filesystem::remove(in("one/page.json"));
  refuses({"hunt.json: was written by `palpate test hunt ", " of palpate ",
           "which kept no page; run that command"},
          "report @/one");
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

// ---- palpate compare ablate and plan --check, as a user runs them, on tiny scenes.

// Everything that a surface, a motion and control can ask for; the path presses into both halves.
const char* const kMuch = R"(
[[model]]
generate = "sinusoid"
points = 961
extent_mm = 20
wavelength_mm = 20
amplitude_mm = 1
  [model.surface]
  stiffness_n_per_mm = 0.5
  friction = { static = 0.7, dynamic = 0.5 }
    [model.surface.texture]
    kind = "noise"
    depth_mm = 0.05
    wavelength_mm = 1.0
  [[model.region]]
  x_mm = [0, 100]
  deformation = 0.5
[[model]]
generate = "sphere"
points = 500
extent_mm = 4
position_mm = [0, 0, 4]
  [model.motion]
  velocity_mm_s = [0.5, 0, 0]
[renderer]
name = "cloud"
refine = 1
[control]
force_limit_n = 0.1
)";
const char* const kPress = "weave:frames=900:depth_mm=0.5:clearance_mm=0.3:period_frames=300:seed=1";

class Ablate : public OnCommandLine {
 protected:
  /// Instructions are counted in the program, started again.
  void count() { apart_ = true; }
  template <class... More>
  Words ablate(const std::string& scene, const std::string& out, const More&... more) const {
    return words("compare ablate", scene, "--path", kPress, "--out", in(out), more...);
  }
  json document(const std::string& out) const { return json_in(out + "/ablate.json"); }
  static std::map<std::string, json> by_stage(const json& document) {
    std::map<std::string, json> rows;
    for (const json& row : document["rows"])
      rows[row["stage"].is_null() ? std::string() : row["stage"].get<std::string>()] = row;
    return rows;
  }
};

TEST_F(Ablate, EveryStageOfASceneIsLeftOutInTurn) {
  count();
  write_text(in("much.toml"), kMuch);
  succeeds(ablate(in("much.toml"), "out"));
  expect_valid("ablate", text_in("out/ablate.json"));
  EXPECT_TRUE(exists("out/report.html"));
  const json whole_document = document("out");
  const std::map<std::string, json> rows = by_stage(whole_document);
  const json& whole = rows.at("");
  EXPECT_TRUE(whole["error_percent"].is_null());
  EXPECT_TRUE(whole["truth_percent"].is_null()) << "no truth knows friction";
  for (const char* stage : {"friction", "deformation", "texture", "motion", "model 1, sinusoid",
                            "model 2, sphere", "force limit", "option refine"}) {
    ASSERT_TRUE(rows.contains(stage)) << stage;
    EXPECT_EQ(rows.at(stage)["status"], "ok") << stage << rows.at(stage)["reason"];
    EXPECT_EQ(rows.at(stage)["saves"]["bytes"].get<double>(),
              whole["bytes"].get<double>() - rows.at(stage)["bytes"].get<double>());
  }
  EXPECT_EQ(rows.size(), 9u) << whole_document["rows"].dump(1);
  // What is left out is out: the answers differ, and by as much as the thing does.
  for (const char* stage : {"friction", "deformation", "texture", "force limit", "model 1, sinusoid"})
    EXPECT_GT(rows.at(stage)["error_percent"].get<double>(), 1.0) << stage;
  EXPECT_NEAR(rows.at("model 1, sinusoid")["error_percent"].get<double>(), 100.0, 15.0)
      << "the path is over it";
  EXPECT_GT(rows.at("deformation")["saves"]["bytes"].get<double>(), 0.0) << "it varies from point to point";
  EXPECT_EQ(rows.at("force limit")["saves"]["bytes"], 0.0);
  EXPECT_GT(rows.at("option refine")["saves"]["bytes"].get<double>(), 0.5 * whole["bytes"].get<double>());
}

TEST_F(Ablate, InstructionsAreTheSameOnEveryRun) {
  if (const Status able = can_count_instructions(); !able) GTEST_SKIP() << able.error().message();
  count();
  const std::string scene = "sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1";
  std::vector<std::map<std::string, json>> runs;
  for (const char* out : {"one", "two"}) {
    succeeds(ablate(scene, out, "--renderer cloud --friction 0.7,0.5"));
    runs.push_back(by_stage(document(out)));
  }
  for (const auto& [stage, row] : runs[0]) {
    EXPECT_EQ(row["instructions"], runs[1].at(stage)["instructions"]) << stage;
    EXPECT_EQ(row["trace_hash"], runs[1].at(stage)["trace_hash"]) << stage;
  }
  // A cone costs some dozen instructions in each frame of contact.
  EXPECT_GT(runs[0].at("friction")["saves"]["instructions"].get<double>(), 10.0);
}

TEST_F(Ablate, ASceneThatAsksForNothingIsSaidToNeedAllThatItHas) {
  const json answer = printed(ablate("sinusoid:points=961:extent_mm=20:wavelength_mm=20:amplitude_mm=1",
                                     "out", "--renderer cloud --budget 0 --json"));
  EXPECT_EQ(answer, document("out"));
  ASSERT_EQ(answer["rows"].size(), 1u);
  EXPECT_TRUE(answer["rows"][0]["instructions"].is_null());
  EXPECT_GT(answer["rows"][0]["truth_percent"].get<double>(), 0.0);
}

TEST_F(Ablate, CleaningIsAStageOfItsOwn) {
  write_text(in("clean.toml"), R"([[model]]
generate = "sinusoid"
points = 961
extent_mm = 20
wavelength_mm = 20
amplitude_mm = 1
  [[model.clean]]
  step = "thin"
  cell = 2.0
[renderer]
name = "cloud"
)");
  succeeds(ablate(in("clean.toml"), "out", "--budget 0"));
  const std::map<std::string, json> rows = by_stage(document("out"));
  ASSERT_TRUE(rows.contains("cleaning of the scene"));
  EXPECT_LT(rows.at("cleaning of the scene")["saves"]["bytes"].get<double>(), 0.0) << "more points are left";
}

TEST_F(Ablate, WhatIsWrongIsSaidAndLeavesNoFile) {
  write_text(in("typo.toml"), "[[model]]\ngenerat = \"plane\"\n");
  write_text(in("inside.csv"), "t_s,x_mm,y_mm,z_mm\n0,0,0,-5\n0.001,0,0,-5\n");
  for (const auto& [line, says] : std::vector<std::pair<const char*, const char*>>{
           {"@/typo.toml", "generat"},
           {"@/nothing.ply", "nothing.ply"},
           {"plane --renderer nonsense", "nonsense"},
           {"plane --renderer cloud,cloud-smooth", "one renderer"},
           {"plane --renderer cloud-smooth:detail=nan", "detail"},
           {"plane --budget nan", "budget"},
           {"plane --budget -1", "budget"},
           {"plane --friction 2,3", "friction"},
           {"plane --path @/inside.csv", "inside"}}) {
    refuses(says, "compare ablate", line, "--out @/out");
    EXPECT_FALSE(exists("out/ablate.json")) << says;
    EXPECT_FALSE(exists("out/report.html")) << says;
  }
}

TEST_F(Ablate, ThePlanIsCheckedByRunningIt) {
  Environment cache("XDG_CACHE_HOME", in("cache").c_str());
  for (const char* renderer : {"cloud", "cloud-smooth", "heightfield", "cloud-vertices"}) {
    const ProcessOutcome run =
        succeeds("info plan sinusoid:points=10201 --renderer", renderer, "--check --json");
    expect_valid("plan", run.out);
    const json plan = json::parse(run.out);
    EXPECT_LE(std::abs(plan["measured"]["bytes_off_percent"].get<double>()), 25.0) << renderer;
    EXPECT_GT(plan["measured"]["frame_us"].get<double>(), 0.0);
    EXPECT_FALSE(plan["measured"]["frame_off_percent"].is_null());
  }
  std::size_t kept = 0;
  for (const auto& file : std::filesystem::directory_iterator(in("cache/palpate")))
    kept += file.path().filename().string().starts_with("machine-");
  EXPECT_EQ(kept, 1u) << "this machine is measured once";
}

}  // namespace
}  // namespace palpate::experiments
