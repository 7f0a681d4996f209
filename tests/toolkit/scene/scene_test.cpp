// What a scene file says, and what is loaded for it.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include <palpate/scene.h>
#include "tests/files.h"
#include "tests/toolkit/messages.h"

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
  const auto scene = test::value_of(parse_scene(kWhole, "folder/scene.toml"));
  ASSERT_EQ(scene.models.size(), 2u);
  const SceneModel& dragon = scene.models[0];
  EXPECT_EQ(dragon.cloud, "folder/scans/dragon.ply.gz");
  EXPECT_EQ(dragon.name, "dragon");
  EXPECT_EQ(dragon.unit, io::Unit::kMetre);
  EXPECT_EQ(dragon.scale, 1.025);
  EXPECT_EQ(dragon.world_from_model.translation_mm, Vec3(1, 2.5, -3));
  EXPECT_NEAR(dragon.world_from_model.rotation.norm(), 1.0, 1e-15);
  EXPECT_NEAR(dragon.world_from_model.rotation.w(), std::sqrt(0.5), 1e-15);
  EXPECT_EQ(dragon.surface.stiffness_n_per_mm, 0.8);
  const SceneModel& sinusoid = scene.models[1];
  ASSERT_TRUE(sinusoid.generate.has_value());
  EXPECT_EQ(sinusoid.generate->name, "sinusoid");
  EXPECT_EQ(sinusoid.generate->options.text("points"), "10201");
  EXPECT_EQ(sinusoid.generate->options.text("jitter"), "0.1");
  EXPECT_TRUE(sinusoid.world_from_model.is_identity());
  EXPECT_EQ(sinusoid.surface.stiffness_n_per_mm, surface::Surface{}.stiffness_n_per_mm);
  ASSERT_TRUE(scene.renderer.has_value());
  EXPECT_EQ(scene.renderer->name, "cloud");
  EXPECT_EQ(scene.renderer->options.text("shading"), "none");
  EXPECT_EQ(scene.renderer->options.text("box_mm"), "0.15");
  EXPECT_EQ(scene.force_limit_n, 3.3);
}

TEST(SceneFile, IdentityRotationStaysExact) {
  const auto scene =
      test::value_of(parse_scene("[[model]]\ncloud = \"a.ply\"\nrotation = [1, 0, 0, 0]\n", "s.toml"));
  EXPECT_TRUE(scene.models[0].world_from_model.is_identity());
}

TEST(SceneFile, ReadsSurfacesRegionsAndMotion) {
  const auto scene = test::value_of(parse_scene(R"toml(
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
                                                "scene.toml"));
  const SceneModel& model = scene.models[0];
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
  EXPECT_EQ(scene.simulation_hz, 100.0);
}

std::string written(const std::string& name, const std::string& text) {
  const std::filesystem::path file = std::filesystem::path(testing::TempDir()) / name;
  std::ofstream(file, std::ios::binary) << text;
  return file.string();
}

Result<LoadedScene> loaded_of(const Result<SceneFile>& scene, const LoadOptions& options = {}) {
  if (!scene) return scene.error();
  io::Readers readers;
  io::add_standard_readers(readers);
  return load(*scene, readers, options, no_progress());
}
Result<LoadedScene> loaded_of(const std::string& text) {
  return loaded_of(parse_scene(text, "/scene.toml"));
}

TEST(SceneFile, RegionsAndColumnsBecomePropertiesOfPoints) {
  const std::string cloud = written("columns.csv", "x,y,z,mu\n0,0,0,0.1\n1,0,0,0.2\n2,0,0,0.3\n");
  const std::string head = "[[model]]\ncloud = \"" + cloud + "\"\nunit = \"mm\"\n";
  const auto loaded = [&](const std::string& rest) { return loaded_of(head + rest); };
  const auto with_column = test::value_of(
      loaded("[model.surface]\nfriction = { column = \"mu\" }\n[[model.region]]\nx_mm = [1.5, 9]\n"
             "friction = { static = 0.9, dynamic = 0.8 }\n"));
  const auto& p = with_column.input.models[0].surface.per_point;
  ASSERT_NE(p, nullptr);
  EXPECT_EQ(p->static_friction, (std::vector<float>{0.1f, 0.2f, 0.9f}));
  EXPECT_EQ(p->dynamic_friction, (std::vector<float>{0.1f, 0.2f, 0.8f}));
  EXPECT_TRUE(p->stiffness_n_per_mm.empty());
  const auto missing = loaded("[model.surface]\nfriction = { column = \"nu\" }\n");
  ASSERT_TRUE(test::refused(missing, "it has mu"));
  EXPECT_EQ(missing.error().file, "/scene.toml");
  EXPECT_EQ(missing.error().line, 4);
  EXPECT_EQ(loaded("")->input.models[0].surface.per_point, nullptr) << "nothing varies, nothing is stored";
}

