// The behaviour suite counts what it says: the truth gets nothing wrong, and methods known to fail do.
#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "experiments/behaviours/matrix.h"
#include "experiments/session/session.h"

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

TEST(Behaviours, TheLiteralFormFeelsBoxesFromOutside) {
  EXPECT_GT(outcome("hovering", "cloud-literal").wrong, 1000u);
  EXPECT_GT(outcome("narrow-groove", "cloud-literal").wrong, 100u);
  EXPECT_EQ(outcome("hovering", "cloud").wrong, 0u);
  EXPECT_EQ(outcome("narrow-groove", "cloud").wrong, 0u);
}

TEST(Behaviours, TheCloudIsHeldInCreasesAndOnItsFace) {
  // The literal form stays on one flank and goes around the edge early.
  EXPECT_GT(outcome("concave-wedge", "cloud-literal").wrong, 50u);
  EXPECT_GT(outcome("ridge", "cloud-literal").wrong, 10u);
  EXPECT_EQ(outcome("concave-wedge", "cloud").wrong, 0u);
  EXPECT_EQ(outcome("ridge", "cloud").wrong, 0u);
}

TEST(Behaviours, ARefusedSceneIsNamed) {
  const BehaviourOutcome refused = outcome("thin-plate", "heightfield");
  EXPECT_NE(refused.failure, "");
  EXPECT_EQ(refused.of, 0u);
}

}  // namespace
}  // namespace palpate::experiments
