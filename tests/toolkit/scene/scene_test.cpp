// What a scene file says, and what is loaded for it.
#include "toolkit/scene/scene.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "tests/in_folder.h"

namespace palpate::scene {
namespace {

const char* const kWhole = R"toml(
[[model]]
cloud = "scans/dragon.ply.gz"
unit = "m"
scale = 1.025
position_mm = [1, 2.5, -3]
rotation = [0.7071, 0.7071, 0, 0]
  [model.surface]
  stiffness_n_per_mm = 0.8

[[model]]
generate = "sinusoid"
points = 10201
jitter = 0.1
seed = 7

[renderer]
name = "cloud"
shading = "none"
box_mm = 0.15
[control]
force_limit_n = 3.3
)toml";

TEST(SceneFile, ReadsEverythingTheSchemaHas) {
  const Result<SceneFile> scene = parse_scene(kWhole, "folder/scene.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  ASSERT_EQ(scene->models.size(), 2u);
  const SceneModel& dragon = scene->models[0];
  EXPECT_EQ(dragon.cloud, "folder/scans/dragon.ply.gz");
  EXPECT_EQ(dragon.name, "dragon");
  EXPECT_EQ(dragon.unit, io::Unit::kMetre);
  EXPECT_EQ(dragon.scale, 1.025);
  EXPECT_EQ(dragon.world_from_model.translation_mm, Vec3(1, 2.5, -3));
  EXPECT_NEAR(dragon.world_from_model.rotation.norm(), 1.0, 1e-15);
  EXPECT_NEAR(dragon.world_from_model.rotation.w(), std::sqrt(0.5), 1e-15);
  EXPECT_EQ(dragon.surface.stiffness_n_per_mm, 0.8);
  const SceneModel& sinusoid = scene->models[1];
  ASSERT_TRUE(sinusoid.generate.has_value());
  EXPECT_EQ(sinusoid.generate->name, "sinusoid");
  EXPECT_EQ(sinusoid.generate->options.text("points"), "10201");
  EXPECT_EQ(sinusoid.generate->options.text("jitter"), "0.1");
  EXPECT_TRUE(sinusoid.world_from_model.is_identity());
  EXPECT_EQ(sinusoid.surface.stiffness_n_per_mm, surface::Surface{}.stiffness_n_per_mm);
  ASSERT_TRUE(scene->renderer.has_value());
  EXPECT_EQ(scene->renderer->name, "cloud");
  EXPECT_EQ(scene->renderer->options.text("shading"), "none");
  EXPECT_EQ(scene->renderer->options.text("box_mm"), "0.15");
  EXPECT_EQ(scene->force_limit_n, 3.3);
}

TEST(SceneFile, IdentityRotationStaysExact) {
  const Result<SceneFile> scene =
      parse_scene("[[model]]\ncloud = \"a.ply\"\nrotation = [1, 0, 0, 0]\n", "s.toml");
  ASSERT_TRUE(scene.ok());
  EXPECT_TRUE(scene->models[0].world_from_model.is_identity());
}

TEST(SceneFile, ReadsSurfacesRegionsAndMotion) {
  const Result<SceneFile> scene = parse_scene(R"toml(
[[model]]
generate = "plane"
  [model.surface]
  stiffness_n_per_mm = { column = "k" }
  friction = { static = 0.7, dynamic = 0.5 }
  deformation = 0.25
    [model.surface.texture]
    kind = "grating"
    effect = "force"
    depth_mm = 0.1
    wavelength_mm = 2
    axis = [0, 3, 4]
    [model.surface.dent]
    yield_mm = 0.5
    radius_mm = 3
    rate_mm_s = 20
  [[model.region]]
  x_mm = [0, 10]
  friction = 0.9
  [[model.region]]
  z_mm = [-1, 1]
  deformation = 0.5
  stiffness_n_per_mm = 2
  [model.motion]
  velocity_mm_s = [0, 0, 50]
  turn_deg_s = [180, 0, 0]
  about_mm = [1, 2, 3]
  start_s = 0.5
  stop_s = 2
[simulation]
rate_hz = 100
)toml",
                                              "scene.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  const SceneModel& model = scene->models[0];
  EXPECT_EQ(model.sources.stiffness_column, "k");
  EXPECT_EQ(model.surface.friction.static_coefficient, 0.7);
  EXPECT_EQ(model.surface.friction.dynamic_coefficient, 0.5);
  EXPECT_EQ(model.surface.deformation, 0.25);
  EXPECT_EQ(model.surface.texture.effect, surface::TextureEffect::kForce);
  EXPECT_LT((model.surface.texture.axis - Vec3(0, 0.6, 0.8)).norm(), 1e-15);
  EXPECT_EQ(model.surface.dent.radius_mm, 3.0);
  ASSERT_EQ(model.regions.size(), 2u);
  EXPECT_EQ(model.regions[0].friction->dynamic_coefficient, 0.9);
  EXPECT_TRUE(model.regions[0].box_mm.contains(Vec3(5, 1e9, -1e9)));
  EXPECT_FALSE(model.regions[0].box_mm.contains(Vec3(11, 0, 0)));
  ASSERT_TRUE(model.motion.has_value());
  EXPECT_NEAR(model.motion->turn_rad_s.x(), 3.14159265358979, 1e-12);
  EXPECT_EQ(model.motion->about_mm->y(), 2.0);
  EXPECT_EQ(scene->simulation_hz, 100.0);
}

std::string written(const std::string& name, const std::string& text) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / name;
  std::ofstream(file, std::ios::binary) << text;
  return file.string();
}

TEST(SceneFile, RegionsAndColumnsBecomePropertiesOfPoints) {
  const std::string cloud = written("columns.csv", "x,y,z,mu\n0,0,0,0.1\n1,0,0,0.2\n2,0,0,0.3\n");
  const std::string head = "[[model]]\ncloud = \"" + cloud + "\"\nunit = \"mm\"\n";
  const auto loaded = [&](const std::string& rest) {
    const SceneFile scene = parse_scene(head + rest, "/scene.toml").value();
    io::Readers readers;
    io::add_standard_readers(readers);
    return load(scene, readers, {}, no_progress());
  };
  const auto with_column = loaded(
      "[model.surface]\nfriction = { column = \"mu\" }\n[[model.region]]\nx_mm = [1.5, 9]\n"
      "friction = { static = 0.9, dynamic = 0.8 }\n");
  ASSERT_TRUE(with_column) << with_column.error().message();
  const auto& p = with_column->input.models[0].surface.per_point;
  ASSERT_NE(p, nullptr);
  EXPECT_EQ(p->static_friction, (std::vector<float>{0.1f, 0.2f, 0.9f}));
  EXPECT_EQ(p->dynamic_friction, (std::vector<float>{0.1f, 0.2f, 0.8f}));
  EXPECT_TRUE(p->stiffness_n_per_mm.empty());
  const auto missing = loaded("[model.surface]\nfriction = { column = \"nu\" }\n");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().file, "/scene.toml");
  EXPECT_EQ(missing.error().line, 4);
  EXPECT_NE(missing.error().message().find("it has mu"), std::string::npos) << missing.error().message();
  EXPECT_EQ(loaded("")->input.models[0].surface.per_point, nullptr) << "nothing varies, nothing is stored";
}

