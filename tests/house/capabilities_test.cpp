// The registry tells the truth: a supported feature changes the answers, and a scene with an unsupported one
// is refused with the names of renderers that have it.
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <palpate/replay.h>
#include "tests/house/all_renderers.h"
#include "tests/house/corpus_scene.h"

namespace palpate::house {
namespace {

using render::Feature;
using render::SceneInput;

struct Asking {
  Feature feature;
  std::function<void(SceneInput&)> ask;
};

void vary_points(SceneInput& scene) {
  auto values = std::make_shared<surface::PointProperties>();
  const std::size_t points = scene.models[0].cloud->size();
  for (std::size_t i = 0; i < points; ++i) values->deformation.push_back(2 * i < points ? 0.5f : 0.0f);
  scene.models[0].surface.per_point = std::move(values);
}

void move(SceneInput& scene) {
  auto simulation = std::make_shared<render::ScriptedSimulation>();
  render::ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(0, 0, 0.2);
  scene.models[0].motion = simulation->add(motion);
  scene.simulation = simulation;
}

void add_a_model(SceneInput& scene) {
  scene.models.push_back(scene.models[0]);
  scene.models.back().world_from_model.translation_mm = Vec3(2.0, 1.5, 0.25);
}

void expect_moves(SceneInput& scene) {
  scene.models[0].moves = std::make_shared<render::MoveQueue>();
}

const std::vector<Asking> kAskings = {
    {Feature::kFriction,
     [](SceneInput& s) {
       s.models[0].surface.friction = {0.7, 0.5};
     }},
    {Feature::kSoftness, [](SceneInput& s) { s.models[0].surface.deformation = 0.5; }},
    {Feature::kTexture,
     [](SceneInput& s) {
       s.models[0].surface.texture.kind = surface::TextureKind::kNoise;
       s.models[0].surface.texture.depth_mm = 0.1;
       s.models[0].surface.texture.wavelength_mm = 2.0;
     }},
    {Feature::kDent,
     [](SceneInput& s) {
       s.models[0].surface.dent = {0.2, 2.0, 20.0};
     }},
    {Feature::kPerPoint, vary_points},
    {Feature::kMotion, move},
    {Feature::kManyModels, add_a_model},
    {Feature::kMovedPoints, expect_moves},
};

/// Raises the model's first points by a millimetre at the first frame.
void lift_points(const render::ModelInput& model) {
  render::MoveBatch& batch = *model.moves->begin();
  const cloud::Cloud& cloud = *model.cloud;
  for (; batch.count < render::kMaxBatch && batch.count < cloud.size(); ++batch.count) {
    const std::uint32_t i = batch.count;
    batch.point[i] = i;
    batch.to_mm[i] = Vec3f(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i] + 1.0f);
  }
  model.moves->publish();
}

std::string hash_of(const render::Registry& registry, const render::RendererInfo& info,
                    const SceneInput& scene, const trace::ProbePath& path) {
  Options options;
  for (const OptionSpec& option : info.options)
    if (option.key == "mesh") options.set("mesh", "original");
  std::unique_ptr<render::HapticRenderer> renderer = registry.make(info.name, options).value();
  const auto prepared = renderer->prepare(scene, {});
  if (!prepared) return "refused: " + prepared.error().message();
  if (scene.models[0].moves != nullptr) lift_points(scene.models[0]);
  return trace::trace_hash(trace::replay(*renderer, path, scene.simulation.get()).value());
}

TEST(Capabilities, WhatIsSupportedIsFelt) {
  render::Registry registry;
  register_all_renderers(registry);
  const CorpusScene heights = load_corpus("ridge.toml", "ridge.csv");
  const CorpusScene formula = load_corpus("formula.toml", "plate.csv");
  for (const render::RendererInfo& info : registry.all()) {
    const CorpusScene& corpus = info.geometry == render::Geometry::kFormula ? formula : heights;
    const std::string plain = hash_of(registry, info, corpus.scene.input, corpus.path);
    ASSERT_FALSE(plain.starts_with("refused")) << info.name << " " << plain;
    for (const Asking& asking : kAskings) {
      SceneInput scene = corpus.scene.input;
      asking.ask(scene);
      ASSERT_TRUE(features_required_by(scene).has(asking.feature));
      SCOPED_TRACE(info.name + ": " + names_of(asking.feature).front());
      const Status fits = registry.check_supports(info, scene);
      ASSERT_EQ(fits.ok(), info.supports.has(asking.feature));
      if (!fits) {
        EXPECT_NE(fits.error().message().find("cloud"), std::string::npos)
            << "names who has it: " << fits.error().message();
        continue;
      }
      const std::string with = hash_of(registry, info, scene, corpus.path);
      EXPECT_FALSE(with.starts_with("refused")) << with;
      EXPECT_NE(with, plain) << "it is supported, and nothing is felt of it";
    }
  }
}

TEST(Capabilities, APlainSceneAsksForNothing) {
  const CorpusScene corpus = load_corpus("ridge.toml", "ridge.csv");
  EXPECT_TRUE(features_required_by(corpus.scene.input).empty());
}

}  // namespace
}  // namespace palpate::house
