// The folder of results: whose it is, which files in it are ours, and what stays of an interrupted run.
#include "experiments/study/study.h"

#include <algorithm>

#include <palpate/generate.h>
#include <palpate/paths.h>
#include "experiments/run/stage.h"
#include "experiments/session/session.h"
#include "experiments/tables/manifest.h"
#include "experiments/tables/reproduction.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;
using Begun = OutputFolder::Begun;

class Folder : public InFolder {
 protected:
  OutputFolder open() const { return value_of(OutputFolder::open(in("out"))); }
  OutputFolder begun(const std::string& key, Begun expected) const {
    const OutputFolder folder = open();
    const Result<Begun> how = folder.begin(key);
    EXPECT_TRUE(how.ok() && *how == expected);
    return folder;
  }
  /// A run that wrote these files to its end.
  void completed(const std::vector<std::pair<const char*, const char*>>& files) const {
    const OutputFolder folder = begun("k", Begun::kAnew);
    for (const auto& [name, text] : files) EXPECT_TRUE(folder.write(name, text).ok()) << name;
    EXPECT_TRUE(folder.complete().ok());
  }
  bool there(const std::string& name) const { return fs::exists(fs::symlink_status(in("out/" + name))); }
  static bool take(const OutputFolder& folder, const std::string& part, const std::string& key,
                   const std::string& expected) {
    return folder.take_over(part, key, [&](const std::string& text) { return text == expected; });
  }
};

TEST_F(Folder, IsMadeAndKeptFromStrangers) {
  {
    const auto made = value_of(OutputFolder::open(in("a/b/")));
    ASSERT_TRUE(made.begin("k").ok() && made.write("result.json", "{}").ok() && made.complete().ok());
  }
  EXPECT_TRUE(OutputFolder::open(in("a/b")).ok());
  EXPECT_TRUE(fs::exists(in("a/b/result.json"))) << "nothing changes before a run begins";
  EXPECT_FALSE(OutputFolder::open(in("a")).ok()) << "a folder with somebody's files";
  EXPECT_TRUE(OutputFolder::open(in("a/b")).ok());
}

TEST_F(Folder, WithoutAResultIsAsItWas) {
  { const OutputFolder folder = open(); }
  EXPECT_FALSE(there("")) << "made for nothing";
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok());
  }
  EXPECT_FALSE(there("")) << "no part was complete";
}

TEST_F(Folder, IsForOneRunAtATime) {
  const OutputFolder first = open();
  const Result<OutputFolder> second = OutputFolder::open(in("out"));
  ASSERT_FALSE(second.ok());
  EXPECT_THAT(second.error().message(), HasSubstr("process " + std::to_string(::getpid())));
  EXPECT_EQ(second.error().file, in("out"));
  EXPECT_TRUE(there(kFolderMark)) << "the second one must not take the first one's folder away";
}

TEST_F(Folder, ANewRunRemovesOurFilesAndNoOthers) {
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    const Result<OutputFolder> figures = folder.inside("figures");
    ASSERT_TRUE(figures.ok() && figures->write("old.svg", "1").ok());
    ASSERT_TRUE(folder.write("trace-old.csv", "1").ok() && folder.write("both.csv", "1").ok());
    ASSERT_TRUE(folder.complete().ok());
  }
  write_text(in("out/notes.txt"), "years of work");
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("trace-old.csv"));
  EXPECT_FALSE(there("figures")) << "empty and ours";
  EXPECT_EQ(file_text(in("out/notes.txt")), "years of work");
  EXPECT_TRUE(test::refused(folder.write("notes.txt", "a result"), "Palpate did not write it"));
  EXPECT_TRUE(folder.write("both.csv", "2").ok() && folder.write("both.csv", "3").ok());
  EXPECT_EQ(file_text(in("out/both.csv")), "3");
  EXPECT_EQ(file_text(in("out/notes.txt")), "years of work");
}

TEST_F(Folder, TheMarkCannotPointOutOfTheFolder) {
  fs::create_directories(in("out"));
  write_text(in("precious"), "years of work");
  completed({{"a.csv", "1"}});
  std::ofstream(in("out/.palpate-output"), std::ios::app)
      << "file ../precious\nfile " << in("precious") << "\nfile \nfile .\nfile figures\n";
  fs::create_directories(in("out/figures/mine"));
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("a.csv"));
  EXPECT_TRUE(there("figures/mine"));
  EXPECT_EQ(file_text(in("precious")), "years of work");
}