TEST(SceneFile, ImagesBecomeTexturesAndFrictionMaps) {
  // A PFM of 2 x 2 pixels, little endian: a column of 0 and one of 1.
  std::string pfm = "Pf\n2 2\n-1.0\n";
  for (const float value : {0.0f, 1.0f, 0.0f, 1.0f}) pfm.append(reinterpret_cast<const char*>(&value), 4);
  const std::string image = written("two.pfm", pfm);
  const SceneFile scene =
      parse_scene(
          "[[model]]\ngenerate = \"plane\"\nextent_mm = 4\nspacing_mm = 1\n[model.surface]\nfriction = { "
          "image = "
          "\"" +
              image +
              "\", tile_mm = 2, low = 0.2, high = 0.6 }\n[model.surface.texture]\nkind = \"image\"\n"
              "depth_mm = 0.1\nwavelength_mm = 2\nimage = \"" +
              image + "\"\n",
          "/scene.toml")
          .value();
  io::Readers readers;
  io::add_standard_readers(readers);
  const auto loaded = load(scene, readers, {}, no_progress());
  ASSERT_TRUE(loaded) << loaded.error().message();
  const render::ModelInput& model = loaded->input.models[0];
  ASSERT_NE(model.surface.texture.image, nullptr);
  EXPECT_EQ(model.surface.texture.image->height, (std::vector<std::uint16_t>{0, 65535, 0, 65535}));
  for (std::size_t i = 0; i < model.cloud->size(); ++i) {
    const double x = model.cloud->point_mm(i).x();
    const bool second = x - 2.0 * std::floor(x / 2.0) >= 1.0;
    EXPECT_NEAR(static_cast<double>(model.surface.per_point->static_friction[i]), second ? 0.6 : 0.2, 1e-6)
        << x;
  }
}

