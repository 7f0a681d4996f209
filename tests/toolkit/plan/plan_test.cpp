// The plan says what the renderer that it chooses decides.
#include "toolkit/plan/plan.h"
#include "toolkit/renderers/toolkit_renderers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"

namespace palpate::plan {
namespace {

using render::Decision;

const Decision* find(const std::vector<Decision>& decisions, const std::string& about) {
  const auto at =
      std::find_if(decisions.begin(), decisions.end(), [&](const Decision& d) { return d.about == about; });
  return at == decisions.end() ? nullptr : &*at;
}

std::string choice(const std::vector<Decision>& decisions, const std::string& about) {
  const Decision* d = find(decisions, about);
  return d == nullptr ? "nothing said" : d->choice;
}

Result<Plan> try_plan(const render::SceneInput& scene, const std::string& renderer = {}) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  std::optional<NamedOptions> wanted;
  if (!renderer.empty()) wanted = parse_named_options(renderer).value();
  return make_plan(scene, wanted, registry, {1, nullptr});
}

Plan planned(const render::SceneInput& scene, const std::string& renderer = {}) {
  return try_plan(scene, renderer).value();
}

render::PrepareReport built(const render::SceneInput& scene, const std::string& name) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  const NamedOptions named = parse_named_options(name).value();
  return registry.make(named.name, named.options).value()->prepare(scene, {1, nullptr}).value();
}

TEST(Plan, HeightFieldsTakeTheirOwnRenderer) {
  EXPECT_EQ(planned(render::generated("sinusoid:points=10201").input).renderer.name, "heightfield");
  EXPECT_EQ(planned(render::generated("sphere:points=10000").input).renderer.name, "cloud-smooth");
  EXPECT_EQ(planned(render::generated("sinusoid:points=10201:jitter=0.4").input).renderer.name,
            "cloud-smooth");
}

TEST(Plan, PointsTakeTheSmoothCloudWhateverTheirNoise) {
  for (const char* noise : {"0", "0.05", "0.15", "0.3"}) {
    const std::string spec = std::string("torus:points=20000:sampling=random:mesh=false:noise=") + noise;
    const Plan plan = planned(render::generated(spec).input);
    EXPECT_EQ(plan.renderer.name, "cloud-smooth") << noise;
    EXPECT_NE(find(plan.decided.decisions, "renderer")->reason.find("noise of"), std::string::npos) << noise;
  }
  // Points that give way do so on cloud alone, however noisy they are.
  render::Scene scene = render::generated("torus:points=5000:sampling=random:mesh=false:noise=0.3");
  scene.input.models[0].surface.dent = {0.5, 3.0, 20.0};
  EXPECT_EQ(planned(scene.input).renderer.name, "cloud");
}

/// From point to point the force moves by stiffness x spacing: triangles between points so near are not felt,
/// unless much noise leaves holes.
TEST(Plan, PointsCountOneByOneWhereTheyAreFelt) {
  render::Scene scene = render::generated("torus:points=20000:sampling=random:mesh=false:noise=0.15");
  const auto with = [&](double stiffness) {
    scene.input.models[0].surface.stiffness_n_per_mm = stiffness;
    return planned(scene.input).renderer.name;
  };
  EXPECT_EQ(with(0.5), "cloud-smooth");
  EXPECT_EQ(with(0.01), "cloud");
  scene = render::generated("torus:points=20000:sampling=random:mesh=false:noise=0.3");
  EXPECT_EQ(with(0.01), "cloud-smooth");
}

TEST(Plan, NoisyHeightFieldsTakeTheSmoothCloud) {
  for (const auto& [noise, renderer] :
       std::vector<std::pair<double, const char*>>{{0.02, "heightfield"}, {0.25, "cloud-smooth"}}) {
    Random random(71);
    std::vector<Vec3> posts;
    for (int row = 0; row < 120; ++row)
      for (int column = 0; column < 140; ++column)
        posts.push_back(
            Vec3{0.5 * column, 0.5 * row, 3.0 * std::sin(0.1 * column) + 0.5 * noise * random.normal()});
    render::Scene scene = render::generated("plane:points=100");
    scene.input.models[0].cloud =
        std::make_shared<cloud::Cloud>(cloud::build_cloud(posts, cloud::NonFinite::kRefuse).value());
    const Plan plan = planned(scene.input);
    EXPECT_EQ(plan.renderer.name, renderer) << noise;
    EXPECT_NE(find(plan.decided.decisions, "renderer")->reason.find("height field on"), std::string::npos);
  }
}

