// The behaviour suite counts what it says: the truth gets nothing wrong, and methods known to fail do.

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string_view>

#include <palpate/accuracy.h>
#include "experiments/behaviours/behaviour.h"
#include "experiments/report/findings.h"
#include "experiments/report/page.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"
#include "toolkit/render/correction_ramp.h"

namespace palpate::experiments {
namespace {

const std::vector<Behaviour>& suite() {
  static const Result<std::vector<Behaviour>> made = behaviour_suite(no_progress());
  EXPECT_TRUE(made) << (made ? "" : made.error().message());
  return *made;
}

const Behaviour& behaviour(const std::string& id) {
  for (const Behaviour& b : suite())
    if (b.id == id) return b;
  throw std::runtime_error("no behaviour " + id);
}

BehaviourOutcome outcome(const std::string& id, const std::string& renderer) {
  const render::Registry registry = all_renderers();
  return observe(behaviour(id), parse_renderers(renderer, registry).value().front(), registry, 1,
                 no_progress());
}

TEST(Behaviours, TheTruthGetsNothingWrong) {
  const render::Registry registry = all_renderers();
  const BehaviourMatrix matrix =
      run_behaviours(suite(), {{"analytic", "analytic", {}}}, registry, 1, no_progress()).value();
  ASSERT_EQ(matrix.outcomes.size(), 1u);
  ASSERT_EQ(matrix.outcomes[0].size(), suite().size());
  for (std::size_t b = 0; b < suite().size(); ++b) {
    const BehaviourOutcome& outcome = matrix.outcomes[0][b];
    EXPECT_EQ(outcome.failure, "");
    EXPECT_GT(outcome.of, 0u) << suite()[b].id;
    EXPECT_EQ(outcome.wrong, 0u) << suite()[b].id;
    EXPECT_FALSE(outcome.shown.empty()) << suite()[b].id;
  }
}

TEST(Behaviours, EveryStrokeTouchesWhatItIsAbout) {
  for (const Behaviour& b : suite())
    for (const Stroke& stroke : b.strokes) {
      const bool touches = std::any_of(stroke.truth.frames.begin(), stroke.truth.frames.end(),
                                       [](const trace::TruthFrame& t) { return t.frame.contact; });
      EXPECT_EQ(touches, b.id != "hovering") << b.id;
    }
}

TEST(Behaviours, NothingIsThrownOutOfPlatesAndCorners) {
  for (const char* renderer : {"cloud", "brute-force"})
    for (const char* id : {"thin-plate", "voronoi-corner"}) EXPECT_EQ(outcome(id, renderer).wrong, 0u) << id;
}

TEST(Behaviours, TheLiteralFormIsWrongWhereTheCloudIsRight) {
  // Boxes are felt from outside; in a crease it stays on one flank, and goes around an edge early.
  for (const auto& [id, least] : {std::pair{"hovering", 1000u}, std::pair{"narrow-groove", 100u},
                                  std::pair{"concave-wedge", 50u}, std::pair{"ridge", 10u}}) {
    EXPECT_GT(outcome(id, "cloud-literal").wrong, least) << id;
    // What jumps over the ridge's edge in each of five slides comes over frames.
    const unsigned spread = std::string_view(id) == "ridge" ? 5u * render::CorrectionRamp::kFrames : 0u;
    EXPECT_LE(outcome(id, "cloud").wrong, spread) << id;
  }
}

TEST(Behaviours, ARefusedSceneIsNamed) {
  const BehaviourOutcome refused = outcome("thin-plate", "heightfield");
  EXPECT_NE(refused.failure, "");
  EXPECT_EQ(refused.of, 0u);
}

// ---- What is said of renderers that answer otherwise than each other, on traces made by hand.

constexpr double kTick = 1e-3;
constexpr std::size_t kFrames = 400;
/// Frames whose first and last are just kMinArtefactS apart.
constexpr std::size_t kMomentFrames = static_cast<std::size_t>(metrics::kMinArtefactS / kTick + 0.5) + 1;

struct Away {
  std::size_t run = 0, begin = 0, frames = 0;
  Vec3 by = Vec3::Zero();
  bool contact = true;
};

/// Renderers that are held 2 mm above a HIP at 0.1 mm a frame along x, but for what is away.
StagedStudy study_of(const std::vector<std::string>& labels, const std::vector<Away>& away) {
  StagedStudy study;
  for (std::size_t i = 0; i < kFrames; ++i) {
    study.stage.path.t_s.push_back(static_cast<double>(i) * kTick);
    study.stage.path.hip_mm.emplace_back(0.1 * static_cast<double>(i), 5.0, -2.0);
  }
  for (const std::string& label : labels) {
    Run& run = study.runs.emplace_back();
    run.result.label = label;
    for (const Vec3& hip : study.stage.path.hip_mm) {
      render::Frame frame;
      frame.contact = true;
      frame.god_object_mm = hip + Vec3(0, 0, 2);
      frame.force_n = {0, 0, 1};
      run.trace.frames.push_back(frame);
    }
  }
  for (const Away& a : away)
    for (std::size_t i = a.begin; i < a.begin + a.frames; ++i) {
      render::Frame& frame = study.runs[a.run].trace.frames[i];
      frame.god_object_mm += a.by;
      frame.contact = a.contact;
      frame.force_n = a.contact ? Vec3(0, 0, 2.5) : Vec3(Vec3::Zero());
    }
  return study;
}

const Vec3 kFar(0, 0, 3);

TEST(Disagreement, NothingIsSaidOfRenderersThatAgree) {
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {})).empty());
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {{1, 100, 60, Vec3(0, 0, 0.9)}})).empty());
}

