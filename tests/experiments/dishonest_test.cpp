// Renderers that cheat, registered like any other and run like any other: no score, no headline and no card
// may call them good. And a renderer that crashes takes nobody along.
#include <gtest/gtest.h>

#include <array>
#include <csignal>
#include <fstream>
#include <sstream>

#include "experiments/report/card.h"
#include "experiments/report/page.h"
#include "experiments/run/run.h"
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

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
    Result<scene::SceneFile> scene = scene::open_scene(request.scene_name);
    ASSERT_TRUE(scene) << scene.error().message();
    request.scene = *std::move(scene);
    request.path = "weave:frames=9000:depth_mm=1.5:seed=1";
    Result<Stage> stage = set_up(request, all_readers(), no_progress());
    ASSERT_TRUE(stage) << stage.error().message();
    study_->stage = *std::move(stage);
    RunOptions options;
    options.passes = 3;
    const Result<std::vector<RendererRequest>> wanted =
        parse_renderers("honest,no-force,late,trembles,lies,crashes", registry);
    ASSERT_TRUE(wanted);
    Result<std::vector<experiments::Run>> runs = run_renderers(
        study_->stage, *wanted, registry, options, no_progress(), study_->document.conditions.emplace(), {});
    ASSERT_TRUE(runs) << runs.error().message();
    study_->runs = *std::move(runs);
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