TEST(Plan, PointsThatGiveWayTakeTheCloud) {
  render::Scene scene = render::generated("plane:extent_mm=40:spacing_mm=1");
  scene.input.models[0].surface.dent = {0.5, 3.0, 20.0};
  const Plan plan = planned(scene.input);
  EXPECT_EQ(plan.renderer.name, "cloud");
  EXPECT_NE(find(plan.decided.models[0].decisions, "deformable geometry"), nullptr);
}

TEST(Plan, WhatIsGivenIsTakenAndSaid) {
  const Plan plan = planned(render::generated("sinusoid:points=10201").input, "cloud:shading=none");
  EXPECT_EQ(plan.renderer.name, "cloud");
  EXPECT_TRUE(find(plan.decided.decisions, "renderer")->given);
  EXPECT_EQ(choice(plan.decided.models[0].decisions, "shading"), "none");
  EXPECT_TRUE(find(plan.decided.models[0].decisions, "shading")->given);
}

/// A flat square scan of 21 x 21 points, the distance to its diagonal neighbours `diagonal_mm` but for what
/// float coordinates round it to, which is returned.
render::SceneInput flat_grid(double diagonal_mm, double& stored_diagonal_mm) {
  const double step = diagonal_mm / std::sqrt(2.0);
  std::vector<Vec3> points;
  for (int row = 0; row <= 20; ++row)
    for (int column = 0; column <= 20; ++column) points.emplace_back(column * step, row * step, 0.0);
  render::SceneInput scene = render::cloud_of(points);
  auto scan = std::make_shared<cloud::Cloud>(*scene.models[0].cloud);
  scan->raster = cloud::ScanRaster{21, 21};
  scene.models[0].cloud = scan;
  const cloud::Cloud& cloud = *scan;
  double most_sq = 0.0;
  for (std::size_t i = 0; i < 20 * 21; ++i) {
    if (i % 21 < 20) most_sq = std::max(most_sq, (cloud.local_mm(i + 22) - cloud.local_mm(i)).squaredNorm());
    if (i % 21 > 0) most_sq = std::max(most_sq, (cloud.local_mm(i + 20) - cloud.local_mm(i)).squaredNorm());
  }
  stored_diagonal_mm = std::sqrt(most_sq);
  return scene;
}

// The step of force is stiffness x the largest spacing: just under what is felt nothing is shaded, just over
// it everything that asks for it is, in the plan as in what is built.
// Only there is a facet's plane a choice.
constexpr const char* kOnVertices = "cloud:surface=vertices";

TEST(Plan, ShadingTurnsExactlyWhereAStepIsFelt) {
  constexpr double kStiffness = 0.5;
  const double felt_mm = kFeltForceStepN / kStiffness;
  int shaded = 0, bare = 0;
  for (const double share : {0.2, 0.999, 0.99999, 0.999999, 1.000001, 1.00001, 1.001, 5.0}) {
    SCOPED_TRACE(share);
    double spacing_mm = 0.0;
    const render::SceneInput scene = flat_grid(share * felt_mm, spacing_mm);
    const bool shades = kStiffness * spacing_mm > kFeltForceStepN;
    EXPECT_EQ(shades, share > 1.0) << "too near for float coordinates";
    (shades ? shaded : bare) += 1;
    const Plan plan = planned(scene, kOnVertices);
    EXPECT_DOUBLE_EQ(plan.decided.models[0].spacing_mm.value(), spacing_mm);
    const std::string wanted = shades ? "facet, where a point's spacing asks for it" : "none";
    EXPECT_EQ(choice(plan.decided.models[0].decisions, "shading"), wanted);
    EXPECT_EQ(choice(built(scene, kOnVertices).decisions.models[0].decisions, "shading"), wanted);
  }
  EXPECT_EQ(shaded, 4);
  EXPECT_EQ(bare, 4);
}

