// Scene files that are refused, with the line and the remedy.
#include <gtest/gtest.h>

#include "toolkit/scene/scene.h"

namespace palpate::scene {
namespace {

struct Refused {
  const char* name;
  const char* text;
  std::int64_t line;  // 0: any
  const char* says;   // part of the message
};

class RefusedScene : public testing::TestWithParam<Refused> {};

TEST_P(RefusedScene, NamesTheLineAndTheRemedy) {
  const Result<SceneFile> scene = parse_scene(GetParam().text, "bad.toml");
  ASSERT_FALSE(scene.ok());
  EXPECT_EQ(scene.error().file, "bad.toml");
  if (GetParam().line > 0) {
    EXPECT_EQ(scene.error().line, GetParam().line);
  }
  EXPECT_NE(scene.error().message().find(GetParam().says), std::string::npos) << scene.error().message();
}

INSTANTIATE_TEST_SUITE_P(
    All, RefusedScene,
    testing::Values(
        Refused{"empty", "", 1, "no model"}, Refused{"not_toml", "[[model]\ncloud = 3", 1, "column"},
        Refused{"misspelt_key", "[[model]]\ncloud = \"a.ply\"\nscael = 2", 3, "did you mean 'scale'"},
        Refused{"begun_key", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nstiffness = 2", 4,
                "did you mean 'stiffness_n_per_mm'"},
        Refused{"later_key", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\ndamping = 0.7", 4,
                "not in this version"},
        Refused{"later_table", "[[model]]\ncloud = \"a.ply\"\n[device]\nname = \"x\"", 3,
                "not in this version"},
        Refused{"friction_below_0", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nfriction = -0.1", 4,
                "from 0 to 10000"},
        Refused{"friction_half", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nfriction = { static = 0.5 }",
                4, "'static' and 'dynamic'"},
        Refused{"friction_reversed",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nfriction = { static = 0.3, dynamic = 0.5 }",
                4, "static >= dynamic"},
        Refused{"deformation", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\ndeformation = 1.0", 4,
                "below 1"},
        Refused{"map", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nfriction = { image = \"a.pfm\" }", 4,
                "needs 'tile_mm'"},
        Refused{"texture_kind",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"wood\"\ndepth_mm = "
                "1\nwavelength_mm = 1",
                4, "choose from grating, noise, image"},
        Refused{"texture_without_image",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"image\"\ndepth_mm = "
                "1\nwavelength_mm = 1",
                3, "needs 'image'"},
        Refused{"dent", "[[model]]\ncloud = \"a.ply\"\n[model.surface.dent]\nyield_mm = 1", 3,
                "needs 'radius_mm'"},
        Refused{"region_empty", "[[model]]\ncloud = \"a.ply\"\n[[model.region]]\nx_mm = [0, 1]", 3,
                "changes nothing"},
        Refused{"region_range", "[[model]]\ncloud = \"a.ply\"\n[[model.region]]\nx_mm = [1, 0]\nfriction = 1",
                4, "[low, high]"},
        Refused{"region_key", "[[model]]\ncloud = \"a.ply\"\n[[model.region]]\nfricton = 1", 4,
                "did you mean 'friction'"},
        Refused{"motion_key", "[[model]]\ncloud = \"a.ply\"\n[model.motion]\nvelocity = 1", 4,
                "did you mean 'velocity_mm_s'"},
        Refused{"motion_stop", "[[model]]\ncloud = \"a.ply\"\n[model.motion]\nstart_s = 2\nstop_s = 1", 5,
                "later than"},
        Refused{"simulation", "[[model]]\ncloud = \"a.ply\"\n[simulation]\nrate_hz = 0", 4, "above 0"},
        Refused{"unknown_table", "[[model]]\ncloud = \"a.ply\"\n[rendrer]\nname = \"x\"", 3,
                "did you mean 'renderer'"},
        Refused{"both_sources", "[[model]]\ncloud = \"a.ply\"\ngenerate = \"plane\"", 0,
                "either 'cloud' or 'generate'"},
        Refused{"no_source", "[[model]]\nscale = 2", 0, "either 'cloud' or 'generate'"},
        Refused{"generator", "[[model]]\ngenerate = \"sinusiod\"", 2, "no generator"},
        Refused{"generator_key", "[[model]]\ngenerate = \"plane\"\npoint = 100", 3, "did you mean 'points'"},
        Refused{"generator_value", "[[model]]\ngenerate = \"plane\"\npoints = \"many\"", 0, "whole number"},
        Refused{"unit_of_generated", "[[model]]\ngenerate = \"plane\"\nunit = \"m\"", 3,
                "'unit' does nothing for a [[model]] with generate = \"plane\""},
        Refused{"points_of_a_file", "[[model]]\ncloud = \"a.ply\"\npoints = 100", 3,
                "it is of a [[model]] with a generator"},
        Refused{"order_of_the_sphere", "[[model]]\ngenerate = \"sphere\"\norder = \"raster\"", 3,
                "no key 'order'"},
        Refused{"seed_without_jitter", "[[model]]\ngenerate = \"plane\"\nseed = 7", 0,
                "seed=7 does nothing with jitter=0"},
        Refused{"axis_of_noise",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"noise\"\ndepth_mm = "
                "1\nwavelength_mm = 1\naxis = [1, 0, 0]",
                7, "'axis' does nothing for a texture of kind \"noise\""},
        Refused{"seed_of_a_grating",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"grating\"\ndepth_mm = "
                "1\nwavelength_mm = 1\nseed = 2",
                7, "'seed' does nothing"},
        Refused{"image_of_a_grating",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"grating\"\ndepth_mm = "
                "1\nwavelength_mm = 1\nimage = \"a.pfm\"",
                7, "'image' does nothing"},
        Refused{"texture_key",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface.texture]\nkind = \"noise\"\nsed = 1", 5,
                "did you mean 'seed'"},
        Refused{"motion_of_nothing", "[[model]]\ncloud = \"a.ply\"\n[model.motion]\nstart_s = 1", 3,
                "moves nothing"},
        Refused{
            "motion_about_no_turn",
            "[[model]]\ncloud = \"a.ply\"\n[model.motion]\nvelocity_mm_s = [1, 0, 0]\nabout_mm = [0, 0, 0]",
            5, "'about_mm' does nothing"},
        Refused{"simulation_of_rest", "[[model]]\ncloud = \"a.ply\"\n[simulation]\nrate_hz = 200", 4,
                "no model moves"},
        Refused{"unit", "[[model]]\ncloud = \"a.ply\"\nunit = \"parsec\"", 3, "parsec"},
        Refused{"scale_zero", "[[model]]\ncloud = \"a.ply\"\nscale = 0", 3, "from 1e-12"},
        Refused{"scale_nan", "[[model]]\ncloud = \"a.ply\"\nscale = nan", 3, "finite"},
        Refused{"scale_text", "[[model]]\ncloud = \"a.ply\"\nscale = \"2\"", 3, "finite number"},
        Refused{"rotation_length", "[[model]]\ncloud = \"a.ply\"\nrotation = [1, 1, 0, 0]", 3,
                "length 1.41421"},
        Refused{"rotation_zero", "[[model]]\ncloud = \"a.ply\"\nrotation = [0, 0, 0, 0]", 3, "length 0"},
        Refused{"rotation_count", "[[model]]\ncloud = \"a.ply\"\nrotation = [1, 0, 0]", 3, "4 numbers"},
        Refused{"position_inf", "[[model]]\ncloud = \"a.ply\"\nposition_mm = [inf, 0, 0]", 3, "finite"},
        Refused{"stiffness_negative",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nstiffness_n_per_mm = -1", 4, "above 0"},
        Refused{"model_no_list", "[model]\ncloud = \"a.ply\"", 0, "two brackets"},
        Refused{"renderer_unnamed", "[[model]]\ncloud = \"a.ply\"\n[renderer]\nshading = \"none\"", 3,
                "needs 'name'"},
        Refused{"stiffness_beyond",
                "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nstiffness_n_per_mm = 1e300", 4,
                "up to 1000000000"},
        Refused{"friction_beyond", "[[model]]\ncloud = \"a.ply\"\n[model.surface]\nfriction = 1e300", 4,
                "from 0 to 10000"},
        Refused{"speed_beyond",
                "[[model]]\ncloud = \"a.ply\"\n[model.motion]\nvelocity_mm_s = [0, -1e300, 0]", 4,
                "from -1000000000000000 to"},
        Refused{"force_limit", "[[model]]\ncloud = \"a.ply\"\n[control]\nforce_limit_n = 0", 4, "above 0"},
        Refused{"coupling_number", "[[model]]\ncloud = \"a.ply\"\n[control]\ncoupling = 0.5", 4,
                "must be a table"},
        Refused{"coupling_without_spring",
                "[[model]]\ncloud = \"a.ply\"\n[control]\ncoupling = { damping_n_s_per_mm = 0.001 }", 4,
                "stiffness_n_per_mm"},
        Refused{"coupling_negative",
                "[[model]]\ncloud = \"a.ply\"\n[control]\ncoupling = { stiffness_n_per_mm = 1, "
                "damping_n_s_per_mm = -1 }",
                4, "damping_n_s_per_mm"},
        Refused{"coupling_key",
                "[[model]]\ncloud = \"a.ply\"\n[control]\ncoupling = { stifness_n_per_mm = 1 }", 4,
                "did you mean 'stiffness_n_per_mm'"},
        Refused{"passivity_text", "[[model]]\ncloud = \"a.ply\"\n[control]\npassivity = \"on\"", 4,
                "true or false"},
        Refused{"passivity_limit",
                "[[model]]\ncloud = \"a.ply\"\n[control]\npassivity = { damping_limit_n_s_per_mm = 0 }", 4,
                "above 0"},
        Refused{"rate_limit", "[[model]]\ncloud = \"a.ply\"\n[control]\nrate_limit_n_per_s = -1", 4,
                "above 0"},
        Refused{"turn_limit", "[[model]]\ncloud = \"a.ply\"\n[control]\nturn_limit_deg_per_s = nan", 4,
                "finite"},
        Refused{"filter_name",
                "[[model]]\ncloud = \"a.ply\"\n[control]\nrate_limit_n_per_s = 9\nfilter = \"kalman\"", 5,
                "no filter"},
        Refused{"filter_of_nothing", "[[model]]\ncloud = \"a.ply\"\n[control]\nfilter = \"literal\"", 4,
                "limits nothing"},
        Refused{"control_key", "[[model]]\ncloud = \"a.ply\"\n[control]\npasivity = true", 4,
                "did you mean 'passivity'"}),
    [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace palpate::scene