TEST(Disagreement, SaysWhereHowLongAndWhoStandsAlone) {
  const auto said = disagreements(study_of({"a", "b", "c"}, {{1, 100, 61, kFar}}));
  ASSERT_EQ(said.size(), 2u);
  EXPECT_EQ(
      said[0],
      "The renderers disagree by more than 1.00 mm in 1 stretch, 0.0600 s of 0.399 s: there is no truth that "
      "says who is right.");
  EXPECT_EQ(said[1],
            "b stands alone for 0.0600 s from 0.100 s on, the HIP at 10.0, 5.00, -2.00 mm: 2.50 N where it "
            "begins.");
}

TEST(Disagreement, SaysThatTheLoneOneFeelsNothing) {
  const auto said = disagreements(study_of({"a", "b", "c"}, {{2, 50, 41, Vec3(0, 0, -2), false}}));
  ASSERT_EQ(said.size(), 2u);
  EXPECT_EQ(said[1],
            "c stands alone for 0.0400 s from 0.0500 s on, the HIP at 5.00, 5.00, -2.00 mm: it feels "
            "nothing, the others do.");
}

TEST(Disagreement, WhatIsShorterThanAMomentIsNotTold) {
  EXPECT_TRUE(disagreements(study_of({"a", "b", "c"}, {{0, 9, kMomentFrames - 1, kFar}})).empty());
  // Half a frame of room, as times are rounded.
  EXPECT_EQ(disagreements(study_of({"a", "b", "c"}, {{0, 9, kMomentFrames + 1, kFar}})).size(), 2u);
}

TEST(Disagreement, OfTwoAndOfThreeThatAreAllApartNobodyStandsAlone) {
  const auto two = disagreements(study_of({"a", "b"}, {{1, 0, 100, Vec3(0, 0, -2), false}}));
  ASSERT_EQ(two.size(), 2u);
  EXPECT_EQ(
      two[1],
      "There is no majority for 0.0990 s from 0 s on, the HIP at 0, 5.00, -2.00 mm: a, b (feels nothing).");
  const auto three = disagreements(study_of({"a", "b", "c"}, {{1, 20, 100, kFar}, {2, 20, 100, -kFar}}));
  ASSERT_EQ(three.size(), 2u);
  EXPECT_THAT(three[1], HasSubstr("no majority"));
}

TEST(Disagreement, ListsTheLongestFew) {
  const auto said = disagreements(study_of(
      {"a", "b", "c"}, {{0, 0, 31, kFar}, {1, 50, 61, kFar}, {2, 150, 41, kFar}, {0, 220, 51, kFar}}));
  ASSERT_EQ(said.size(), 4u);
  EXPECT_THAT(said[0], HasSubstr("in 4 stretches, 0.180 s of"));
  for (std::size_t i = 1; i < said.size(); ++i)
    EXPECT_TRUE(said[i].starts_with(i == 1 ? "b" : i == 2 ? "a" : "c")) << said[i];
}

TEST(Disagreement, IsNotSaidOfCoarsePointsOrHalfARunNorWhereThereIsATruth) {
  StagedStudy study = study_of({"a", "b", "c"}, {{1, 100, 61, kFar}});
  study.stage.spacing.nearest_mm.p50 = 1.4;
  EXPECT_EQ(disagreements(study).size(), 2u);
  study.stage.spacing.nearest_mm.p50 = 1.6;
  EXPECT_TRUE(disagreements(study).empty()) << "two spacings";
  study.stage.spacing.nearest_mm.p50 = 1.4;
  study.stage.reference.emplace();
  EXPECT_TRUE(disagreements(study).empty()) << "the truth says who is right";
  StagedStudy two = study_of({"a", "b"}, {{1, 100, 61, kFar}});
  two.runs[1].trace.frames.clear();
  EXPECT_TRUE(disagreements(two).empty()) << "one has no whole trace";
}