TEST_F(Folder, PartsOfAnInterruptedRunAreTakenOver) {
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok());
    for (const char* part : {"a", "b", "c"}) {
      folder.start_part();
      ASSERT_TRUE(folder.write(std::string(part) + ".csv", part).ok() &&
                  folder.keep(part, "1", std::string("text of ") + part).ok());
    }
    ASSERT_TRUE(folder.write("half.csv", "half").ok());
  }
  write_text(in("out/c.csv"), "something else");
  const OutputFolder folder = begun("k", Begun::kGoesOn);
  ASSERT_TRUE(folder.write("result.json", "{1}").ok());
  EXPECT_TRUE(take(folder, "a", "1", "text of a"));
  EXPECT_FALSE(take(folder, "b", "2", "text of b")) << "another key";
  EXPECT_FALSE(take(folder, "b", "1", "another text")) << "of no use";
  EXPECT_FALSE(take(folder, "c", "1", "text of c")) << "its file has changed";
  EXPECT_FALSE(take(folder, "d", "1", "")) << "never kept";
  ASSERT_TRUE(folder.complete().ok());
  EXPECT_TRUE(there("a.csv"));
  for (const char* gone : {"b.csv", "c.csv", "half.csv", ".palpate-parts"}) EXPECT_FALSE(there(gone)) << gone;
}

TEST_F(Folder, ACompleteRunIsNotTakenOverAndAnInterruptedOneOfAnotherKeyIsRefused) {
  const auto run = [&](const char* key, Begun expected, bool complete) {
    const OutputFolder folder = begun(key, expected);
    EXPECT_FALSE(take(folder, "a", "1", "text") && expected != Begun::kGoesOn);
    EXPECT_TRUE(folder.write("a.csv", "1").ok() && folder.keep("a", "1", "text").ok());
    EXPECT_TRUE(!complete || folder.complete().ok());
  };
  run("k", Begun::kAnew, true);
  run("k", Begun::kAnew, false);
  run("k", Begun::kGoesOn, false);
  EXPECT_TRUE(test::refused(open().begin("other"), "of something else", "remove this folder"));
  EXPECT_FALSE(open().begin("other", "rows").ok());
  EXPECT_TRUE(there("a.csv"));
  run("k", Begun::kGoesOn, true);
  run("other", Begun::kAnew, true);
}

TEST_F(Folder, ARecordIsGoneOnWithWhetherItsRunWasCompleteOrNot) {
  const auto run = [&](Begun expected, bool complete) {
    const OutputFolder folder = open();
    const Result<Begun> how = folder.begin("k", "rows");
    ASSERT_TRUE(how.ok() && *how == expected);
    EXPECT_EQ(there("rows"), expected != Begun::kAnew);
    EXPECT_EQ(there("beside.csv"), expected != Begun::kAnew);
    ASSERT_TRUE(folder.write("beside.csv", "1").ok() && folder.write("rows", "1").ok());
    ASSERT_TRUE(!complete || folder.complete().ok());
  };
  run(Begun::kAnew, false);
  EXPECT_FALSE(open().begin("k").ok()) << "a run that has no record would remove it";
  EXPECT_FALSE(open().begin("other", "rows").ok());
  run(Begun::kGoesOn, true);
  run(Begun::kGoesOnFromComplete, false);
  run(Begun::kGoesOn, true);
  EXPECT_TRUE(there("beside.csv"));
  EXPECT_FALSE(open().begin("k", "trials").ok()) << "complete results of another kind";
  EXPECT_TRUE(there("rows"));
  // A run that has no record takes a complete one away, as every new run does.
  begun("k", Begun::kAnew);
  EXPECT_FALSE(there("rows"));
}

TEST_F(Folder, AFileThatIsReadIsNotReplaced) {
  completed({{"trace.csv", "1"}});
  write_text(in("out/mine.csv"), "mine");
  fs::create_symlink(in("out/trace.csv"), in("link.csv"));
  const OutputFolder folder = open();
  EXPECT_TRUE(folder.check_not_read(std::vector<std::string>{in("out/mine.csv")}).ok());
  for (const std::string& read : {in("out/trace.csv"), in("link.csv"), in("out/../out/trace.csv")})
    EXPECT_FALSE(folder.check_not_read(std::vector<std::string>{read}).ok()) << read;
}

TEST_F(Folder, ThatAnOlderVersionMarkedIsOurs) {
  fs::create_directories(in("out"));
  write_text(in("out/.palpate-output"), "Results of Palpate: replaced by the next run with this folder.\n");
  write_text(in("out/result.json"), "{}");
  write_text(in("out/trace-a.csv"), "1");
  const OutputFolder folder = begun("k", Begun::kAnew);
  EXPECT_FALSE(there("result.json"));
  EXPECT_TRUE(folder.write("trace-a.csv", "2").ok()) << "it kept no list: what we write is taken for ours";
}

