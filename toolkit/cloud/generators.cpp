// The list of generators and their options.
#include <palpate/generate.h>
#include "toolkit/cloud/limits.h"
#include "toolkit/cloud/scanner.h"

namespace palpate::cloud {
namespace {

OptionSpec aspect(const std::string& axis, std::string value) {
  return {"aspect_" + axis,
          OptionKind::kNumber,
          std::move(value),
          "length along " + axis + " over that along x",
          {},
          1e-3,
          1e3};
}

/// How points are sampled, and then changed.
std::vector<OptionSpec> sampling_options() {
  std::vector<OptionSpec> specs = {
      {"sampling",
       OptionKind::kChoice,
       "grid",
       "random: even by area; blue: the same with a least distance; lines: scan lines; scan: a scanner's "
       "rays",
       {"grid", "random", "blue", "lines", "scan"}},
      {"ratio",
       OptionKind::kNumber,
       "8",
       "distance of the lines over that of the points along them",
       {},
       1,
       1e3,
       {{"sampling", {"lines"}}}},
      {"density",
       OptionKind::kNumber,
       "1",
       "points per area for x above the middle over those below",
       {},
       1,
       1e4,
       {{"sampling", {"random", "blue"}}}},
      {"noise",
       OptionKind::kNumber,
       "0",
       "normal, along the surface's normal, of a scan along the ray: standard deviation in spacings",
       {},
       0,
       100},
      {"outliers", OptionKind::kNumber, "0", "share of the points that lie off the surface", {}, 0, 0.9},
      {"outliers_at",
       OptionKind::kChoice,
       "near",
       "near: 2 to 10 spacings off; box: anywhere in the model's box",
       {"near", "box"},
       -1e300,
       1e300,
       {{"outliers"}}},
      {"shuffle", OptionKind::kFlag, "false", "points in a random order", {}, 0, 0},
  };
  for (OptionSpec& spec : scanner_specs({{"sampling", {"scan"}}})) specs.push_back(std::move(spec));
  return specs;
}

std::vector<OptionSpec> with_common(std::string extent, std::string extent_help, std::string points,
                                    std::vector<OptionSpec> own) {
  std::vector<OptionSpec> specs = {
      {"points",
       OptionKind::kInteger,
       std::move(points),
       "number of points, the nearest the grid can give",
       {},
       4,
       kMaxGeneratedPoints},
      {"spacing_mm",
       OptionKind::kNumber,
       "0",
       "distance of neighbours instead of points; 0 = from points",
       {},
       0,
       1e300},
      {"extent_mm", OptionKind::kNumber, std::move(extent), std::move(extent_help), {}, 1e-300, 1e150},
      {"jitter",
       OptionKind::kNumber,
       "0",
       "largest shift along the surface, fraction of the spacing",
       {},
       0,
       0.45},
      {"nonuniform",
       OptionKind::kNumber,
       "0",
       "a: the spacing varies from 1 - a to 1 + a times the even one",
       {},
       0,
       0.9},
      {"seed",
       OptionKind::kInteger,
       "1",
       "of what is by chance, and of the shape of relief and pebble",
       {},
       0,
       1e18},
      {"scale", OptionKind::kNumber, "1", "multiplies every length", {}, 1e-150, 1e150},
      {"mesh", OptionKind::kFlag, "true", "also make the regular triangulation", {}, 0, 0}};
  for (OptionSpec& spec : specs)
    if (spec.key == "jitter" || spec.key == "nonuniform") spec.only_with = {{"sampling", {"grid"}}};
  for (OptionSpec& spec : own)
    if (spec.key == "order") spec.only_with = {{"sampling", {"grid"}}};
  specs.insert(specs.end(), own.begin(), own.end());
  const std::vector<OptionSpec> sampling = sampling_options();
  specs.insert(specs.end(), sampling.begin(), sampling.end());
  return specs;
}

std::vector<Generator> make_generators() {
  const std::string side = "side of the square, mm";
  const std::string fields = "1002001";
  const OptionSpec order = {"order",
                            OptionKind::kChoice,
                            "raster",
                            "of points: every row from its start, or to and fro",
                            {"raster", "boustrophedon"}};
  return {
      {"sinusoid", "z = A (cos(2 pi x / L) + cos(2 pi y / L)), table 7 of the thesis; scanner order",
       with_common("100", side, fields,
                   {order,
                    {"amplitude_mm", OptionKind::kNumber, "10", "A, mm", {}, 1e-300, 1e150},
                    {"wavelength_mm", OptionKind::kNumber, "50", "L, mm", {}, 1e-300, 1e150}})},
      {"plane", "z = 0; scanner order", with_common("100", side, fields, {order})},
      {"saddle", "z = c/2 (x^2 - y^2); scanner order",
       with_common("100", side, fields,
                   {order, {"curvature_per_mm", OptionKind::kNumber, "0.02", "c, 1/mm", {}, 1e-150, 1e150}})},
      {"relief", "32 waves of all lengths, equally steep: a detailed height field; scanner order",
       with_common("100", side, fields,
                   {order,
                    {"aspect", OptionKind::kNumber, "1", "side along y in sides along x", {}, 1e-3, 1e3},
                    {"finest_mm", OptionKind::kNumber, "1", "shortest wave, mm", {}, 1e-300, 1e150},
                    {"slope", OptionKind::kNumber, "0.3", "root mean square of the slope", {}, 1e-6, 1}})},
      {"wedge", "two planes that meet along the y axis; scanner order",
       with_common("100", side, fields,
                   {order,
                    {"angle_deg",
                     OptionKind::kNumber,
                     "90",
                     "angle of the material: below 180 a ridge, above a valley",
                     {},
                     10,
                     350}})},
      {"sphere", "centred at the origin; cube faces blown up, layer by layer",
       with_common("50", "diameter, mm", "100000", {})},
      {"pebble", "a sphere with 24 waves of all lengths: a detailed closed surface",
       with_common(
           "50", "mean diameter, mm", "100000",
           {{"finest", OptionKind::kNumber, "0.1", "shortest wave over the mean radius", {}, 1e-3, 1},
            {"slope", OptionKind::kNumber, "0.2", "about the root mean square of the slope", {}, 1e-6, 1}})},
      {"torus", "around the z axis; ring by ring",
       with_common("100", "outer diameter, mm", "100000",
                   {{"order",
                     OptionKind::kChoice,
                     "rings",
                     "turntable: rings are a scanner's rows, and both ways go round",
                     {"rings", "turntable"}},
                    {"tube",
                     OptionKind::kNumber,
                     "0.35",
                     "radius of the tube over that of its middle circle",
                     {},
                     0.01,
                     0.99}})},
      {"slab", "closed flat box centred at the origin; layer by layer",
       with_common("50", side, "100000",
                   {{"thickness_mm", OptionKind::kNumber, "1", "mm", {}, 1e-300, 1e150}})},
      {"ellipsoid", "centred at the origin; the sphere's points, stretched",
       with_common("60", "length along x, mm", "100000", {aspect("y", "0.6"), aspect("z", "0.75")})},
      {"rounded-box", "a closed block with round edges; layer by layer",
       with_common("40", "length along x, mm", "100000",
                   {aspect("y", "0.75"),
                    aspect("z", "0.5"),
                    {"radius_mm", OptionKind::kNumber, "2", "of the edges, mm", {}, 1e-300, 1e150}})},
      {"bowl", "an open part of a sphere, felt from one side; ring by ring",
       with_common("50", "diameter of the sphere, mm", "100000",
                   {{"rim_deg",
                     OptionKind::kNumber,
                     "75",
                     "from the lowest point to the rim; above 90 a ball with a mouth",
                     {},
                     1,
                     179},
                    {"felt", OptionKind::kChoice, "inside", "from which side", {"inside", "outside"}}})},
      {"shells", "a hollow ball: a sphere within a sphere; the outer one, then the inner one",
       with_common("40", "outer diameter, mm", "100000",
                   {{"gap_mm", OptionKind::kNumber, "0.6", "thickness of the wall, mm", {}, 1e-300, 1e150}})},
  };
}

}  // namespace

const std::vector<Generator>& generators() {
  static const std::vector<Generator> kAll = make_generators();
  return kAll;
}

const Generator* find_generator(std::string_view name) {
  for (const Generator& generator : generators())
    if (generator.name == name) return &generator;
  return nullptr;
}

}  // namespace palpate::cloud
