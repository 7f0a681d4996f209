// What all cleaning steps share, with steps of our own; views and [[model.clean]] in scenes.
#include <gtest/gtest.h>

#include <fstream>
#include <numeric>

#include <palpate/generate.h>
#include <palpate/read_model.h>
#include <palpate/scene.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/prepared/prepared_points.h"

namespace palpate::scene {
namespace {

/// Leaves out the first `points`, lifts all by `by` spacings, adds one above the last, or all three wrongly.
Cleaning steps() {
  Cleaning cleaning;
  cleaning.add({"drop",
                "leaves out the first points",
                "this test",
                {{"points", OptionKind::kInteger, "1", "so many", {}, 0, 1e9}},
                [](const CleaningStepInput& in) -> Result<CleaningStepOutput> {
                  CleaningStepOutput out;
                  for (auto i = static_cast<std::size_t>(in.options.integer("points")); i < in.cloud.size();
                       ++i)
                    out.from.push_back(static_cast<std::uint32_t>(i));
                  return out;
                }});
  cleaning.add({"lift",
                "moves all up",
                "this test",
                {{"by", OptionKind::kNumber, "1", "spacings", {}, -10, 10}},
                [](const CleaningStepInput& in) -> Result<CleaningStepOutput> {
                  CleaningStepOutput out;
                  for (std::size_t i = 0; i < in.cloud.size(); ++i) {
                    out.from.push_back(static_cast<std::uint32_t>(i));
                    out.new_points_mm.push_back(in.cloud.local_mm(i) +
                                                Vec3(0, 0, in.options.number("by") * in.spacing_mm));
                  }
                  return out;
                }});
  cleaning.add({"add",
                "adds one above the last",
                "this test",
                {},
                [](const CleaningStepInput& in) -> Result<CleaningStepOutput> {
                  CleaningStepOutput out;
                  out.from.resize(in.cloud.size());
                  std::iota(out.from.begin(), out.from.end(), 0u);
                  out.from.push_back(kNearestInputPoint);
                  out.new_points_mm.push_back(in.cloud.local_mm(in.cloud.size() - 1) + Vec3(0, 0, 0.01));
                  return out;
                }});
  cleaning.add(
      {"fail", "cannot", "this test", {}, [](const CleaningStepInput&) -> Result<CleaningStepOutput> {
         return Error{"it went wrong", "try another"};
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
  const auto parsed = test::value_of(cleaning.parse(text));
  return test::value_of(cleaning.run(cloud, parsed, 1, no_progress()));
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
  EXPECT_TRUE(test::contains(cleaning.parse("zebra").error().remedy, "drop, lift, add, fail"));
  EXPECT_TRUE(test::contains(cleaning.parse("drop/number=2").error().message(), "points"));
  EXPECT_FALSE(cleaning.parse("lift/by=11").ok());
  EXPECT_FALSE(cleaning.parse("").ok());
  EXPECT_FALSE(cleaning.parse("drop++lift").ok());
  EXPECT_TRUE(test::contains(Cleaning{}.parse("drop").error().remedy, "none in this program"));
  const cloud::Cloud cloud = grid();
  const auto fails = [&](const std::string& text) {
    const auto parsed = cleaning.parse(text);
    return cleaning.run(cloud, *parsed, 1, no_progress()).error().message();
  };
  EXPECT_EQ(fails("lift+fail"), "it went wrong; try another");
  EXPECT_TRUE(test::contains(fails("drop/points=500"), "every one of 121"));
}

TEST(Cleaning, StopsWhereTheUserAsksTo) {
  class Stopped : public Progress {
    void report(std::string_view, double) override {}
    [[nodiscard]] bool cancelled() const override { return true; }
  } stopped;
  const Cleaning cleaning = steps();
  const auto parsed = cleaning.parse("lift");
  EXPECT_TRUE(test::contains(cleaning.run(grid(), *parsed, 1, stopped).error().what, "stopped"));
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
  const auto got = test::value_of(
      loaded("[[model]]\ncloud = \"grid.ply\"\n"
             "  [[model.clean]]\n  step = \"drop\"\n  points = 21\n  [[model.clean]]\n  step = \"lift\"\n"
             "  [model.surface]\n  stiffness_n_per_mm = { column = \"number\" }\n",
             &cleaning));
  // The first point kept is number 21: a stiffness above 0.
  const render::ModelInput& model = got.input.models[0];
  ASSERT_EQ(model.cloud->size(), 100u);
  EXPECT_EQ(model.surface.per_point->stiffness_n_per_mm.front(), 21.0f);
  ASSERT_EQ(got.provenance[0].cleaning.size(), 2u);
  EXPECT_EQ(got.provenance[0].cleaned[0], "drop: 21 of 121 points removed");
  EXPECT_EQ(got.provenance[0].file_points, 121u);
}

TEST_F(CleanScene, GeneratedModelsKeepTheirFormulaAndLoseTheirFaces) {
  const Cleaning cleaning = steps();
  const auto got = test::value_of(loaded(
      "[[model]]\ngenerate = \"plane\"\npoints = 121\n  [[model.clean]]\n  step = \"drop\"\n", &cleaning));
  EXPECT_NE(got.input.models[0].analytic, nullptr);
  EXPECT_EQ(got.input.models[0].original_mesh, nullptr);
}

TEST_F(CleanScene, ErrorsNameTheLine) {
  const Cleaning cleaning = steps();
  const std::string model = "[[model]]\ngenerate = \"plane\"\npoints = 121\n",
                    lift = "  [[model.clean]]\n  step = \"lift\"\n";
  const std::pair<std::string, const char*> refused[] = {
      {"\n  [[model.clean]]\n  step = \"dorp\"\n", "scene.toml:5: "},
      {lift + "  by = \"high\"\n", "toml:4"},
      {"  [[model.clean]]\n  by = 1\n", "needs 'step'"},
      {"  [model.clean]\n  step = \"lift\"\n", "two brackets"},
      {"  [[model.clean]]\n  step = \"fail\"\n", "went wrong"},
      {"  [[model.view]]\n  cloud = \"a.ply\"\n", "'view' does nothing"}};
  for (const auto& [text, why] : refused)
    EXPECT_TRUE(test::contains(refusal(model + text, &cleaning), why)) << text;
  EXPECT_TRUE(test::contains(refusal(model + lift, nullptr), "no cleaning step"))
      << "a program without steps does not leave them out in silence";
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
  const auto got = test::value_of(
      loaded("[[model]]\ncloud = \"first.ply\"\nscale = 2\n  [[model.view]]\n  cloud = \"second.ply\"\n"
             "  position_mm = [10, -20, 30]\n  rotation = [0.5, 0.5, -0.5, 0.5]\n",
             nullptr));
  const cloud::Cloud& merged = *got.input.models[0].cloud;
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
  EXPECT_EQ(got.provenance[0].file_points, whole.size());
  EXPECT_TRUE(test::contains(got.provenance[0].format, "2 views"));
}

TEST_F(CleanScene, ViewsThatCannotBeMergedAreRefused) {
  ASSERT_TRUE(io::write_cloud_ply(in("grid.ply"), grid()).ok());
  const std::string model = "[[model]]\ncloud = \"grid.ply\"\n";
  const std::pair<const char*, const char*> refused[] = {
      {"  cloud = \"nowhere.ply\"\n", "nowhere.ply"},
      {"  rotation = [1, 0, 0, 0]\n", "needs 'cloud'"},
      {"  cloud = \"grid.ply\"\n  rotation = [2, 0, 0, 0]\n", "scene.toml:5"}};
  for (const auto& [text, why] : refused)
    EXPECT_TRUE(test::contains(refusal(model + "  [[model.view]]\n" + text, nullptr), why)) << text;
}

// Scene files that are refused, with the line and the remedy.

struct Refused {
  const char* name;
  const char* text;   // "@" stands for a model with a cloud, on two lines
  std::int64_t line;  // 0: any
  const char* says;   // part of the message
};

class RefusedScene : public testing::TestWithParam<Refused> {};

TEST_P(RefusedScene, NamesTheLineAndTheRemedy) {
  std::string text = GetParam().text;
  if (text.starts_with("@")) text.replace(0, 1, "[[model]]\ncloud = \"a.ply\"\n");
  const Result<SceneFile> scene = parse_scene(text, "bad.toml");
  ASSERT_TRUE(test::refused(scene, GetParam().says));
  EXPECT_EQ(scene.error().file, "bad.toml");
  if (GetParam().line > 0) {
    EXPECT_EQ(scene.error().line, GetParam().line);
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, RefusedScene,
    testing::Values(
        Refused{"empty", "", 1, "no model"}, Refused{"not_toml", "[[model]\ncloud = 3", 1, "column"},
        Refused{"misspelt_key", "@scael = 2", 3, "did you mean 'scale'"},
        Refused{"begun_key", "@[model.surface]\nstiffness = 2", 4, "did you mean 'stiffness_n_per_mm'"},
        Refused{"later_key", "@[model.surface]\ndamping = 0.7", 4, "not in this version"},
        Refused{"later_table", "@[device]\nname = \"x\"", 3, "not in this version"},
        Refused{"friction_below_0", "@[model.surface]\nfriction = -0.1", 4, "from 0 to 10000"},
        Refused{"friction_half", "@[model.surface]\nfriction = { static = 0.5 }", 4,
                "'static' and 'dynamic'"},
        Refused{"friction_reversed", "@[model.surface]\nfriction = { static = 0.3, dynamic = 0.5 }", 4,
                "static >= dynamic"},
        Refused{"deformation", "@[model.surface]\ndeformation = 1.0", 4, "below 1"},
        Refused{"map", "@[model.surface]\nfriction = { image = \"a.pfm\" }", 4, "needs 'tile_mm'"},
        Refused{"texture_kind", "@[model.surface.texture]\nkind = \"wood\"\ndepth_mm = 1\nwavelength_mm = 1",
                4, "choose from grating, noise, image"},
        Refused{"texture_without_image",
                "@[model.surface.texture]\nkind = \"image\"\ndepth_mm = 1\nwavelength_mm = 1", 3,
                "needs 'image'"},
        Refused{"dent", "@[model.surface.dent]\nyield_mm = 1", 3, "needs 'radius_mm'"},
        Refused{"region_empty", "@[[model.region]]\nx_mm = [0, 1]", 3, "changes nothing"},
        Refused{"region_range", "@[[model.region]]\nx_mm = [1, 0]\nfriction = 1", 4, "[low, high]"},
        Refused{"region_key", "@[[model.region]]\nfricton = 1", 4, "did you mean 'friction'"},
        Refused{"motion_key", "@[model.motion]\nvelocity = 1", 4, "did you mean 'velocity_mm_s'"},
        Refused{"motion_stop", "@[model.motion]\nstart_s = 2\nstop_s = 1", 5, "later than"},
        Refused{"simulation", "@[simulation]\nrate_hz = 0", 4, "above 0"},
        Refused{"unknown_table", "@[rendrer]\nname = \"x\"", 3, "did you mean 'renderer'"},
        Refused{"both_sources", "@generate = \"plane\"", 0, "either 'cloud' or 'generate'"},
        Refused{"no_source", "[[model]]\nscale = 2", 0, "either 'cloud' or 'generate'"},
        Refused{"generator", "[[model]]\ngenerate = \"sinusiod\"", 2, "no generator"},
        Refused{"generator_key", "[[model]]\ngenerate = \"plane\"\npoint = 100", 3, "did you mean 'points'"},
        Refused{"generator_value", "[[model]]\ngenerate = \"plane\"\npoints = \"many\"", 0, "whole number"},
        Refused{"unit_of_generated", "[[model]]\ngenerate = \"plane\"\nunit = \"m\"", 3,
                "'unit' does nothing for a [[model]] with generate = \"plane\""},
        Refused{"points_of_a_file", "@points = 100", 3, "it is of a [[model]] with a generator"},
        Refused{"order_of_the_sphere", "[[model]]\ngenerate = \"sphere\"\norder = \"raster\"", 3,
                "no key 'order'"},
        Refused{"seed_without_jitter", "[[model]]\ngenerate = \"plane\"\nseed = 7", 0,
                "seed=7 does nothing with jitter=0"},
        Refused{
            "axis_of_noise",
            "@[model.surface.texture]\nkind = \"noise\"\ndepth_mm = 1\nwavelength_mm = 1\naxis = [1, 0, 0]",
            7, "'axis' does nothing for a texture of kind \"noise\""},
        Refused{"seed_of_a_grating",
                "@[model.surface.texture]\nkind = \"grating\"\ndepth_mm = 1\nwavelength_mm = 1\nseed = 2", 7,
                "'seed' does nothing"},
        Refused{"image_of_a_grating",
                "@[model.surface.texture]\nkind = \"grating\"\ndepth_mm = 1\nwavelength_mm = 1\nimage = "
                "\"a.pfm\"",
                7, "'image' does nothing"},
        Refused{"texture_key", "@[model.surface.texture]\nkind = \"noise\"\nsed = 1", 5,
                "did you mean 'seed'"},
        Refused{"motion_of_nothing", "@[model.motion]\nstart_s = 1", 3, "moves nothing"},
        Refused{"motion_about_no_turn", "@[model.motion]\nvelocity_mm_s = [1, 0, 0]\nabout_mm = [0, 0, 0]", 5,
                "'about_mm' does nothing"},
        Refused{"simulation_of_rest", "@[simulation]\nrate_hz = 200", 4, "no model moves"},
        Refused{"within_one_corner", "@within_mm = [[0, 0, 0]]", 3, "two corners"},
        Refused{"within_six_numbers", "@within_mm = [0, 0, 0, 1, 1, 1]", 3, "3 numbers"},
        Refused{"within_reversed", "@within_mm = [[0, 0, 2], [1, 1, 1]]", 3, "is no box"},
        Refused{"within_inf", "@within_mm = [[0, 0, 0], [1, inf, 1]]", 3, "finite"},
        Refused{"within_of_generated", "[[model]]\ngenerate = \"plane\"\nwithin_mm = [[0, 0, 0], [1, 1, 1]]",
                3, "'within_mm' does nothing for a [[model]] with generate = \"plane\""},
        Refused{"unit", "@unit = \"parsec\"", 3, "parsec"},
        Refused{"scale_zero", "@scale = 0", 3, "from 1e-12"},
        Refused{"scale_nan", "@scale = nan", 3, "finite"},
        Refused{"scale_text", "@scale = \"2\"", 3, "finite number"},
        Refused{"rotation_length", "@rotation = [1, 1, 0, 0]", 3, "length 1.41421"},
        Refused{"rotation_zero", "@rotation = [0, 0, 0, 0]", 3, "length 0"},
        Refused{"rotation_count", "@rotation = [1, 0, 0]", 3, "4 numbers"},
        Refused{"position_inf", "@position_mm = [inf, 0, 0]", 3, "finite"},
        Refused{"stiffness_negative", "@[model.surface]\nstiffness_n_per_mm = -1", 4, "above 0"},
        Refused{"model_no_list", "[model]\ncloud = \"a.ply\"", 0, "two brackets"},
        Refused{"renderer_unnamed", "@[renderer]\nshading = \"none\"", 3, "needs 'name'"},
        Refused{"stiffness_beyond", "@[model.surface]\nstiffness_n_per_mm = 1e300", 4, "up to 1000000000"},
        Refused{"friction_beyond", "@[model.surface]\nfriction = 1e300", 4, "from 0 to 10000"},
        Refused{"speed_beyond", "@[model.motion]\nvelocity_mm_s = [0, -1e300, 0]", 4,
                "from -1000000000000000 to"},
        Refused{"force_limit", "@[control]\nforce_limit_n = 0", 4, "above 0"},
        Refused{"coupling_number", "@[control]\ncoupling = 0.5", 4, "must be a table"},
        Refused{"coupling_without_spring", "@[control]\ncoupling = { damping_n_s_per_mm = 0.001 }", 4,
                "stiffness_n_per_mm"},
        Refused{"coupling_negative",
                "@[control]\ncoupling = { stiffness_n_per_mm = 1, damping_n_s_per_mm = -1 }", 4,
                "damping_n_s_per_mm"},
        Refused{"coupling_key", "@[control]\ncoupling = { stifness_n_per_mm = 1 }", 4,
                "did you mean 'stiffness_n_per_mm'"},
        Refused{"passivity_text", "@[control]\npassivity = \"on\"", 4, "true or false"},
        Refused{"passivity_limit", "@[control]\npassivity = { damping_limit_n_s_per_mm = 0 }", 4, "above 0"},
        Refused{"rate_limit", "@[control]\nrate_limit_n_per_s = -1", 4, "above 0"},
        Refused{"turn_limit", "@[control]\nturn_limit_deg_per_s = nan", 4, "finite"},
        Refused{"filter_name", "@[control]\nrate_limit_n_per_s = 9\nfilter = \"kalman\"", 5, "no filter"},
        Refused{"filter_of_nothing", "@[control]\nfilter = \"literal\"", 4, "limits nothing"},
        Refused{"control_key", "@[control]\npasivity = true", 4, "did you mean 'passivity'"}),
    [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace

// A part of a model's file: the box's frame, what follows its points, and files of cells.

namespace {

class WithinScene : public prepared::test::Prepared {
 protected:
  Result<LoadedScene> loaded(const std::string& text, const LoadOptions& options = {}) const {
    PALPATE_ASSIGN(const SceneFile scene, parse_scene(text, in("scene.toml")));
    io::Readers readers;
    io::add_standard_readers(readers);
    return load(scene, readers, options, no_progress());
  }
};

TEST_F(WithinScene, TheBoxIsInTheModelsFrameAfterUnitAndScaleAndBeforeThePose) {
  write("columns.csv", "x,y,z,k\n0,0,0,1\n1,0,0,2\n2,0,0,3\n3,0,0,4\n");
  const auto got =
      test::value_of(loaded("[[model]]\ncloud = \"columns.csv\"\nunit = \"cm\"\nscale = 2\n"
                            "position_mm = [1000, 0, 0]\nwithin_mm = [[20, -1, -1], [40, 1, 1]]\n"
                            "[model.surface]\nstiffness_n_per_mm = { column = \"k\" }\n"));
  const render::ModelInput& model = got.input.models[0];
  ASSERT_EQ(model.cloud->size(), 2u);
  EXPECT_EQ(model.cloud->point_mm(0), Vec3(20, 0, 0));
  EXPECT_EQ(model.surface.per_point->stiffness_n_per_mm, (std::vector<float>{2, 3}));
  EXPECT_EQ(model.world_from_model.translation_mm.x(), 1000.0);
  EXPECT_EQ(got.provenance[0].file_points, 4u);
  EXPECT_EQ(got.provenance[0].outside, 2u);
  EXPECT_TRUE(test::contains(got.provenance[0].source,
                             "columns.csv (2 of 4 points, within (20, -1, -1) to (40, 1, 1) mm)"));
}

TEST_F(WithinScene, OfViewsItIsOfTheMergedPoints) {
  write("a.csv", "x,y,z,k\n0,0,0,1\n5,0,0,2\n");
  write("b.csv", "x,y,z,k\n0,0,0,3\n0,5,0,4\n");
  const std::string model =
      "[[model]]\ncloud = \"a.csv\"\nunit = \"mm\"\n[[model.view]]\ncloud = \"b.csv\"\n"
      "position_mm = [5, 0, 0]\n";
  LoadOptions options;
  options.within_mm = geometry::Aabb{{4, -1, -1}, {6, 6, 1}};
  const auto got = test::value_of(loaded(model, options));
  ASSERT_EQ(got.input.models[0].cloud->size(), 3u);
  EXPECT_EQ(got.input.models[0].cloud->point_mm(2), Vec3(5, 5, 0));
  EXPECT_EQ(got.input.models[0].cloud->properties[0].values, (std::vector<float>{2, 3, 4}));
  EXPECT_EQ(got.provenance[0].outside, 1u);
  options.within_mm = geometry::Aabb{{8, 8, 8}, {9, 9, 9}};
  EXPECT_TRUE(test::refused(loaded(model, options), "the points are within (0, 0, 0) to (5, 5, 0) mm"));
}

TEST_F(WithinScene, FacesAreCutBeforePointsAreTakenInThem) {
  write("a.off", "OFF\n5 2 0\n0 0 0\n9 0 0\n0 9 0\n50 0 0\n50 9 0\n3 0 1 2\n3 1 3 4\n");
  const auto got =
      test::value_of(loaded("[[model]]\ncloud = \"a.off\"\nunit = \"mm\"\nsample = \"random:points=500\"\n"
                            "within_mm = [[0, 0, 0], [9, 9, 0]]\n"));
  EXPECT_LT(got.input.models[0].cloud->box_mm().high_mm.x(), 9.001);
  EXPECT_EQ(got.sampled_mesh[0]->triangles.size(), 1u);
}

TEST_F(WithinScene, OfCellsItIsWhatBruteForceKeeps) {
  const auto sheet = prepared::test::Sheet::make(150, 0.3, {5.0, 6.0, 7.0}, 13);
  prepared::PrepareCellsOptions made;
  made.quantum_mm = 1e-4;
  (void)prepare(sheet.points, made, "hall.palcells");
  const std::string model = "[[model]]\ncloud = \"hall.palcells\"\n";
  const auto whole = test::value_of(loaded(model));
  const auto part = test::value_of(loaded(model + "within_mm = [[10, 10, 0], [17, 21, 30]]\n"));
  // Away from the box's faces: each cloud rounds its points about its own middle.
  const geometry::Aabb sure = geometry::Aabb{{10, 10, 0}, {17, 21, 30}}.grown(-1e-5);
  const geometry::Aabb perhaps = geometry::Aabb{{10, 10, 0}, {17, 21, 30}}.grown(1e-5);
  std::size_t least = 0, most = 0;
  const cloud::Cloud& all = *whole.input.models[0].cloud;
  for (std::size_t i = 0; i < all.size(); ++i) {
    least += sure.contains(all.point_mm(i)) ? 1u : 0u;
    most += perhaps.contains(all.point_mm(i)) ? 1u : 0u;
  }
  const std::size_t kept = part.input.models[0].cloud->size();
  EXPECT_GT(least, 100u);
  EXPECT_GE(kept, least);
  EXPECT_LE(kept, most);
  EXPECT_EQ(part.provenance[0].file_points, sheet.points.size());
  EXPECT_EQ(part.provenance[0].outside, sheet.points.size() - kept);
  // The command line's box replaces the scene's, and is checked.
  LoadOptions options;
  options.within_mm = geometry::Aabb{{-2, -2, -2}, {-1, -1, -1}};
  EXPECT_TRUE(test::refused(loaded(model + "within_mm = [[10, 10, 0], [17, 21, 30]]\n", options),
                            "hall.palcells: no point is within (-2, -2, -2)"));
  options.within_mm = geometry::Aabb{{2, 0, 0}, {1, 1, 1}};
  EXPECT_TRUE(test::refused(loaded(model, options), "is no box"));
}

}  // namespace

}  // namespace palpate::scene