TEST(SceneFile, MotionIsPublishedByTheSimulation) {
  const SceneFile scene =
      parse_scene(
          "[[model]]\ngenerate = \"plane\"\npoints = 25\nposition_mm = [0, 0, 5]\n[model.motion]\n"
          "velocity_mm_s = [0, 0, 10]\n",
          "/scene.toml")
          .value();
  io::Readers readers;
  const auto loaded = load(scene, readers, {}, no_progress());
  ASSERT_TRUE(loaded);
  ASSERT_NE(loaded->input.simulation, nullptr);
  loaded->input.simulation->reset();
  loaded->input.simulation->advance(1.0);
  EXPECT_NEAR(loaded->input.models[0].motion->newest().at(1.5).translation_mm.z(), 20.0, 1e-12);
}

TEST(SceneFile, ControlIsOffUnlessAskedFor) {
  const Result<SceneFile> scene =
      parse_scene("[[model]]\ncloud = \"a.ply\"\n[control]\npassivity = false\n", "s.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_FALSE(scene->control.any());
  EXPECT_EQ(scene->force_limit_n, 0.0);
}

TEST(SceneFile, ReadsEveryControl) {
  const Result<SceneFile> scene = parse_scene(
      "[[model]]\ncloud = \"a.ply\"\n[control]\nforce_limit_n = 3.3\n"
      "coupling = { stiffness_n_per_mm = 0.4, damping_n_s_per_mm = 0.0001 }\n"
      "rate_limit_n_per_s = 200\nturn_limit_deg_per_s = 900\nfilter = \"literal\"\n"
      "passivity = { damping_limit_n_s_per_mm = 0.002 }\n",
      "s.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->force_limit_n, 3.3);
  ASSERT_TRUE(scene->control.coupling);
  EXPECT_EQ(scene->control.coupling->stiffness_n_per_mm, 0.4);
  EXPECT_EQ(scene->control.coupling->damping_n_s_per_mm, 0.0001);
  EXPECT_EQ(scene->control.filter.rate_limit_n_per_s, 200.0);
  EXPECT_EQ(scene->control.filter.turn_limit_deg_per_s, 900.0);
  EXPECT_EQ(scene->control.filter.form, control::FilterForm::kLiteral);
  ASSERT_TRUE(scene->control.passivity);
  EXPECT_EQ(scene->control.passivity->damping_limit_n_s_per_mm, 0.002);
}

TEST(SceneFile, RefusesAFileTooLargeToBeAScene) {
  const Result<SceneFile> scene = parse_scene(std::string(kMaxSceneBytes + 1, '#'), "big.toml");
  ASSERT_FALSE(scene.ok());
  EXPECT_NE(scene.error().what.find("larger"), std::string::npos);
}

TEST(SceneFile, SurvivesDeepNesting) {
  const std::string deep = "a = " + std::string(100000, '[') + std::string(100000, ']');
  EXPECT_FALSE(parse_scene(deep, "deep.toml").ok());
}

class SceneOnDisk : public InFolder {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(in(name)) << text;
    return in(name);
  }
};

TEST_F(SceneOnDisk, LoadsAFileBesideTheSceneInMillimetres) {
  write("points.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
  const std::string file =
      write("scene.toml", "[[model]]\ncloud = \"points.xyz\"\nunit = \"m\"\nscale = 2\n");
  const Result<SceneFile> scene = open_scene(file);
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  io::Readers readers;
  io::add_standard_readers(readers);
  const Result<LoadedScene> loaded = load(*scene, readers, {}, no_progress());
  ASSERT_TRUE(loaded.ok()) << loaded.error().message();
  ASSERT_EQ(loaded->input.models.size(), 1u);
  const cloud::Cloud& cloud = *loaded->input.models[0].cloud;
  ASSERT_EQ(cloud.size(), 4u);
  EXPECT_NEAR(cloud.box_mm().extent_mm().x(), 2000.0, 1e-3);
  EXPECT_EQ(loaded->provenance[0].content_hash.size(), 16u);
  EXPECT_FALSE(loaded->provenance[0].unit_guessed);
}

TEST_F(SceneOnDisk, AMissingModelIsAnErrorWithAPlace) {
  const std::string file = write("scene.toml", "\n[[model]]\ncloud = \"nowhere.ply\"\n");
  const Result<SceneFile> scene = open_scene(file);
  ASSERT_TRUE(scene.ok());
  io::Readers readers;
  io::add_standard_readers(readers);
  const Result<LoadedScene> loaded = load(*scene, readers, {}, no_progress());
  ASSERT_FALSE(loaded.ok());
  // The line would be the scene's, and the file is not there to have one.
  EXPECT_EQ(loaded.error().message(), in("nowhere.ply") + ": no such file; check the path");
}

TEST_F(SceneOnDisk, WishesForFilesAreRefusedWhereThereIsNone) {
  write("points.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
  io::Readers readers;
  io::add_standard_readers(readers);
  LoadOptions unit, post, vertical, non_finite;
  unit.unit = io::Unit::kMetre;
  post.post_mm = 1.0;
  vertical.vertical_mm = 1.0;
  non_finite.non_finite = cloud::NonFinite::kRefuse;
  const auto refused = [&](const std::string& scene, const LoadOptions& options) {
    const Result<SceneFile> opened = open_scene(scene);
    EXPECT_TRUE(opened.ok());
    const Result<LoadedScene> loaded = load(*opened, readers, options, no_progress());
    return loaded ? std::string() : loaded.error().message();
  };
  for (const auto& [options, name] :
       {std::pair(unit, "--unit"), std::pair(post, "--post-mm"), std::pair(vertical, "--vertical-mm"),
        std::pair(non_finite, "--non-finite")})
    EXPECT_NE(refused("plane:points=121", options).find(std::string(name) + " is of model files"),
              std::string::npos);
  const std::string file = in("points.xyz");
  EXPECT_EQ(refused(file, unit), "");
  EXPECT_EQ(refused(file, non_finite), "");
  EXPECT_NE(refused(file, post).find("'post_mm' is of grids of heights"), std::string::npos);
  EXPECT_NE(refused(file, vertical).find("'vertical_mm' is of grids of heights"), std::string::npos);
  const std::string said = write("said.toml", "[[model]]\ncloud = \"points.xyz\"\nunit = \"m\"\n");
  EXPECT_NE(refused(said, unit).find("--unit does nothing"), std::string::npos);
}

TEST_F(SceneOnDisk, ARegionWithoutPointsIsWarnedOf) {
  const std::string file =
      write("scene.toml",
            "[[model]]\ngenerate = \"plane\"\npoints = 121\n[[model.region]]\nx_mm = [900, "
            "901]\nfriction = 1\n[[model.region]]\nx_mm = [0, 10]\nfriction = 1\n");
  const Result<SceneFile> scene = open_scene(file);
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  const Result<LoadedScene> loaded = load(*scene, io::Readers{}, {}, no_progress());
  ASSERT_TRUE(loaded.ok());
  ASSERT_EQ(loaded->provenance[0].warnings.size(), 1u);
  EXPECT_NE(loaded->provenance[0].warnings[0].find("line 4 holds no point"), std::string::npos)
      << loaded->provenance[0].warnings[0];
}

TEST_F(SceneOnDisk, OnlyRegularFilesAreScenes) {
  ASSERT_EQ(::mkfifo(in("pipe.toml").c_str(), 0600), 0);  // nobody writes: opening it would wait for ever
  EXPECT_NE(open_scene(in("pipe.toml")).error().message().find("a pipe"), std::string::npos);
  std::filesystem::create_symlink("/dev/zero", in("zero.toml"));
  EXPECT_NE(open_scene(in("zero.toml")).error().message().find("a device"), std::string::npos);
  EXPECT_EQ(open_scene(in("none.toml")).error().message(),
            in("none.toml") + ": no such file; check the path");
  const std::string wide = write("wide.toml", std::string("\xFF\xFE[\0", 4));
  EXPECT_NE(open_scene(wide).error().message().find("UTF-16"), std::string::npos);
  const std::string marked = write("marked.toml", "\xEF\xBB\xBF[[model]]\ngenerate = \"plane\"\n");
  EXPECT_TRUE(open_scene(marked).ok());
}

TEST_F(SceneOnDisk, GeneratorsLoadWithFormulaAndScale) {
  const Result<SceneFile> scene = open_scene("plane:points=121:extent_mm=10:seed=1");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  LoadOptions options;
  options.scale = 3.0;
  const Result<LoadedScene> loaded = load(*scene, io::Readers{}, options, no_progress());
  ASSERT_TRUE(loaded.ok()) << loaded.error().message();
  EXPECT_NE(loaded->input.models[0].analytic, nullptr);
  EXPECT_NE(loaded->input.models[0].original_mesh, nullptr);
  EXPECT_NEAR(loaded->input.models[0].cloud->box_mm().extent_mm().x(), 30.0, 1e-4);
}

TEST_F(SceneOnDisk, PointsAreTakenFromFacesThatNoRendererSees) {
  const io::Readers readers;
  const auto parsed = parse_scene(
      "[[model]]\ngenerate = \"pebble\"\npoints = 300\nseed = 3\nsample = "
      "\"blue:spacing=0.5:subdivide=1:seed=2\"\n",
      "s.toml");
  ASSERT_TRUE(parsed) << parsed.error().message();
  const auto loaded = load(*parsed, readers, {}, no_progress());
  ASSERT_TRUE(loaded) << loaded.error().message();
  const render::ModelInput& model = loaded->input.models.front();
  EXPECT_EQ(model.original_mesh, nullptr);
  EXPECT_EQ(model.analytic, nullptr);
  ASSERT_EQ(loaded->sampled_mesh.size(), 1u);
  ASSERT_NE(loaded->sampled_mesh[0], nullptr);
  EXPECT_GT(loaded->sampled_mesh[0]->triangles.size(), 2000u) << "four for one";
  EXPECT_GT(model.cloud->size(), 2000u);
  EXPECT_NE(loaded->provenance[0].source.find("blue:"), std::string::npos);
  const auto other = load(*parse_scene("[[model]]\ngenerate = \"pebble\"\npoints = 300\nseed = 3\nsample = "
                                       "\"blue:spacing=0.5:subdivide=1:seed=4\"\n",
                                       "s.toml"),
                          readers, {}, no_progress());
  EXPECT_NE(other->provenance[0].content_hash, loaded->provenance[0].content_hash);
  for (const char* bad : {"bleu", "blue:spacing=-1", "blue:views=2", "scan:sedd=1"}) {
    const auto refused =
        parse_scene(std::string("[[model]]\ngenerate = \"pebble\"\nsample = \"") + bad + "\"\n", "s.toml");
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().line, 3) << bad;
  }
  const auto without =
      parse_scene("[[model]]\ngenerate = \"torus\"\nmesh = false\nsample = \"blue\"\n", "s.toml");
  ASSERT_TRUE(without);
  const auto refused = load(*without, readers, {}, no_progress());
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().what.find("no faces"), std::string::npos);
}

TEST_F(SceneOnDisk, NeitherFileNorGeneratorSaysWhatIsUnderstood) {
  const Result<SceneFile> scene = open_scene("no-such-thing");
  ASSERT_FALSE(scene.ok());
  EXPECT_NE(scene.error().message().find("sinusoid"), std::string::npos);
  EXPECT_FALSE(open_scene("missing.toml").ok());
  EXPECT_FALSE(open_scene("plane:points=121:wrong=1").ok());
}

}  // namespace
}  // namespace palpate::scene