TEST(SceneFile, ImagesBecomeTexturesAndFrictionMaps) {
  // A PFM of 2 x 2 pixels, little endian: a column of 0 and one of 1.
  std::string pfm = "Pf\n2 2\n-1.0\n";
  for (const float value : {0.0f, 1.0f, 0.0f, 1.0f}) pfm.append(reinterpret_cast<const char*>(&value), 4);
  const std::string image = written("two.pfm", pfm);
  const auto loaded = test::value_of(loaded_of(
      "[[model]]\ngenerate = \"plane\"\nextent_mm = 4\nspacing_mm = 1\n[model.surface]\nfriction = { image = "
      "\"" +
      image +
      "\", tile_mm = 2, low = 0.2, high = 0.6 }\n[model.surface.texture]\nkind = \"image\"\n"
      "depth_mm = 0.1\nwavelength_mm = 2\nimage = \"" +
      image + "\"\n"));
  const render::ModelInput& model = loaded.input.models[0];
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
  const auto loaded = test::value_of(
      loaded_of("[[model]]\ngenerate = \"plane\"\npoints = 25\nposition_mm = [0, 0, 5]\n[model.motion]\n"
                "velocity_mm_s = [0, 0, 10]\n"));
  ASSERT_NE(loaded.input.simulation, nullptr);
  loaded.input.simulation->reset();
  loaded.input.simulation->advance(1.0);
  EXPECT_NEAR(loaded.input.models[0].motion->newest().at(1.5).translation_mm.z(), 20.0, 1e-12);
}

TEST(SceneFile, ControlIsOffUnlessAskedFor) {
  const auto scene =
      test::value_of(parse_scene("[[model]]\ncloud = \"a.ply\"\n[control]\npassivity = false\n", "s.toml"));
  EXPECT_FALSE(scene.control.any());
  EXPECT_EQ(scene.force_limit_n, 0.0);
}

TEST(SceneFile, ReadsEveryControl) {
  const auto scene = test::value_of(
      parse_scene("[[model]]\ncloud = \"a.ply\"\n[control]\nforce_limit_n = 3.3\n"
                  "coupling = { stiffness_n_per_mm = 0.4, damping_n_s_per_mm = 0.0001 }\n"
                  "rate_limit_n_per_s = 200\nturn_limit_deg_per_s = 900\nfilter = \"literal\"\n"
                  "passivity = { damping_limit_n_s_per_mm = 0.002 }\n",
                  "s.toml"));
  EXPECT_EQ(scene.force_limit_n, 3.3);
  ASSERT_TRUE(scene.control.coupling);
  EXPECT_EQ(scene.control.coupling->stiffness_n_per_mm, 0.4);
  EXPECT_EQ(scene.control.coupling->damping_n_s_per_mm, 0.0001);
  EXPECT_EQ(scene.control.filter.rate_limit_n_per_s, 200.0);
  EXPECT_EQ(scene.control.filter.turn_limit_deg_per_s, 900.0);
  EXPECT_EQ(scene.control.filter.form, control::FilterForm::kLiteral);
  ASSERT_TRUE(scene.control.passivity);
  EXPECT_EQ(scene.control.passivity->damping_limit_n_s_per_mm, 0.002);
}

TEST(SceneFile, RefusesAFileTooLargeToBeAScene) {
  EXPECT_TRUE(test::refused(parse_scene(std::string(kMaxSceneBytes + 1, '#'), "big.toml"), "larger"));
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
  const auto loaded = test::value_of(loaded_of(
      open_scene(write("scene.toml", "[[model]]\ncloud = \"points.xyz\"\nunit = \"m\"\nscale = 2\n"))));
  ASSERT_EQ(loaded.input.models.size(), 1u);
  const cloud::Cloud& cloud = *loaded.input.models[0].cloud;
  ASSERT_EQ(cloud.size(), 4u);
  EXPECT_NEAR(cloud.box_mm().extent_mm().x(), 2000.0, 1e-3);
  EXPECT_EQ(loaded.provenance[0].content_hash.size(), 16u);
  EXPECT_FALSE(loaded.provenance[0].unit_guessed);
}

