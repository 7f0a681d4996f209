// The truth that nobody shares, through the real program.

#include <nlohmann/json.hpp>

#include "experiments/session/session.h"
#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

class Truth : public OnCommandLine {
 protected:
  template <class... More>
  [[nodiscard]] json compared(const std::string& scene, const More&... more) const {
    succeeds("compare", scene, "--out @/out --force --passes 1", more...);
    const std::string text = text_in("out/result.json");
    expect_valid("result", text);
    return json::parse(text);
  }
};

const char* const kThin = "shells:points=8000:extent_mm=20:gap_mm=0.5";
const char* const kStrokes = "strokes:frames=4000:depth_mm=1:slowest_mm_s=5:period_frames=200:seed=2";

TEST_F(Truth, FramesBeyondAThinWallAreApartAndScoredAgainAlike) {
  const json document = compared(kThin, "--renderers cloud,analytic --path", kStrokes);
  const json& cloud = document["renderers"][0]["accuracy"];
  EXPECT_GT(cloud["history_percent"], 5.0) << "pressed through half a millimetre";
  EXPECT_LT(cloud["history_percent"], 95.0);
  EXPECT_THAT(document["truth"]["exactness"].get<std::string>(), HasSubstr("closest-point"));
  bool told = false;
  for (const json& note : document["notes"])
    told = told || note.get<std::string>().find("history decides") != std::string::npos;
  EXPECT_TRUE(told);
  // The analytic renderer follows the same path: no error among the frames apart either.
  EXPECT_LT(document["renderers"][1]["accuracy"]["force_rms_whole_percent"], 0.01);
  succeeds("report score @/out");
  const json rescored = json_in("out/result.json");
  for (std::size_t i = 0; i < 2; ++i)
    for (const char* key : {"accuracy", "energy"})
      EXPECT_EQ(rescored["renderers"][i][key], document["renderers"][i][key]) << i << key;
}

TEST_F(Truth, TheClosestPointCanBeTheTruth) {
  const json followed = compared(kThin, "--renderers analytic --path", kStrokes);
  const json closest = compared(kThin, "--renderers analytic --reference closest-point --path", kStrokes);
  EXPECT_EQ(closest["truth"]["name"], "closest-point");
  const json &a = followed["renderers"][0]["accuracy"], &b = closest["renderers"][0]["accuracy"];
  EXPECT_EQ(a["history_frames"], b["history_frames"]) << "the same two, the other way round";
  EXPECT_LT(b["force_rms_percent"], 0.1);
  EXPECT_GT(b["force_rms_whole_percent"], 5.0)
      << "beyond the wall it follows, and the closest point does not";
}

TEST_F(Truth, SamplesOfAMeshArePutAgainstTheMesh) {
  write_text(folder_ / "s.toml",
             "[[model]]\ngenerate = \"pebble\"\npoints = 800\nextent_mm = 40\nseed = 3\n"
             "sample = \"random:spacing=0.5:subdivide=1:seed=@\"\n");
  std::string text = text_in("s.toml");
  std::vector<std::string> paths;
  for (const char* seed : {"1", "2"}) {
    std::string one = text;
    one.replace(one.find('@'), 1, seed);
    write_text(folder_ / "one.toml", one);
    const json document = compared(in("one.toml"), "--renderers cloud --path", kStrokes);
    EXPECT_EQ(document["truth"]["name"], "original-mesh");
    const json& a = document["renderers"][0]["accuracy"];
    EXPECT_GT(a["contact_frames"], 300);
    EXPECT_GT(a["force_rms_percent"], 0.01) << "points off the vertices are not the mesh";
    EXPECT_LT(a["force_p50_percent"], 20.0);
    paths.push_back(document["path_hash"]);
  }
  EXPECT_EQ(paths[0], paths[1]) << "the path follows the truth, not the points";
}

TEST_F(Truth, AHandFeelsNothingWrongOnANoisyBody) {
  const json document = compared("rounded-box:points=20000:sampling=blue:noise=0.15:seed=3",
                                 "--renderers cloud-smooth,cloud --path hand:frames=10000:seed=3");
  const json &smooth = document["renderers"][0]["accuracy"], &facets = document["renderers"][1]["accuracy"];
  EXPECT_GT(smooth["contact_frames"], 5000);
  for (const char* key : {"caught", "lost", "kicks"}) EXPECT_EQ(smooth[key], 0) << key;
  EXPECT_LT(smooth["force_peak_excess_percent"], 50.0);
  // The same noise and path on facets through the points.
  EXPECT_LT(smooth["force_rms_whole_percent"], 0.75 * facets["force_rms_whole_percent"].get<double>());
}

TEST_F(Truth, FrictionHasItsFigures) {
  if (all_renderers().find("cloud-vertices") == nullptr) GTEST_SKIP() << "built without the baselines";
  const json document = compared("plane:points=10201:extent_mm=40",
                                 "--renderers cloud,cloud-vertices:shading=none --friction 0.6,0.4 "
                                 "--path strokes:frames=4000:depth_mm=1");
  EXPECT_EQ(document["scoring"]["static_friction"], 0.6);
  const json &shaded = document["renderers"][0]["accuracy"], &nearest = document["renderers"][1]["accuracy"];
  EXPECT_EQ(shaded["friction_cone_percent"], 0.0);
  EXPECT_LT(shaded["friction_slip_error_percent"], 0.1);
  EXPECT_GT(shaded["stick_slip_percent"], 98.0);
  EXPECT_LT(shaded["stick_drift_mm_s"], 0.1);
  EXPECT_TRUE(shaded["force_rms_percent"].is_null());
  // Planes of points 0.4 mm apart, unshaded: the force turns with every point.
  EXPECT_GT(nearest["friction_cone_percent"], 10.0);
  EXPECT_GT(nearest["friction_slip_error_percent"], 5.0);
  EXPECT_LT(nearest["stick_slip_percent"], 90.0);
  succeeds("report score @/out");
  const json rescored = json_in("out/result.json");
  EXPECT_EQ(rescored["renderers"][0]["accuracy"], document["renderers"][0]["accuracy"]);
}

TEST_F(Truth, TheThreeProtocolsAreTables) {
  if (all_renderers().find("mesh-godobject") == nullptr) GTEST_SKIP() << "built without the baselines";
  succeeds("reproduce --tables off-vertex,scanner,ladder --quick --out @/out");
  const std::string page = text_in("out/report.html");
  for (const char* protocol : {"off-vertex", "scanner", "ladder"}) {
    const std::string text = text_in(std::string("out/") + protocol + "/result.json");
    expect_valid("result", text);
    const json document = json::parse(text);
    EXPECT_GE(document["renderers"].size(), 15u) << protocol;
    std::size_t scored = 0;
    for (const json& r : document["renderers"]) scored += r["accuracy"].is_object() ? 1u : 0u;
    EXPECT_EQ(scored, document["renderers"].size()) << protocol;
    EXPECT_THAT(page, HasSubstr(document["title"].get<std::string>()));
  }
  EXPECT_NE(file_text(in("out/off-vertex.html")).find("missed beyond 0.1 mm"), std::string::npos);
}

}  // namespace
}  // namespace palpate::experiments