// ---- Renderers that cheat, registered like any other and run like any other: no score, no headline and no
// card may call them good. And a renderer that crashes takes nobody along.

enum class Cheat { kNone, kNoForce, kLate, kTrembles, kLies, kCrashes };

/// The exact answer, spoiled.
class Cheater final : public render::HapticRenderer {
 public:
  Cheater(std::unique_ptr<render::HapticRenderer> truth, Cheat cheat)
      : truth_(std::move(truth)), cheat_(cheat) {}
  Result<render::Decisions> decide(const render::SceneInput& s,
                                   const render::PrepareContext& c) const override {
    return truth_->decide(s, c);
  }
  Result<render::PrepareReport> prepare(const render::SceneInput& s,
                                        const render::PrepareContext& c) override {
    if (cheat_ == Cheat::kCrashes) ::raise(SIGKILL);
    return truth_->prepare(s, c);
  }
  void restart(const Vec3& hip, double t) noexcept override {
    truth_->restart(hip, t);
    frames_ = 0;
    late_.fill({});
    for (render::Frame& frame : late_) frame.god_object_mm = hip;
  }
  void release_contact(const Vec3& hip) noexcept override { truth_->release_contact(hip); }
  render::Frame step(const Vec3& hip, double t) noexcept override {
    render::Frame frame = truth_->step(hip, t);
    const std::size_t now = frames_++;
    if (cheat_ == Cheat::kNoForce) {
      frame.contact = false;
      frame.force_n.setZero();
      frame.god_object_mm = hip;
    } else if (cheat_ == Cheat::kLate) {
      std::swap(frame, late_[now % late_.size()]);
    } else if (cheat_ == Cheat::kTrembles && frame.contact) {
      frame.force_n *= now % 2 == 0 ? 1.06 : 0.94;
    } else if (cheat_ == Cheat::kLies) {
      frame.contact = false;
    }
    return frame;
  }
  stream::DepthReceiver* depth_receiver() noexcept override { return truth_->depth_receiver(); }
  render::FrameCounters counters() const noexcept override { return truth_->counters(); }
  render::Description describe() const override { return truth_->describe(); }

 private:
  std::unique_ptr<render::HapticRenderer> truth_;
  Cheat cheat_;
  std::size_t frames_ = 0;
  std::array<render::Frame, 30> late_;
};

render::Registry with_cheaters() {
  render::Registry registry = all_renderers();
  for (const auto& [name, cheat] : {std::pair{"honest", Cheat::kNone}, std::pair{"no-force", Cheat::kNoForce},
                                    std::pair{"late", Cheat::kLate}, std::pair{"trembles", Cheat::kTrembles},
                                    std::pair{"lies", Cheat::kLies}, std::pair{"crashes", Cheat::kCrashes}}) {
    render::RendererInfo info = *registry.find("analytic");
    info.name = name;
    info.role = render::Role::kRival;
    info.make = [make = info.make, cheat = cheat](const Options& options) {
      return std::unique_ptr<render::HapticRenderer>(new Cheater(make(options), cheat));
    };
    registry.add(std::move(info));
  }
  return registry;
}

class Dishonest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    study_ = new StagedStudy;
    const render::Registry registry = with_cheaters();
    StageRequest request;
    // Coarse: the tolerance of one resolution, 2.3 mm, is deeper than the path.
    request.scene_name = "sinusoid:points=2601:seed=1";
    request.scene = value_of(scene::open_scene(request.scene_name));
    request.path = "weave:frames=9000:depth_mm=1.5:seed=1";
    study_->stage = value_of(set_up(request, all_readers(), no_progress()));
    RunOptions options;
    options.passes = 3;
    const auto wanted = value_of(parse_renderers("honest,no-force,late,trembles,lies,crashes", registry));
    study_->runs = value_of(run_renderers(study_->stage, wanted, registry, options, no_progress(),
                                          study_->document.conditions.emplace(), {}));
    finish_document(*study_);
  }
  static void TearDownTestSuite() { delete study_; }
  static const metrics::RendererResult& of(const std::string& label) {
    for (const metrics::RendererResult& r : study_->document.renderers)
      if (r.label == label) return r;
    ADD_FAILURE() << label;
    return study_->document.renderers.front();
  }
  static std::string headline(const std::string& lead) {
    for (const Headline& line : headlines_of(study_->document))
      if (line.lead == lead) return line.text;
    return {};
  }
  static StagedStudy* study_;
};
StagedStudy* Dishonest::study_ = nullptr;