TEST_F(SceneOnDisk, AMissingModelIsAnErrorWithAPlace) {
  const std::string file = write("scene.toml", "\n[[model]]\ncloud = \"nowhere.ply\"\n");
  // The line would be the scene's, and the file is not there to have one.
  EXPECT_TRUE(
      test::refused(loaded_of(open_scene(file)), in("nowhere.ply") + ": no such file; check the path"));
}

TEST_F(SceneOnDisk, WishesForFilesAreRefusedWhereThereIsNone) {
  write("points.xyz", "0 0 0\n1 0 0\n0 1 0\n0 0 1\n");
  LoadOptions unit, post, vertical, within, non_finite;
  unit.unit = io::Unit::kMetre;
  post.post_mm = 1.0;
  vertical.vertical_mm = 1.0;
  within.within_mm = geometry::Aabb{Vec3::Zero(), Vec3::Ones()};
  non_finite.non_finite = cloud::NonFinite::kRefuse;
  const auto refused = [&](const std::string& scene, const LoadOptions& options) {
    const Result<LoadedScene> loaded = loaded_of(open_scene(scene), options);
    return loaded ? std::string() : loaded.error().message();
  };
  for (const auto& [options, name] :
       {std::pair(unit, "--unit"), std::pair(post, "--post-mm"), std::pair(vertical, "--vertical-mm"),
        std::pair(within, "--within"), std::pair(non_finite, "--non-finite")})
    EXPECT_TRUE(
        test::contains(refused("plane:points=121", options), std::string(name) + " is of model files"));
  const std::string file = in("points.xyz");
  EXPECT_EQ(refused(file, unit), "");
  EXPECT_EQ(refused(file, non_finite), "");
  EXPECT_TRUE(test::contains(refused(file, post), "'post_mm' is of grids of heights"));
  EXPECT_TRUE(test::contains(refused(file, vertical), "'vertical_mm' is of grids of heights"));
  const std::string said = write("said.toml", "[[model]]\ncloud = \"points.xyz\"\nunit = \"m\"\n");
  EXPECT_TRUE(test::contains(refused(said, unit), "--unit does nothing"));
}

TEST_F(SceneOnDisk, ARegionWithoutPointsIsWarnedOf) {
  const std::string file =
      write("scene.toml",
            "[[model]]\ngenerate = \"plane\"\npoints = 121\n[[model.region]]\nx_mm = [900, "
            "901]\nfriction = 1\n[[model.region]]\nx_mm = [0, 10]\nfriction = 1\n");
  const auto loaded = test::value_of(loaded_of(open_scene(file)));
  ASSERT_EQ(loaded.provenance[0].warnings.size(), 1u);
  EXPECT_TRUE(test::contains(loaded.provenance[0].warnings[0], "line 4 holds no point"));
}

TEST_F(SceneOnDisk, AByteOrderMarkIsPassedOverAndNoFileIsNamed) {
  EXPECT_TRUE(test::refused(open_scene(in("none.toml")), in("none.toml") + ": no such file; check the path"));
  const std::string wide = write("wide.toml", std::string("\xFF\xFE[\0", 4));
  EXPECT_TRUE(test::contains(open_scene(wide).error().message(), "UTF-16"));
  const std::string marked = write("marked.toml", "\xEF\xBB\xBF[[model]]\ngenerate = \"plane\"\n");
  EXPECT_TRUE(open_scene(marked).ok());
}

TEST_F(SceneOnDisk, GeneratorsLoadWithFormulaAndScale) {
  LoadOptions options;
  options.scale = 3.0;
  const auto loaded = test::value_of(loaded_of(open_scene("plane:points=121:extent_mm=10:seed=1"), options));
  EXPECT_NE(loaded.input.models[0].analytic, nullptr);
  EXPECT_NE(loaded.input.models[0].original_mesh, nullptr);
  EXPECT_NEAR(loaded.input.models[0].cloud->box_mm().extent_mm().x(), 30.0, 1e-4);
}

