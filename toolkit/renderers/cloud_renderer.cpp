#include "toolkit/renderers/cloud_renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "toolkit/points/point_model.h"
#include "toolkit/render/shading.h"
#include "toolkit/renderers/cloud_on_stars.h"
#include "toolkit/renderers/cloud_on_vertices.h"
#include "toolkit/stars/refine.h"
#include "toolkit/stars/star_walk.h"

namespace palpate::render {
namespace {

/// Options that only the surface of vertices has.
std::vector<OptionSpec> vertex_specs() {
  std::vector<OptionSpec> specs = point_model_specs();
  for (OptionSpec& spec : specs) {
    if (spec.key != "cell") continue;
    spec.default_value = "0";
    spec.only_with = {{"partition", {"grid"}}};  // the leaves of a tree choose their own sizes
  }
  for (OptionSpec& spec : box_test_specs()) specs.push_back(std::move(spec));
  specs.push_back(partition_spec());
  specs.push_back(shading_spec("force shading; auto: facet where stiffness x local spacing is felt"));
  for (OptionSpec& spec : specs) spec.only_with.push_back({"surface", {"auto", "vertices"}});
  return specs;
}

bool asks_vertices(const Options& options) {
  const std::vector<OptionSpec> specs = vertex_specs();
  return options.text("surface") == "vertices" ||
         std::any_of(specs.begin(), specs.end(), [&](const OptionSpec& spec) {
           return options.has(spec.key) && options.text(spec.key) != spec.default_value;
         });
}

}  // namespace

RendererInfo cloud_info() {
  RendererInfo info;
  info.name = "cloud";
  info.summary = "chapter 3 made right: the points' own triangles, a god object that only descends";
  info.source =
      "El-Far, chapter 3; stars of points, contact side, friction cone, joint contact and bounds are ours";
  info.role = Role::kOurs;
  info.supports = kFeltOnStars;
  info.options = vertex_specs();
  info.options.push_back({"combine",
                          OptionKind::kChoice,
                          "joint",
                          "several models touched at once: constrained jointly, or the sum of their forces",
                          {"joint", "sum"}});
  info.options.push_back(
      {"surface",
       OptionKind::kChoice,
       "auto",
       "what is felt: triangles that the points agree on (stars), or a plane at every point; auto: stars, "
       "unless an option of the vertices is given",
       {"auto", "stars", "vertices"}});
  info.options.push_back({"sides",
                          OptionKind::kChoice,
                          "auto",
                          "of a piece that encloses a volume but for holes: the one where the replay begins "
                          "is felt (auto), or both, as of a vase",
                          {"auto", "both"},
                          -1e300,
                          1e300,
                          {{"surface", {"auto", "stars"}}}});
  info.options.push_back({"refine",
                          OptionKind::kInteger,
                          "0",
                          "times that every triangle is cut into four on curves through the points: half the "
                          "error and four times the memory each",
                          {},
                          0.0,
                          static_cast<double>(stars::kMostRefined),
                          {{"surface", {"auto", "stars"}}}});
  info.options.push_back({"raster",
                          OptionKind::kChoice,
                          "auto",
                          "triangles are read from the rows and columns of a scan where its cells are a "
                          "surface (auto), or made as of any points (off)",
                          {"auto", "off"},
                          -1e300,
                          1e300,
                          {{"surface", {"auto", "stars"}}}});
  info.options.push_back(
      {"walk_steps",
       OptionKind::kInteger,
       fmt::format("{}", stars::kMaxFacetMoves),
       "moves of the god object from facet to facet in a frame, at most; what is left is done "
       "in the next",
       {},
       16.0,
       4096.0,
       {{"surface", {"auto", "stars"}}}});
  info.make = [](const Options& options) {
    return asks_vertices(options) ? make_cloud_on_vertices(options) : make_cloud_on_stars(options);
  };
  return info;
}

}  // namespace palpate::render
