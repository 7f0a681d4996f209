// The plan decides as the renderers do.
#include "toolkit/plan/plan.h"
#include "toolkit/renderers/toolkit_renderers.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/toolkit/renderers/scenes.h"

namespace palpate::plan {
namespace {

const Decision* find(const std::vector<Decision>& decisions, const std::string& about) {
  const auto at =
      std::find_if(decisions.begin(), decisions.end(), [&](const Decision& d) { return d.about == about; });
  return at == decisions.end() ? nullptr : &*at;
}

std::string choice(const std::vector<Decision>& decisions, const std::string& about) {
  const Decision* d = find(decisions, about);
  return d == nullptr ? "nothing said" : d->choice;
}

Plan planned(const render::SceneInput& scene, const std::string& renderer = {}) {
  std::optional<NamedOptions> wanted;
  if (!renderer.empty()) wanted = parse_named_options(renderer).value();
  return make_plan(scene, wanted, 1).value();
}

std::unique_ptr<render::HapticRenderer> make(const std::string& name) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  return registry.make(name, {}).value();
}

TEST(Plan, HeightFieldsTakeTheirOwnRenderer) {
  EXPECT_EQ(planned(render::generated("sinusoid:points=10201").input).renderer.name, "heightfield");
  EXPECT_EQ(planned(render::generated("sphere:points=10000").input).renderer.name, "cloud");
  EXPECT_EQ(planned(render::generated("sinusoid:points=10201:jitter=0.4").input).renderer.name, "cloud");
}

TEST(Plan, PointsThatGiveWayTakeTheCloud) {
  render::Scene scene = render::generated("plane:extent_mm=40:spacing_mm=1");
  scene.input.models[0].surface.dent = {0.5, 3.0, 20.0};
  const Plan plan = planned(scene.input);
  EXPECT_EQ(plan.renderer.name, "cloud");
  EXPECT_NE(find(plan.models[0].decisions, "deformable geometry"), nullptr);
}

TEST(Plan, WhatIsGivenIsTakenAndSaid) {
  const Plan plan = planned(render::generated("sinusoid:points=10201").input, "cloud:shading=none");
  EXPECT_EQ(plan.renderer.name, "cloud");
  EXPECT_TRUE(find(plan.decisions, "renderer")->given);
  EXPECT_EQ(choice(plan.models[0].decisions, "shading"), "none");
  EXPECT_TRUE(find(plan.models[0].decisions, "shading")->given);
}

// As the renderer itself decides: the force of one spacing, 0.5 N/mm times the diagonal of the grid, against
// 0.0275 N, which is a grid of 0.0389 mm. Close to it the plan, which measures nothing, may choose otherwise.
TEST(Plan, FineCloudsAreNotShadedAndCoarseOnesAreByTheFacet) {
  for (const auto& [spec, shaded] :
       std::vector<std::pair<const char*, bool>>{{"plane:extent_mm=1:spacing_mm=0.01", false},
                                                 {"plane:extent_mm=6:spacing_mm=0.06", true},
                                                 {"plane:extent_mm=40:spacing_mm=1", true}}) {
    SCOPED_TRACE(spec);
    const bool shades = shaded;  // a lambda cannot take a binding
    const render::Scene scene = render::generated(spec);
    const std::string planned_choice = choice(planned(scene.input, "cloud").models[0].decisions, "shading");
    EXPECT_EQ(planned_choice, shades ? "facet, where a point's spacing asks for it" : "none");
    const auto renderer = make("cloud");
    const auto notes = renderer->prepare(scene.input, {1, nullptr}).value().notes;
    EXPECT_EQ(std::count_if(notes.begin(), notes.end(),
                            [&](const std::string& note) {
                              return note.rfind(shades ? "shading: facet" : "shading: none", 0) == 0;
                            }),
              1);
  }
}

TEST(Plan, SurfacesCostBytesOnlyWhereTheyVary) {
  render::Scene scene = render::generated("plane:extent_mm=40:spacing_mm=1");
  const Plan bare = planned(scene.input, "cloud");
  EXPECT_EQ(choice(bare.models[0].decisions, "friction"), "none");
  scene.input.models[0].surface.friction = {0.7, 0.5};
  const Plan uniform = planned(scene.input, "cloud");
  EXPECT_EQ(uniform.bytes, bare.bytes);
  auto properties = std::make_shared<surface::PointProperties>();
  properties->static_friction.assign(scene.input.models[0].cloud->size(), 0.5f);
  scene.input.models[0].surface.per_point = properties;
  const Plan varied = planned(scene.input, "cloud");
  EXPECT_EQ(varied.bytes, bare.bytes + 12 * varied.models[0].points);
  EXPECT_EQ(choice(varied.models[0].decisions, "friction"), "per point");
  EXPECT_EQ(planned(scene.input).renderer.name, "heightfield") << "which has properties per post too";
}

TEST(Plan, BytesAreThoseOfTheRenderer) {
  const render::Scene scene = render::generated("sphere:points=100000");
  const double held = static_cast<double>(make("cloud")->prepare(scene.input, {1, nullptr}).value().bytes);
  EXPECT_NEAR(static_cast<double>(planned(scene.input).bytes), held, 0.1 * held);
}

TEST(Plan, TextSaysEveryDecision) {
  const Plan plan = planned(render::generated("sinusoid:points=10201").input);
  const std::string all = text(plan);
  for (const Decision& d : plan.decisions) EXPECT_NE(all.find(d.reason), std::string::npos) << d.about;
  for (const Decision& d : plan.models[0].decisions)
    EXPECT_NE(all.find(d.reason), std::string::npos) << d.about;
}

TEST(Plan, EmptySceneIsRefused) {
  EXPECT_FALSE(make_plan({}, std::nullopt, 1));
}

}  // namespace
}  // namespace palpate::plan
