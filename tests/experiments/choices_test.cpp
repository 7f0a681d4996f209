// What is run where a user names nothing but a model.
#include "experiments/run/arguments.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include <palpate/generate.h>
#include "experiments/session/session.h"
#include "experiments/study/study.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

render::SceneInput scene_of(const std::string& generator, bool faces, bool raster = false) {
  cloud::GeneratedModel made = cloud::generate(*parse_named_options(generator)).value();
  render::ModelInput model;
  model.name = "model";
  if (!raster) made.cloud.raster.reset();
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  if (faces) {
    geometry::TriangleMesh mesh;
    mesh.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    mesh.triangles = {{0, 1, 2}};
    model.original_mesh = std::make_shared<const geometry::TriangleMesh>(std::move(mesh));
  }
  render::SceneInput scene;
  scene.models.push_back(std::move(model));
  return scene;
}

std::string labels_of(const Chosen& chosen) {
  std::string labels;
  for (const RendererRequest& r : chosen.renderers) labels += (labels.empty() ? "" : ",") + r.label;
  return labels;
}

bool with_meshes() {
  return all_renderers().find("mesh-godobject") != nullptr;
}

TEST(UsualRenderers, AreThePlansCloudAndTheBestMesh) {
  if (!with_meshes()) GTEST_SKIP() << "built without meshes";
  const render::Registry registry = all_renderers();
  const Chosen points = usual_renderers(scene_of("sphere:points=900", false), {}, registry);
  EXPECT_EQ(labels_of(points), "cloud-smooth,cloud,mesh-godobject");
  EXPECT_FALSE(points.renderers.back().options.has("mesh")) << "auto";
  const Chosen field = usual_renderers(scene_of("sinusoid:points=961", false, true), {}, registry);
  EXPECT_EQ(labels_of(field), "heightfield,cloud,mesh-godobject");
  EXPECT_EQ(field.renderers.back().options.text("mesh"), "organised") << "rows of a scanner";
  const Chosen faces = usual_renderers(scene_of("sinusoid:points=961", true, true), {}, registry);
  EXPECT_FALSE(faces.renderers.back().options.has("mesh")) << "its own faces first";
  const Chosen own = usual_renderers(scene_of("sphere:points=900", false),
                                     RendererRequest{"penalty-grid", "penalty-grid", {}, {}}, registry);
  EXPECT_EQ(labels_of(own), "penalty-grid,cloud,mesh-godobject") << "the scene's own comes first";
}

TEST(UsualRenderers, LargeCloudsAreThinnedForTheMeshAndThatIsSaid) {
  if (!with_meshes()) GTEST_SKIP() << "built without meshes";
  const std::string points = fmt::format("sphere:points={}", 2 * static_cast<int>(kMostPointsMeshed));
  const Chosen chosen = usual_renderers(scene_of(points, false), {}, all_renderers());
  EXPECT_EQ(labels_of(chosen), "cloud-smooth,cloud,mesh-thinned");
  ASSERT_EQ(chosen.renderers.back().clean.size(), 1u);
  EXPECT_EQ(chosen.renderers.back().clean[0].options.text("cell"), "1.4") << "root of 2";
  EXPECT_THAT(chosen.notes.back(), HasSubstr("1.4 spacings apart"));
  EXPECT_EQ(labels_of(usual_renderers(scene_of(points, true), {}, all_renderers())),
            "cloud-smooth,cloud,mesh-godobject")
      << "faces need not be made";
}

TEST(UsualRenderers, ThoseThatLackWhatTheSceneAsksForAreLeftOutAndSaid) {
  if (!with_meshes()) GTEST_SKIP() << "built without meshes";
  render::SceneInput scene = scene_of("sphere:points=900", false);
  scene.models.front().surface.dent.rate_mm_s = 10.0;
  scene.models.front().surface.dent.yield_mm = 0.1;
  scene.models.front().surface.dent.radius_mm = 1.0;
  ASSERT_TRUE(scene.models.front().surface.dent.any());
  const Chosen chosen = usual_renderers(scene, {}, all_renderers());
  EXPECT_EQ(labels_of(chosen), "cloud");
  EXPECT_THAT(chosen.notes.back(), HasSubstr("mesh-godobject does not render"));
}

TEST(UsualPath, FollowsTheModelsSize) {
  paths::PathTarget target;
  for (const double scale : {1e-3, 1.0, 1e6}) {
    target.box_mm = {};
    target.box_mm.add(Vec3::Zero());
    target.box_mm.add(scale * Vec3(120, 120, 60));  // 180 mm across
    target.spacing_mm = 0.5 * scale;
    const NamedOptions path = parse_named_options(usual_path(target)).value();
    EXPECT_EQ(path.name, "exploration");
    EXPECT_DOUBLE_EQ(parse_number(path.options.text("depth_mm")).value(), 0.9 * scale);
    EXPECT_DOUBLE_EQ(parse_number(path.options.text("fastest_mm_s")).value(), 36 * scale);
    EXPECT_EQ(size_hint(target.box_mm).empty(), scale == 1.0) << scale;
  }
  target.box_mm = {};
  target.box_mm.add(Vec3::Zero());
  target.box_mm.add(Vec3(12, 12, 6));
  target.spacing_mm = 1.0;
  EXPECT_THAT(usual_path(target), HasSubstr(":depth_mm=1:")) << "at least a spacing";
  const std::shared_ptr<const geometry::AnalyticSurface> formula =
      cloud::generate(parse_named_options("sinusoid:points=121").value()).value().surface;
  target.surface = formula.get();
  EXPECT_EQ(parse_named_options(usual_path(target, 700)).value().name, "weave");
  EXPECT_THAT(usual_path(target, 700), HasSubstr(":frames=700:"));
}

