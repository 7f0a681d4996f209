// What all cleaning steps share, with steps of our own; views and [[model.clean]] in scenes.
#include "toolkit/scene/cleaning.h"

#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include "tests/in_folder.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/io/write_mesh.h"
#include "toolkit/scene/scene.h"

namespace palpate::scene {
namespace {

/// Leaves out the first `points`, lifts all by `by` spacings, adds one above the last, or all three wrongly.
Cleaning steps() {
  Cleaning cleaning;
  cleaning.add({"drop",
                "leaves out the first points",
                "this test",
                {{"points", OptionKind::kInteger, "1", "so many", {}, 0, 1e9}},
                [](const StepInput& in) -> Result<StepOutput> {
                  StepOutput out;
                  for (auto i = static_cast<std::size_t>(in.options.integer("points")); i < in.cloud.size();
                       ++i)
                    out.from.push_back(static_cast<std::uint32_t>(i));
                  return out;
                }});
  cleaning.add({"lift",
                "moves all up",
                "this test",
                {{"by", OptionKind::kNumber, "1", "spacings", {}, -10, 10}},
                [](const StepInput& in) -> Result<StepOutput> {
                  StepOutput out;
                  for (std::size_t i = 0; i < in.cloud.size(); ++i) {
                    out.from.push_back(static_cast<std::uint32_t>(i));
                    out.placed_mm.push_back(in.cloud.local_mm(i) +
                                            Vec3(0, 0, in.options.number("by") * in.spacing_mm));
                  }
                  return out;
                }});
  cleaning.add(
      {"add", "adds one above the last", "this test", {}, [](const StepInput& in) -> Result<StepOutput> {
         StepOutput out;
         out.from.resize(in.cloud.size());
         std::iota(out.from.begin(), out.from.end(), 0u);
         out.from.push_back(kFromNearest);
         out.placed_mm.push_back(in.cloud.local_mm(in.cloud.size() - 1) + Vec3(0, 0, 0.01));
         return out;
       }});
  cleaning.add({"fail", "cannot", "this test", {}, [](const StepInput&) -> Result<StepOutput> {
                  return Error{"it went wrong", "try another", {}, 0};
                }});
  return cleaning;
}

cloud::Cloud grid() {
  cloud::Cloud cloud = cloud::generate(*parse_named_options("plane:points=121:extent_mm=10"))->cloud;
  cloud::Property number{"number", {}};
  for (std::size_t i = 0; i < cloud.size(); ++i) number.values.push_back(static_cast<float>(i));
  cloud.properties.push_back(number);
  return cloud;
}

CleanedCloud run(const Cleaning& cleaning, const cloud::Cloud& cloud, const std::string& text) {
  const auto parsed = cleaning.parse(text);
  EXPECT_TRUE(parsed.ok()) << parsed.error().message();
  auto cleaned = cleaning.run(cloud, *parsed, 1, no_progress());
  EXPECT_TRUE(cleaned.ok()) << cleaned.error().message();
  return *std::move(cleaned);
}

TEST(Cleaning, StepsRunInOrderAndPropertiesFollow) {
  const cloud::Cloud cloud = grid();
  ASSERT_TRUE(cloud.raster);
  const CleanedCloud made = run(steps(), cloud, "drop/points=21+add+drop/points=10+lift/by=2");
  ASSERT_EQ(made.cloud.size(), 121u - 21u + 1u - 10u);
  ASSERT_EQ(made.from.size(), made.cloud.size());
  EXPECT_EQ(made.from.front(), 31u);
  EXPECT_EQ(made.from.back(), 120u) << "of the point that the new one is nearest to";
  for (std::size_t i = 0; i < made.cloud.size(); ++i)
    EXPECT_EQ(made.cloud.properties[0].values[i], static_cast<float>(made.from[i]));
  EXPECT_NEAR(made.cloud.point_mm(0).z(), cloud.point_mm(31).z() + 2.0, 0.2);
  EXPECT_FALSE(made.cloud.raster) << "it is no raster without its first points";
  ASSERT_EQ(made.phases.size(), 4u);
  EXPECT_EQ(made.phases[1].name, "cleaning: add");
  EXPECT_EQ(made.notes[0], "drop: 21 of 121 points removed");
  EXPECT_EQ(made.notes[1], "add: 1 points added to 100");
  EXPECT_EQ(made.notes[3], "lift: 91 points moved");
}

TEST(Cleaning, ARasterStaysOneWhereItsPointsOnlyMove) {
  const cloud::Cloud cloud = grid();
  const CleanedCloud made = run(steps(), cloud, "lift");
  ASSERT_TRUE(made.cloud.raster);
  EXPECT_EQ(made.cloud.raster->columns, cloud.raster->columns);
  const CleanedCloud same = run(steps(), cloud, "drop/points=0");
  EXPECT_TRUE(same.cloud.raster);
  EXPECT_EQ(same.notes[0], "drop: nothing changed in 121 points");
  for (std::size_t i = 0; i < cloud.size(); ++i) EXPECT_EQ(same.cloud.point_mm(i), cloud.point_mm(i));
}

TEST(Cleaning, SaysWhatIsWrong) {
  const Cleaning cleaning = steps();
  EXPECT_EQ(cleaning.parse("dorp").error().remedy, "did you mean 'drop'?");
  EXPECT_NE(cleaning.parse("zebra").error().remedy.find("drop, lift, add, fail"), std::string::npos);
  EXPECT_NE(cleaning.parse("drop/number=2").error().message().find("points"), std::string::npos);
  EXPECT_FALSE(cleaning.parse("lift/by=11").ok());
  EXPECT_FALSE(cleaning.parse("").ok());
  EXPECT_FALSE(cleaning.parse("drop++lift").ok());
  EXPECT_NE(Cleaning{}.parse("drop").error().remedy.find("none in this program"), std::string::npos);
  const cloud::Cloud cloud = grid();
  const auto fails = [&](const std::string& text) {
    const auto parsed = cleaning.parse(text);
    return cleaning.run(cloud, *parsed, 1, no_progress()).error().message();
  };
  EXPECT_EQ(fails("lift+fail"), "it went wrong; try another");
  EXPECT_NE(fails("drop/points=500").find("every one of 121"), std::string::npos);
}

TEST(Cleaning, StopsWhereTheUserAsksTo) {
  class Stopped : public Progress {
    void report(std::string_view, double) override {}
    [[nodiscard]] bool cancelled() const override { return true; }
  } stopped;
  const Cleaning cleaning = steps();
  const auto parsed = cleaning.parse("lift");
  EXPECT_NE(cleaning.run(grid(), *parsed, 1, stopped).error().what.find("stopped"), std::string::npos);
}

class CleanScene : public InFolder {
 protected:
  CleanScene() { io::add_standard_readers(readers_); }
  Result<LoadedScene> loaded(const std::string& text, const Cleaning* cleaning) {
    std::ofstream(in("scene.toml")) << text;
    const Result<SceneFile> scene = read_scene(in("scene.toml"));
    if (!scene) return scene.error();
    LoadOptions options;
    options.cleaning = cleaning;
    return load(*scene, readers_, options, no_progress());
  }
  std::string refusal(const std::string& text, const Cleaning* cleaning) {
    const auto got = loaded(text, cleaning);
    return got.ok() ? "" : got.error().message();
  }
  io::Readers readers_;
};

TEST_F(CleanScene, StepsOfASceneAreTimedAndColumnsFollow) {
  ASSERT_TRUE(io::write_cloud_ply(in("grid.ply"), grid()).ok());
  const Cleaning cleaning = steps();
  const auto got = loaded(
      "[[model]]\ncloud = \"grid.ply\"\n"
      "  [[model.clean]]\n  step = \"drop\"\n  points = 21\n  [[model.clean]]\n  step = \"lift\"\n"
      "  [model.surface]\n  stiffness_n_per_mm = { column = \"number\" }\n",
      &cleaning);
  // The first point kept is number 21: a stiffness above 0.
  ASSERT_TRUE(got.ok()) << got.error().message();
  const render::ModelInput& model = got->input.models[0];
  ASSERT_EQ(model.cloud->size(), 100u);
  EXPECT_EQ(model.surface.per_point->stiffness_n_per_mm.front(), 21.0f);
  ASSERT_EQ(got->provenance[0].cleaning.size(), 2u);
  EXPECT_EQ(got->provenance[0].cleaned[0], "drop: 21 of 121 points removed");
  EXPECT_EQ(got->provenance[0].file_points, 121u);
}

TEST_F(CleanScene, GeneratedModelsKeepTheirFormulaAndLoseTheirFaces) {
  const Cleaning cleaning = steps();
  const auto got = loaded(
      "[[model]]\ngenerate = \"plane\"\npoints = 121\n  [[model.clean]]\n  step = \"drop\"\n", &cleaning);
  ASSERT_TRUE(got.ok()) << got.error().message();
  EXPECT_NE(got->input.models[0].analytic, nullptr);
  EXPECT_EQ(got->input.models[0].original_mesh, nullptr);
}

TEST_F(CleanScene, ErrorsNameTheLine) {
  const Cleaning cleaning = steps();
  const std::string model = "[[model]]\ngenerate = \"plane\"\npoints = 121\n";
  EXPECT_NE(refusal(model + "\n  [[model.clean]]\n  step = \"dorp\"\n", &cleaning).find("scene.toml:5: "),
            std::string::npos);
  EXPECT_NE(
      refusal(model + "  [[model.clean]]\n  step = \"lift\"\n  by = \"high\"\n", &cleaning).find("toml:4"),
      std::string::npos);
  EXPECT_NE(refusal(model + "  [[model.clean]]\n  by = 1\n", &cleaning).find("needs 'step'"),
            std::string::npos);
  EXPECT_NE(refusal(model + "  [model.clean]\n  step = \"lift\"\n", &cleaning).find("two brackets"),
            std::string::npos);
  EXPECT_NE(refusal(model + "  [[model.clean]]\n  step = \"fail\"\n", &cleaning).find("went wrong"),
            std::string::npos);
  EXPECT_NE(refusal(model + "  [[model.clean]]\n  step = \"lift\"\n", nullptr).find("no cleaning step"),
            std::string::npos)
      << "a program without steps does not leave them out in silence";
  EXPECT_NE(refusal(model + "  [[model.view]]\n  cloud = \"a.ply\"\n", &cleaning).find("'view' does nothing"),
            std::string::npos);
}

TEST_F(CleanScene, ViewsAreMergedByTheirPoses) {
  const cloud::Cloud whole = cloud::generate(*parse_named_options("sinusoid:points=2601"))->cloud;
  const geometry::RigidTransform pose{Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), Vec3(10, -20, 30)};
  std::vector<Vec3> first, second;
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const Vec3 p = whole.point_mm(i);
    i % 3 == 0 ? second.push_back(pose.inverse() * p) : first.push_back(p);
  }
  const auto save = [&](const char* name, const std::vector<Vec3>& points, const char* column) {
    cloud::Cloud cloud = *cloud::build_cloud(points, cloud::NonFinite::kRefuse);
    cloud.properties.push_back({"both", std::vector<float>(points.size(), 1.0f)});
    cloud.properties.push_back({column, std::vector<float>(points.size(), 2.0f)});
    ASSERT_TRUE(io::write_cloud_ply(in(name), cloud).ok());
  };
  save("first.ply", first, "alone");
  save("second.ply", second, "other");
  const auto got = loaded(
      "[[model]]\ncloud = \"first.ply\"\nscale = 2\n  [[model.view]]\n  cloud = \"second.ply\"\n"
      "  position_mm = [10, -20, 30]\n  rotation = [0.5, 0.5, -0.5, 0.5]\n",
      nullptr);
  ASSERT_TRUE(got.ok()) << got.error().message();
  const cloud::Cloud& merged = *got->input.models[0].cloud;
  ASSERT_EQ(merged.size(), whole.size());
  std::size_t at = 0, behind = first.size();
  const double rounding = 8.0 * merged.box_mm().extent_mm().norm() * 0x1p-24;  // of three stored roundings
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const Vec3 p = merged.point_mm(i % 3 == 0 ? behind++ : at++);
    ASSERT_LT((p - 2.0 * whole.point_mm(i)).norm(), rounding) << i;
  }
  ASSERT_EQ(merged.properties.size(), 1u) << "only what all views have";
  EXPECT_EQ(merged.properties[0].name, "both");
  EXPECT_EQ(merged.properties[0].values.size(), merged.size());
  EXPECT_EQ(got->provenance[0].file_points, whole.size());
  EXPECT_NE(got->provenance[0].format.find("2 views"), std::string::npos);
}

TEST_F(CleanScene, ViewsThatCannotBeMergedAreRefused) {
  ASSERT_TRUE(io::write_cloud_ply(in("grid.ply"), grid()).ok());
  const std::string model = "[[model]]\ncloud = \"grid.ply\"\n";
  EXPECT_NE(refusal(model + "  [[model.view]]\n  cloud = \"nowhere.ply\"\n", nullptr).find("nowhere.ply"),
            std::string::npos);
  EXPECT_NE(refusal(model + "  [[model.view]]\n  rotation = [1, 0, 0, 0]\n", nullptr).find("needs 'cloud'"),
            std::string::npos);
  EXPECT_NE(refusal(model + "  [[model.view]]\n  cloud = \"grid.ply\"\n  rotation = [2, 0, 0, 0]\n", nullptr)
                .find("scene.toml:5"),
            std::string::npos);
  std::ofstream(in("metres.obj")) << "# unit m\nv 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const std::string other = refusal(model + "  [[model.view]]\n  cloud = \"metres.obj\"\n", nullptr);
  EXPECT_TRUE(other.empty() || other.find("unit") != std::string::npos) << other;
}

}  // namespace
}  // namespace palpate::scene
