// Immutable preparation is shared, and no renderer behaves differently for it.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <utility>

#include <palpate/model_store.h>
#include <palpate/replay.h>
#include "tests/house/corpus_scene.h"

namespace palpate::house {
namespace {

struct Ready {
  std::unique_ptr<render::HapticRenderer> renderer;
  render::PrepareReport report;
};

/// Prepared, or null if the renderer refuses the scene.
std::unique_ptr<Ready> ready(const render::Registry& registry, const render::RendererInfo& info,
                             const render::SceneInput& scene, render::ModelStore* store) {
  auto made = std::make_unique<Ready>();
  made->renderer = registry.make(info.name, with_own_mesh({info.name, {}}, info).options).value();
  render::PrepareContext context;
  context.store = store;
  Result<render::PrepareReport> report = made->renderer->prepare(scene, context);
  if (!report) return nullptr;
  made->report = std::move(*report);
  return made;
}

std::string hash_of(render::HapticRenderer& renderer, const CorpusScene& corpus) {
  return trace::trace_hash(trace::replay(renderer, corpus.path).value());
}

/// Rivals build what only they read; a formula is shared before any store.
bool shares(const std::string& name) {
  return name.starts_with("cloud") || name.starts_with("heightfield") || name.starts_with("mesh") ||
         name == "brute-force";
}

TEST(ModelStore, TwoRenderersHoldOneGeometryAndFeelTheSame) {
  const render::Registry registry = all_renderers();
  const std::pair<const char*, const char*> kStands[] = {{"ridge.toml", "ridge.csv"},
                                                         {"torus.toml", "torus.csv"}};
  std::size_t shared = 0;
  for (const auto& [scene_file, path_file] : kStands) {
    const CorpusScene corpus = load_corpus(scene_file, path_file);
    for (const render::RendererInfo& info : registry.all()) {
      SCOPED_TRACE(info.name + " on " + scene_file);
      std::unique_ptr<Ready> alone = ready(registry, info, corpus.scene.input, nullptr);
      if (!alone) continue;
      EXPECT_EQ(alone->report.shared_bytes, 0u);
      render::ModelStore store;
      std::unique_ptr<Ready> first = ready(registry, info, corpus.scene.input, &store);
      std::unique_ptr<Ready> second = ready(registry, info, corpus.scene.input, &store);
      ASSERT_TRUE(first && second);
      EXPECT_EQ(first->report.shared_bytes, 0u);
      EXPECT_EQ(second->report.bytes, first->report.bytes);
      // Embree's trees of one mesh differ by what its threads reserved.
      const auto bytes = static_cast<double>(alone->report.bytes);
      EXPECT_NEAR(static_cast<double>(first->report.bytes), bytes,
                  info.name.starts_with("mesh") ? 0.1 * bytes : 0.0);
      EXPECT_EQ(second->report.notes, alone->report.notes);
      EXPECT_EQ(second->report.warnings, alone->report.warnings);
      EXPECT_EQ(store.size(), shares(info.name) ? corpus.scene.input.models.size() : 0u);
      if (shares(info.name)) {
        ++shared;
        EXPECT_GT(second->report.shared_bytes, 0.8 * static_cast<double>(second->report.bytes));
      }
      // Each feels as if alone, whatever the other touched meanwhile.
      const std::string expected = hash_of(*alone->renderer, corpus);
      EXPECT_EQ(hash_of(*first->renderer, corpus), expected);
      EXPECT_EQ(hash_of(*second->renderer, corpus), expected);
      first.reset();
      EXPECT_EQ(hash_of(*second->renderer, corpus), expected);
      second.reset();
      EXPECT_EQ(store.size(), 0u) << "what nobody holds is freed";
    }
  }
  EXPECT_GE(shared, 8u) << "points on both, heights and meshes";
}

TEST(ModelStore, OtherOptionsAndOtherPointsAreOtherGeometry) {
  const render::Registry registry = all_renderers();
  CorpusScene corpus = load_corpus("ridge.toml", "ridge.csv");
  render::ModelStore store;
  render::PrepareContext context;
  context.store = &store;
  const auto prepare = [&](const char* options) {
    const NamedOptions named = parse_named_options(options).value();
    auto renderer = registry.make(named.name, named.options).value();
    EXPECT_TRUE(renderer->prepare(corpus.scene.input, context).ok());
    return renderer;
  };
  const auto plain = prepare("cloud-literal");
  EXPECT_EQ(store.size(), 1u);
  const auto shaded = prepare("cloud-literal:shading=none");  // not an option of the geometry
  EXPECT_EQ(store.size(), 1u);
  const auto boxes = prepare("cloud-literal:box=per-vertex");
  EXPECT_EQ(store.size(), 2u);
  // The same points loaded again are the same; points moved by a bit are not.
  render::ModelInput& input = corpus.scene.input.models[0];
  auto copy = std::make_shared<cloud::Cloud>(*input.cloud);
  input.cloud = copy;
  const auto again = prepare("cloud-literal");
  EXPECT_EQ(store.size(), 2u);
  // Local Delaunay surfaces of the same points are others, shared by all that use them.
  const auto stars = prepare("cloud");
  EXPECT_EQ(store.size(), 3u);
  const auto more_stars = prepare("cloud:combine=sum");
  EXPECT_EQ(store.size(), 3u);
  copy = std::make_shared<cloud::Cloud>(*copy);
  copy->z_mm[0] = std::nextafter(copy->z_mm[0], 1e9f);
  input.cloud = copy;
  const auto other = prepare("cloud-literal");
  EXPECT_EQ(store.size(), 4u);
  const auto other_stars = prepare("cloud");
  EXPECT_EQ(store.size(), 5u);
}

TEST(ModelStore, PointsThatGiveWayAreNeverShared) {
  const render::Registry registry = all_renderers();
  CorpusScene corpus = load_corpus("ridge.toml", "ridge.csv");
  render::SceneInput soft = corpus.scene.input;
  soft.models[0].surface.dent = {0.1, 3.0, 20.0};
  const render::RendererInfo& cloud = *registry.find("cloud");
  render::ModelStore store;
  std::unique_ptr<Ready> rigid = ready(registry, cloud, corpus.scene.input, &store);
  const std::string before = hash_of(*rigid->renderer, corpus);
  std::unique_ptr<Ready> first = ready(registry, cloud, soft, &store),
                         second = ready(registry, cloud, soft, &store);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(store.size(), 1u) << "the rigid one's alone";
  EXPECT_EQ(second->report.shared_bytes, 0u);
  const std::string dented = hash_of(*first->renderer, corpus);
  EXPECT_NE(dented, before);
  EXPECT_EQ(hash_of(*second->renderer, corpus), dented);
  EXPECT_EQ(hash_of(*rigid->renderer, corpus), before);
}

TEST(ModelStore, OneCloudTwiceInAScene) {
  const render::Registry registry = all_renderers();
  CorpusScene corpus = load_corpus("ridge.toml", "ridge.csv");
  render::SceneInput twice = corpus.scene.input;
  twice.models.push_back(twice.models[0]);
  twice.models[1].world_from_model.translation_mm += Vec3(500, 0, 0);
  for (const char* name : {"cloud", "brute-force", "cloud-literal"}) {
    SCOPED_TRACE(name);
    const std::unique_ptr<Ready> one = ready(registry, *registry.find(name), corpus.scene.input, nullptr);
    const std::unique_ptr<Ready> two = ready(registry, *registry.find(name), twice, nullptr);
    ASSERT_TRUE(one && two);
    EXPECT_GT(two->report.shared_bytes, 0.8 * static_cast<double>(one->report.bytes));
    EXPECT_EQ(hash_of(*two->renderer, corpus), hash_of(*one->renderer, corpus));
  }
}

}  // namespace
}  // namespace palpate::house