class UsualFolder : public OnCommandLine {
 protected:
  UsualFolder() : before_(std::filesystem::current_path()) { std::filesystem::current_path(folder_); }
  ~UsualFolder() override { std::filesystem::current_path(before_); }
  std::filesystem::path before_;
};

TEST_F(UsualFolder, IsCalledByTheModel) {
  write_text("scan.v2.ply.gz", "x");
  EXPECT_EQ(usual_folder("compare", "scan.v2.ply.gz"), "out/compare-scan");
  EXPECT_EQ(usual_folder("compare", "sinusoid:points=961"), "out/compare-sinusoid");
  EXPECT_EQ(usual_folder("compare", "stanford-bunny"), "out/compare-stanford-bunny");
  EXPECT_EQ(usual_folder("compare", "..:"), "out/compare--") << "leads nowhere else";
  EXPECT_EQ(usual_folder("compare", ""), "out/compare-scene");
}

TEST_F(UsualFolder, LeavesWhatIsNotOfTheSameSceneAlone) {
  std::filesystem::create_directories("out/compare-a");
  EXPECT_EQ(usual_folder("compare", "a.ply"), "out/compare-a") << "an empty one";
  write_text("out/compare-a/thesis.tex", "three years of work");
  EXPECT_EQ(usual_folder("compare", "a.ply"), "out/compare-a-2") << "somebody's";
  metrics::ResultDocument document = new_document("palpate compare a.ply");
  document.scene = "a.ply";
  document.path = "tap";
  std::filesystem::create_directories("out/compare-a-2");
  write_text(std::string("out/compare-a-2/") + kFolderMark, "");
  write_text("out/compare-a-2/result.json", metrics::to_json(document));
  EXPECT_EQ(usual_folder("compare", "a.ply"), "out/compare-a-2") << "ours, of this scene";
  EXPECT_EQ(usual_folder("compare", "a.toml"), "out/compare-a-3") << "ours, of another";
  write_text("out/compare-a-3", "a file");
  EXPECT_EQ(usual_folder("compare", "a.toml"), "out/compare-a-4");
}

/// A scan of a bowl as PLY, with or without its faces.
std::string bowl(bool faces) {
  constexpr int kSide = 25;
  std::string vertices, triangles;
  int n = 0;
  for (int i = 0; i < kSide; ++i)
    for (int j = 0; j < kSide; ++j) {
      const double x = 2.0 * (i - 12) + 0.3 * std::sin(7.0 * j), y = 2.0 * (j - 12) + 0.3 * std::sin(5.0 * i);
      vertices += fmt::format("{} {} {}\n", x, y, 0.02 * (x * x + y * y));
      if (i + 1 == kSide || j + 1 == kSide) continue;
      const int a = i * kSide + j;
      triangles +=
          fmt::format("3 {} {} {}\n3 {} {} {}\n", a, a + kSide, a + 1, a + 1, a + kSide, a + kSide + 1);
      n += 2;
    }
  std::string head = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n",
      kSide * kSide);
  if (faces) head += fmt::format("element face {}\nproperty list uchar int vertex_indices\n", n);
  return head + "end_header\n" + vertices + (faces ? triangles : "");
}

TEST_F(UsualFolder, OnesOwnScanIsComparedInOneCommand) {
  if (!with_meshes()) GTEST_SKIP() << "built without meshes";
  for (const bool faces : {false, true}) {
    SCOPED_TRACE(faces);
    write_text("scan.ply", bowl(faces));
    std::filesystem::remove_all("out");
    std::filesystem::create_directories("out/compare-scan");
    write_text("out/compare-scan/mine.txt", "mine");
    const ProcessOutcome run = succeeds("compare scan.ply --unit mm");
    EXPECT_EQ(file_text("out/compare-scan/mine.txt"), "mine");
    const std::filesystem::path report = std::filesystem::absolute("out/compare-scan-2/report.html");
    EXPECT_TRUE(std::filesystem::exists(report));
    EXPECT_TRUE(run.out.ends_with("\nreport: " + report.string() + "\n")) << run.out;
    EXPECT_THAT(run.err, HasSubstr("running cloud-smooth, cloud, mesh-godobject"));
    const json result = json::parse(file_text("out/compare-scan-2/result.json"));
    EXPECT_TRUE(result["complete"]);
    ASSERT_EQ(result["renderers"].size(), 3u);
    for (const json& renderer : result["renderers"]) {
      EXPECT_EQ(renderer["status"], "ok");
      EXPECT_GT(renderer["frame"]["contact_frames"], 4000);
      EXPECT_EQ(renderer["accuracy"].is_object(), faces) << "its own faces are the truth";
    }
    const std::string remark =
        "The ground truth is the file's own faces, and mesh-godobject feels the same ones";
    EXPECT_EQ(result["notes"].dump().find(remark) != std::string::npos, faces) << result["notes"];
    const std::string mesh = result["renderers"][2]["prepare"]["notes"].dump();
    EXPECT_THAT(mesh, HasSubstr(faces ? "own 1152 faces (auto)" : "advancing-front"));
  }
  // Once more, without a new folder.
  succeeds("compare scan.ply --unit mm");
  EXPECT_FALSE(std::filesystem::exists("out/compare-scan-3"));
  succeeds("compare scan.ply --unit mm --renderers auto");
  EXPECT_TRUE(std::filesystem::exists("out/compare-one-scan/trace.csv"));
}

}  // namespace
}  // namespace palpate::experiments
