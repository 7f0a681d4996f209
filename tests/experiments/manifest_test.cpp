// The manifests of the thesis's tables: what they hold, and that nothing in one is ignored.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "experiments/tables/manifest.h"
#include "experiments/tables/reproduction.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

TEST(Manifests, HoldThePrintedValues) {
  const auto manifests = manifests_for("");
  ASSERT_TRUE(manifests.ok()) << manifests.error().message();
  const auto table = [&](int number) -> const Manifest& {
    const auto at = std::find_if(manifests->begin(), manifests->end(),
                                 [&](const Manifest& m) { return m.table == number; });
    EXPECT_NE(at, manifests->end()) << "table " << number;
    return *at;
  };
  ASSERT_GE(manifests->size(), 8u);
  EXPECT_TRUE(table(6).kind == Manifest::Kind::kNeighbours);
  EXPECT_TRUE(table(11).kind == Manifest::Kind::kMethods);
  EXPECT_TRUE(table(3).kind == Manifest::Kind::kMeshes);
  EXPECT_EQ(table(3).printed_meshes.size(), 8u);
  for (const PrintedMesh& printed : table(3).printed_meshes) {
    EXPECT_FALSE(printed.minutes.empty()) << printed.method;
    EXPECT_TRUE(printed.ours.empty() ||
                std::any_of(table(3).models.begin(), table(3).models.end(),
                            [&](const ManifestModel& m) { return m.name == printed.ours; }))
        << printed.method;
  }
  EXPECT_EQ(table(11).methods.size(), 20u);
  // What a model names is a row.
  for (const ManifestModel& model : table(11).models)
    for (const auto* names : {&model.only, &model.slow})
      for (const std::string& name : *names)
        EXPECT_TRUE(std::any_of(
            table(11).methods.begin(), table(11).methods.end(),
            [&](const ManifestMethod& m) { return (m.label.empty() ? m.renderer : m.label) == name; }))
            << model.name << ", " << name;
  for (const ManifestMethod& method : table(11).methods)
    EXPECT_EQ(method.published.size(), method.renderer == "mls-penalty"     ? 2u
                                       : method.renderer == "cloud-literal" ? 3u
                                       : method.renderer == "vgraph"        ? 1u
                                                                            : 0u)
        << method.renderer;
  EXPECT_EQ(table(7).printed_frames, 54717u);
  EXPECT_EQ(table(7).printed_mean_ms, 0.0374);
  EXPECT_EQ(table(8).printed_frames, 49914u);
  EXPECT_EQ(table(8).printed_mean_ms, 0.0358);
  EXPECT_EQ(table(9).contact_frames, 116013u);
  EXPECT_EQ(table(10).printed_frames, 258229u);
  EXPECT_EQ(table(10).printed_mean_ms, 0.0459);
  EXPECT_EQ(table(12).printed_mean_ms, 0.0158);
  EXPECT_EQ(table(13).printed_frames, 32597u);
  EXPECT_FALSE(table(13).models[0].stand_in.empty());
  // Every scene that a manifest names is there and is one.
  for (const Manifest& m : *manifests)
    for (const ManifestModel& model : m.models)
      for (const std::string& name : {model.scene, model.stand_in}) {
        if (name.empty()) continue;
        const auto scenes = embedded_scenes();
        const auto at = std::find_if(scenes.begin(), scenes.end(),
                                     [&](const EmbeddedManifest& scene) { return name == scene.name; });
        ASSERT_NE(at, scenes.end()) << name;
        const auto scene = scene::parse_scene(at->text, name);
        EXPECT_TRUE(scene.ok()) << scene.error().message();
      }
  const render::Registry registry = all_renderers();
  for (const Manifest& m : *manifests)
    for (const ManifestRun& run : m.runs) {
      const bool baseline = run.renderer.rfind("mesh-", 0) == 0;
      if (baseline && registry.find("mesh-godobject") == nullptr) continue;  // built without the baselines
      const auto requests = parse_renderers(run.renderer, registry);
      EXPECT_TRUE(requests.ok()) << requests.error().message();
    }
  const auto chosen = manifests_for("9,7,9");
  ASSERT_TRUE(chosen.ok());
  EXPECT_EQ(chosen->size(), 2u);
}

TEST(Manifests, AreStrict) {
  const std::string begin = "table = 7\nkind = \"frames\"\ntitle = \"t\"\n";
  const std::string model = "[[model]]\nname = \"m\"\ngenerate = \"plane\"\n";
  ASSERT_TRUE(parse_manifest(begin + model, "good.toml").ok());
  struct Case {
    std::string text;
    std::int64_t line;
    const char* what;
    const char* remedy;
  };
  const Case cases[] = {
      {begin + "nots = [\"n\"]\n" + model, 4, "nots", "did you mean 'notes'?"},
      {begin + model + "quik = \"plane\"\n", 7, "quik", "did you mean 'quick'?"},
      {begin + model + "[path]\nspec = \"tap\"\ncontact_frame = 5\n", 9, "contact_frame",
       "did you mean 'contact_frames'?"},
      {begin + "walls = [1.0]\n" + model, 4, "does nothing", "neighbours"},
      {begin + model + "full = true\n", 7, "does nothing", "methods"},
      {begin + model + "only = [\"cloud\"]\n", 7, "does nothing", "methods"},
      {begin + model + "slow = [\"cloud\"]\n", 7, "does nothing", "neighbours"},
      {begin + model + "scale = \"two\"\n", 7, "number", ""},
      {begin + "paced = 1\n" + model, 4, "true or false", ""},
      {begin + model + "[path]\nspec = \"tap\"\ncontact_frames = -1\n", 9, "whole number", ""},
      {begin + "[model]\nname = \"m\"\n", 4, "list of tables", "[[model]]"},
      {begin, 1, "needs 'model'", ""},
      {begin + "[[model]]\ngenerate = \"plane\"\n", 4, "needs 'name'", ""},
      {"table = 0\n" + begin.substr(begin.find('\n') + 1) + model, 1, "1 or more", ""},
      {"table = 7\nkind = \"fames\"\n", 2, "fames", "did you mean 'frames'?"},
      {"table = 7\n", 1, "needs 'kind'", "frames"},
      {"table = = 7\n", 1, "", "TOML"},
  };
  for (const Case& c : cases) {
    const auto manifest = parse_manifest(c.text, "mine.toml");
    ASSERT_FALSE(manifest.ok()) << c.text;
    const Error& error = manifest.error();
    EXPECT_EQ(error.file, "mine.toml") << c.text;
    EXPECT_EQ(error.line, c.line) << c.text << error.message();
    EXPECT_THAT(error.what, HasSubstr(c.what)) << error.message();
    EXPECT_THAT(error.remedy, HasSubstr(c.remedy)) << error.message();
  }
}

TEST(Manifests, TablesComeFirstAndAreChosenByNumberOrName) {
  const auto all = manifests_for("");
  ASSERT_TRUE(all.ok());
  EXPECT_EQ(all->front().id(), "table3");
  const std::vector<std::string> named = {"behaviours", "growth", "ladder", "off-vertex", "scanner"};
  ASSERT_GT(all->size(), named.size());
  for (std::size_t i = 0; i < named.size(); ++i)
    EXPECT_EQ((*all)[all->size() - named.size() + i].id(), named[i]);
  EXPECT_EQ(manifests_for("growth,7").value().front().id(), "growth");
  EXPECT_FALSE(manifests_for("0").ok());
}

}  // namespace
}  // namespace palpate::experiments