TEST_F(Dishonest, TheHonestOneIsGood) {
  const std::vector<CardItem> card = card_of(of("honest"));
  for (const CardItem& item : card)
    EXPECT_TRUE(item.known && item.kept) << item.about << " " << item.value << ", wanted " << item.limit;
  EXPECT_FALSE(card.empty());
}

TEST_F(Dishonest, NoCardIsKept) {
  for (const char* const label : {"no-force", "late", "trembles"}) {
    const std::vector<CardItem> card = card_of(of(label));
    ASSERT_FALSE(card.empty()) << label;
    EXPECT_FALSE(card.front().kept) << label << " " << card.front().value;
  }
  EXPECT_EQ(of("no-force").accuracy->indistinguishable_percent, 0.0);
  EXPECT_NEAR(*of("late").accuracy->lag_ms, 30.0, 1e-9);
  EXPECT_GT(*of("trembles").accuracy->jump_errors, 1000u);
}

TEST_F(Dishonest, NoHeadlineCallsThemRight) {
  EXPECT_TRUE(headline("Take").starts_with("honest: contact right")) << headline("Take");
  const std::string contact = headline("Contact");
  const std::size_t wrong = contact.find("wrong with");
  ASSERT_NE(wrong, std::string::npos) << contact;
  EXPECT_GT(contact.find("no-force"), wrong) << contact;
  EXPECT_LT(contact.find("honest"), wrong) << contact;
  EXPECT_EQ(headline("Frames that no hand tells from the truth").find("honest 100"), 0u)
      << headline("Frames that no hand tells from the truth");
}

TEST_F(Dishonest, TheirScoresStandOnThePage) {
  std::ifstream file(std::string(PALPATE_DOCS) + "/reference/scores.md");
  std::ostringstream page;
  page << file.rdbuf();
  std::vector<std::vector<CardItem>> cards;
  for (const char* const label : {"honest", "no-force", "late", "trembles"})
    cards.push_back(card_of(of(label)));
  // What is no more than rounding differs from one mathematical library to the next.
  const auto without_rounding = [](const std::string& value) {
    return value.find("×10⁻") != std::string::npos ? std::string("0") : value;
  };
  // All but the last item, which is a time.
  for (std::size_t i = 0; i + 1 < cards.front().size(); ++i) {
    std::string row = "| " + cards.front()[i].about + " | " + cards.front()[i].limit + " |";
    for (const std::vector<CardItem>& card : cards) row += " " + without_rounding(card[i].value) + " |";
    EXPECT_THAT(page.str(), HasSubstr(row + "\n"))
        << "docs/reference/scores.md, \"Those who cheat\", should have\n"
        << row;
  }
}

TEST_F(Dishonest, AFlagThatContradictsTheForceIsRefused) {
  EXPECT_EQ(of("lies").status, metrics::RunStatus::kFailed);
  EXPECT_THAT(of("lies").reason, HasSubstr("says that nothing is in contact"));
  EXPECT_FALSE(of("lies").accuracy.has_value());
}

TEST_F(Dishonest, ACrashIsOnesOwn) {
  if (!of("honest").timing->own_process) GTEST_SKIP() << "this build cannot fork";
  EXPECT_EQ(of("crashes").status, metrics::RunStatus::kFailed);
  EXPECT_THAT(of("crashes").reason, HasSubstr("signal 9"));
}

TEST_F(Dishonest, TimesAreOfTheSameFramesForAll) {
  const metrics::RendererResult& honest = of("honest");
  EXPECT_EQ(honest.timing->contact_of, "truth");
  EXPECT_EQ(honest.timing->in_turns_with, 3u);
  EXPECT_EQ(honest.frame->timed_frames, honest.accuracy->contact_frames);
  EXPECT_EQ(of("no-force").frame->timed_frames, honest.frame->timed_frames) << "though it says no contact";
  EXPECT_EQ(of("no-force").frame->contact_frames, 0u);
  EXPECT_EQ(honest.frame->passes, 3u);
  EXPECT_EQ(honest.frame->timed_frames + honest.frame_free->timed_frames, honest.frame_all->timed_frames);
  EXPECT_GT(honest.prepare_clock->wall_ms, 0.0);
  EXPECT_EQ(honest.prepare->total_ms, honest.prepare_clock->wall_ms) << "the harness's clock";
}

}  // namespace
}  // namespace palpate::experiments