TEST_F(SceneOnDisk, PointsAreTakenFromFacesThatNoRendererSees) {
  const auto sampled = [](const std::string& seed) {
    return loaded_of(
        "[[model]]\ngenerate = \"pebble\"\npoints = 300\nseed = 3\n"
        "sample = \"blue:spacing=0.5:subdivide=1:seed=" +
        seed + "\"\n");
  };
  const auto loaded = test::value_of(sampled("2"));
  const render::ModelInput& model = loaded.input.models.front();
  EXPECT_EQ(model.original_mesh, nullptr);
  EXPECT_EQ(model.analytic, nullptr);
  ASSERT_EQ(loaded.sampled_mesh.size(), 1u);
  ASSERT_NE(loaded.sampled_mesh[0], nullptr);
  EXPECT_GT(loaded.sampled_mesh[0]->triangles.size(), 2000u) << "four for one";
  EXPECT_GT(model.cloud->size(), 2000u);
  EXPECT_TRUE(test::contains(loaded.provenance[0].source, "blue:"));
  EXPECT_NE(sampled("4")->provenance[0].content_hash, loaded.provenance[0].content_hash);
  for (const char* bad : {"bleu", "blue:spacing=-1", "blue:views=2", "scan:sedd=1"}) {
    const auto refused =
        parse_scene(std::string("[[model]]\ngenerate = \"pebble\"\nsample = \"") + bad + "\"\n", "s.toml");
    ASSERT_FALSE(refused) << bad;
    EXPECT_EQ(refused.error().line, 3) << bad;
  }
  EXPECT_TRUE(test::refused(loaded_of("[[model]]\ngenerate = \"torus\"\nmesh = false\nsample = \"blue\"\n"),
                            "no faces"));
}

TEST_F(SceneOnDisk, NeitherFileNorGeneratorSaysWhatIsUnderstood) {
  EXPECT_TRUE(test::refused(open_scene("no-such-thing"), "sinusoid"));
  EXPECT_FALSE(open_scene("missing.toml").ok());
  EXPECT_FALSE(open_scene("plane:points=121:wrong=1").ok());
}

// The page about scene files names every key that is read, where it is read.

/// The example of docs/reference/scene-keys.md.
std::string example() {
  std::ifstream page(PALPATE_SOURCE_ROOT "/docs/reference/scene-keys.md");
  std::stringstream all;
  all << page.rdbuf();
  const std::string text = all.str(), fence = "```toml\n";
  const std::size_t begin = text.find(fence);
  EXPECT_NE(begin, std::string::npos);
  return text.substr(begin + fence.size(), text.find("```", begin + fence.size()) - begin - fence.size());
}

/// What stands under each header, comments included; "" holds the headers.
std::map<std::string, std::string> sections(const std::string& text) {
  std::map<std::string, std::string> found;
  std::string table, line;
  std::istringstream lines(text);
  const std::regex header(R"(^\s*\[\[?([a-z.]+)\]\]?(.*))");
  for (std::smatch match; std::getline(lines, line); line.clear()) {
    if (std::regex_match(line, match, header)) {
      table = match[1];
      found[""] += table + "\n";
      line = match[2];
    }
    found[table] += line + "\n";
  }
  return found;
}

bool has_word(const std::string& text, const std::string& word) {
  return std::regex_search(text, std::regex("(^|[^a-z_.])" + word + "($|[^a-z_.])"));
}

TEST(SceneKeys, ThePageHasThemAll) {
  std::map<std::string, std::string> page = sections(example());
  std::size_t keys = 0;
  for (const TableKeys& table : scene_keys())
    for (const std::string& key : table.keys) {
      ++keys;
      const std::string own_table = table.table.empty() ? key : table.table + "." + key;
      EXPECT_TRUE(has_word(page[table.table], key) || has_word(page[""], own_table))
          << "docs/reference/scene-keys.md does not name '" << key << "' of [" << table.table << "]";
    }
  EXPECT_GT(keys, 50u) << "the tables of fields were not found";
}

TEST(SceneKeys, TheExampleOfThePageIsRead) {
  const auto scene = test::value_of(parse_scene(example(), "docs/reference/scene-keys.md"));
  EXPECT_EQ(scene.models.size(), 3u);
}

}  // namespace
}  // namespace palpate::scene