// Links as they will be walked, not the exact nearest: at the border of a scan those reach twice as far as
// the scanner's path does.
TEST(Plan, ShadingGoesByTheNeighboursThatAreBuilt) {
  const render::Scene scene = render::generated("sinusoid:points=10201:extent_mm=5:amplitude_mm=1");
  const double by_path = planned(scene.input, kOnVertices).decided.models[0].spacing_mm.value();
  const double nearest =
      planned(scene.input, "cloud:neighbours=exact-knn").decided.models[0].spacing_mm.value();
  ASSERT_GT(nearest, 1.5 * by_path);
  render::Scene between = scene;
  between.input.models[0].surface.stiffness_n_per_mm = kFeltForceStepN / std::sqrt(by_path * nearest);
  EXPECT_EQ(choice(planned(between.input, kOnVertices).decided.models[0].decisions, "shading"), "none");
  EXPECT_NE(
      choice(planned(between.input, "cloud:neighbours=exact-knn").decided.models[0].decisions, "shading"),
      "none");
}

TEST(Plan, FormsAsPrintedShadeByTheirOwnRule) {
  for (const auto& [spec, choice_of_shading] : std::vector<std::pair<const char*, const char*>>{
           {"plane:extent_mm=4:spacing_mm=0.1", "none"}, {"plane:extent_mm=8:spacing_mm=0.2", "area-raw"}})
    for (const char* renderer : {"cloud-literal", "heightfield-literal"})
      EXPECT_EQ(
          choice(planned(render::generated(spec).input, renderer).decided.models[0].decisions, "shading"),
          choice_of_shading)
          << spec << " " << renderer;
}

TEST(Plan, SurfacesCostBytesOnlyWhereTheyVary) {
  render::Scene scene = render::generated("plane:extent_mm=40:spacing_mm=1");
  const Plan bare = planned(scene.input, "cloud");
  EXPECT_EQ(choice(bare.decided.models[0].decisions, "friction"), "none");
  scene.input.models[0].surface.friction = {0.7, 0.5};
  const Plan uniform = planned(scene.input, "cloud");
  EXPECT_EQ(uniform.decided.bytes, bare.decided.bytes);
  auto properties = std::make_shared<surface::PointProperties>();
  properties->static_friction.assign(scene.input.models[0].cloud->size(), 0.5f);
  scene.input.models[0].surface.per_point = properties;
  const Plan varied = planned(scene.input, "cloud");
  EXPECT_EQ(varied.decided.bytes, bare.decided.bytes + 12 * varied.decided.models[0].points);
  EXPECT_EQ(choice(varied.decided.models[0].decisions, "friction"), "per point");
  EXPECT_EQ(planned(scene.input).renderer.name, "heightfield") << "which has properties per post too";
}

TEST(Plan, BytesAreThoseOfTheRenderer) {
  const render::Scene sphere = render::generated("sphere:points=100000");
  const auto held = static_cast<double>(built(sphere.input, "cloud").bytes);
  EXPECT_NEAR(static_cast<double>(planned(sphere.input, "cloud").decided.bytes), held, 0.05 * held);
  const render::Scene sheet = render::generated("sinusoid:points=10201");
  EXPECT_EQ(planned(sheet.input).decided.bytes, built(sheet.input, "heightfield").bytes);
}

TEST(Plan, TextSaysEveryDecision) {
  const Plan plan = planned(render::generated("sinusoid:points=10201").input);
  const std::string all = text(plan);
  EXPECT_NE(all.find("expected: some "), std::string::npos);
  for (const Decision& d : plan.decided.decisions)
    EXPECT_NE(all.find(d.reason), std::string::npos) << d.about;
  for (const Decision& d : plan.decided.models[0].decisions)
    EXPECT_NE(all.find(d.reason), std::string::npos) << d.about;
}

TEST(Plan, EmptySceneIsRefused) {
  EXPECT_FALSE(try_plan({}));
  EXPECT_FALSE(try_plan(render::generated("plane:extent_mm=40:spacing_mm=1").input, "nonsense"));
}

}  // namespace
}  // namespace palpate::plan