TEST_F(Folder, OpenedAgainKeepsWhatItDoesNotWrite) {
  EXPECT_FALSE(OutputFolder::reopen(in("out")).ok()) << "there is none";
  EXPECT_FALSE(fs::exists(in("out"))) << "and none is made";
  {
    const OutputFolder folder = begun("k", Begun::kAnew);
    ASSERT_TRUE(folder.write("result.json", "{}").ok() && folder.write("report.html", "old").ok());
    const Result<OutputFolder> inner = folder.inside("table7");
    ASSERT_TRUE(inner.ok() && inner->write("result.json", "{7}").ok() && folder.complete().ok());
  }
  write_text(in("out/mine.txt"), "not Palpate's");
  {
    const auto again = value_of(OutputFolder::reopen(in("out") + "/"));
    EXPECT_FALSE(OutputFolder::reopen(in("out/table7")).ok()) << "locked as a whole";
    EXPECT_TRUE(again.write("report.html", "new").ok() && again.write("more.svg", "more").ok());
    EXPECT_FALSE(again.write("mine.txt", "taken").ok());
  }
  EXPECT_EQ(file_text(in("out/result.json")), "{}");
  EXPECT_EQ(file_text(in("out/report.html")), "new");
  {
    const auto table = value_of(OutputFolder::reopen(in("out/table7")));
    EXPECT_TRUE(table.write("result.json", "{8}").ok());
  }
  EXPECT_EQ(file_text(in("out/table7/result.json")), "{8}");
  EXPECT_EQ(file_text(in("out/result.json")), "{}");
  // The next run knows all of it, and takes it away.
  EXPECT_TRUE(begun("k", Begun::kAnew).complete().ok());
  EXPECT_FALSE(there("more.svg") || there("table7/result.json") || there("report.html"));
  EXPECT_TRUE(there("mine.txt"));
}

// ---- The manifests of the thesis's tables: what they hold, and that nothing in one is ignored.

TEST(Manifests, HoldThePrintedValues) {
  const auto manifests = value_of(manifests_for(""));
  const auto table = [&](int number) -> const Manifest& {
    const auto at = std::find_if(manifests.begin(), manifests.end(),
                                 [&](const Manifest& m) { return m.table == number; });
    EXPECT_NE(at, manifests.end()) << "table " << number;
    return *at;
  };
  ASSERT_GE(manifests.size(), 8u);
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
  for (const Manifest& m : manifests)
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
  for (const Manifest& m : manifests)
    for (const ManifestRun& run : m.runs) {
      const bool baseline = run.renderer.rfind("mesh-", 0) == 0;
      if (baseline && registry.find("mesh-godobject") == nullptr) continue;  // built without the baselines
      const auto requests = parse_renderers(run.renderer, registry);
      EXPECT_TRUE(requests.ok()) << requests.error().message();
    }
  const auto chosen = value_of(manifests_for("9,7,9"));
  EXPECT_EQ(chosen.size(), 2u);
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
  const auto all = value_of(manifests_for(""));
  EXPECT_EQ(all.front().id(), "table3");
  const std::vector<std::string> named = {"behaviours", "growth", "ladder", "off-vertex", "scanner"};
  ASSERT_GT(all.size(), named.size());
  for (std::size_t i = 0; i < named.size(); ++i) EXPECT_EQ(all[all.size() - named.size() + i].id(), named[i]);
  EXPECT_EQ(manifests_for("growth,7").value().front().id(), "growth");
  EXPECT_FALSE(manifests_for("0").ok());
}

// ---- The options of everything that has some: what they say of each other is true.

using Visit = std::function<void(const std::string& owner, const std::vector<OptionSpec>& specs)>;

void for_all_owners(const Visit& visit) {
  const render::Registry registry = all_renderers();
  for (const render::RendererInfo& info : registry.all()) visit(info.name, info.options);
  for (const cloud::Generator& generator : cloud::generators()) visit(generator.name, generator.options);
  for (const paths::PathGenerator& generator : paths::path_generators())
    visit(generator.name, generator.options);
  for (const scene::CleaningStep& step : all_cleaning().all()) visit(step.name, step.options);
}

const OptionSpec* find(const std::vector<OptionSpec>& specs, const std::string& key) {
  const auto at = std::find_if(specs.begin(), specs.end(), [&](const OptionSpec& s) { return s.key == key; });
  return at == specs.end() ? nullptr : &*at;
}

Options one(const std::string& key, const std::string& value) {
  Options options;
  options.set(key, value);
  return options;
}

TEST(AllOptions, TheirDefaultsAreValuesOfTheirs) {
  for_all_owners([](const std::string& owner, const std::vector<OptionSpec>& specs) {
    for (const OptionSpec& spec : specs) {
      const Result<Options> checked = validate(one(spec.key, spec.default_value), specs, owner);
      EXPECT_TRUE(checked.ok()) << checked.error().message();
    }
  });
}

TEST(AllOptions, TheirConditionsNameOptionsAndValuesThatExist) {
  std::size_t conditions = 0;
  for_all_owners([&](const std::string& owner, const std::vector<OptionSpec>& specs) {
    for (const OptionSpec& spec : specs)
      for (const OptionCondition& condition : spec.only_with) {
        ++conditions;
        const OptionSpec* other = find(specs, condition.key);
        ASSERT_NE(other, nullptr) << owner << ": " << spec.key << " needs " << condition.key;
        EXPECT_NE(other, &spec);
        for (const std::string& value : condition.values) {
          // With its own condition met or not, the value must be one that the option may have.
          std::vector<OptionSpec> free = {*other};
          free.front().only_with.clear();
          EXPECT_TRUE(validate(one(other->key, value), free, owner).ok())
              << owner << ": " << other->key << "=" << value;
        }
      }
  });
  EXPECT_GT(conditions, 30u);
}

}  // namespace
}  // namespace palpate::experiments
