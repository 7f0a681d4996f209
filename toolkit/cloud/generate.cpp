#include <palpate/generate.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/cloud/sampling.h"
#include "toolkit/cloud/scanner.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"

namespace palpate::cloud {
namespace {

OptionSpec aspect(const std::string& axis, std::string value) {
  return option::number("aspect_" + axis, std::move(value), "length along " + axis + " over that along x",
                        1e-3, 1e3);
}

/// Options of sampling, and of the changes after it.
std::vector<OptionSpec> sampling_options() {
  std::vector<OptionSpec> specs = {
      option::choice(
          "sampling", "grid",
          "random: even by area; blue: the same with a least distance; lines: scan lines; scan: a scanner's "
          "rays",
          {"grid", "random", "blue", "lines", "scan"}),
      option::number("ratio", "8", "distance of the lines over that of the points along them", 1, 1e3,
                     {{"sampling", {"lines"}}}),
      option::number("density", "1", "points per area for x above the middle over those below", 1, 1e4,
                     {{"sampling", {"random", "blue"}}}),
      option::number(
          "noise", "0",
          "normal, along the surface's normal, of a scan along the ray: standard deviation in spacings", 0,
          100),
      option::number("outliers", "0", "share of the points that lie off the surface", 0, 0.9),
      option::choice("outliers_at", "near", "near: 2 to 10 spacings off; box: anywhere in the model's box",
                     {"near", "box"}, {{"outliers"}}),
      option::flag("shuffle", "false", "points in a random order"),
  };
  for (OptionSpec& spec : scanner_specs({{"sampling", {"scan"}}})) specs.push_back(std::move(spec));
  return specs;
}

std::vector<OptionSpec> with_common(std::string extent, std::string extent_help, std::string points,
                                    std::vector<OptionSpec> own) {
  std::vector<OptionSpec> specs = {
      option::integer("points", std::move(points), "number of points, the nearest the grid can give", 4,
                      kMaxGeneratedPoints),
      option::number("spacing_mm", "0", "distance of neighbours instead of points; 0 = from points", 0,
                     1e300),
      option::number("extent_mm", std::move(extent), std::move(extent_help), 1e-300, 1e150),
      option::number("jitter", "0", "largest shift along the surface, fraction of the spacing", 0, 0.45),
      option::number("nonuniform", "0", "a: the spacing varies from 1 - a to 1 + a times the even one", 0,
                     0.9),
      option::integer("seed", "1", "of what is by chance, and of the shape of relief and pebble", 0, 1e18),
      option::number("scale", "1", "multiplies every length", 1e-150, 1e150),
      option::flag("mesh", "true", "also make the regular triangulation")};
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
  const OptionSpec order = option::choice(
      "order", "raster", "of points: every row from its start, or to and fro", {"raster", "boustrophedon"});
  return {
      {"sinusoid", "z = A (cos(2 pi x / L) + cos(2 pi y / L)), table 7 of the thesis; scanner order",
       with_common("100", side, fields,
                   {order, option::number("amplitude_mm", "10", "A, mm", 1e-300, 1e150),
                    option::number("wavelength_mm", "50", "L, mm", 1e-300, 1e150)})},
      {"plane", "z = 0; scanner order", with_common("100", side, fields, {order})},
      {"saddle", "z = c/2 (x^2 - y^2); scanner order",
       with_common("100", side, fields,
                   {order, option::number("curvature_per_mm", "0.02", "c, 1/mm", 1e-150, 1e150)})},
      {"relief", "32 waves of all lengths, equally steep: a detailed height field; scanner order",
       with_common("100", side, fields,
                   {order, option::number("aspect", "1", "side along y in sides along x", 1e-3, 1e3),
                    option::number("finest_mm", "1", "shortest wave, mm", 1e-300, 1e150),
                    option::number("slope", "0.3", "root mean square of the slope", 1e-6, 1)})},
      {"wedge", "two planes that meet along the y axis; scanner order",
       with_common(
           "100", side, fields,
           {order, option::number("angle_deg", "90",
                                  "angle of the material: below 180 a ridge, above a valley", 10, 350)})},
      {"sphere", "centred at the origin; cube faces blown up, layer by layer",
       with_common("50", "diameter, mm", "100000", {})},
      {"pebble", "a sphere with 24 waves of all lengths: a detailed closed surface",
       with_common("50", "mean diameter, mm", "100000",
                   {option::number("finest", "0.1", "shortest wave over the mean radius", 1e-3, 1),
                    option::number("slope", "0.2", "about the root mean square of the slope", 1e-6, 1)})},
      {"torus", "around the z axis; ring by ring",
       with_common(
           "100", "outer diameter, mm", "100000",
           {option::choice("order", "rings", "turntable: rings are a scanner's rows, and both ways go round",
                           {"rings", "turntable"}),
            option::number("tube", "0.35", "radius of the tube over that of its middle circle", 0.01,
                           0.99)})},
      {"slab", "closed flat box centred at the origin; layer by layer",
       with_common("50", side, "100000", {option::number("thickness_mm", "1", "mm", 1e-300, 1e150)})},
      {"ellipsoid", "centred at the origin; the sphere's points, stretched",
       with_common("60", "length along x, mm", "100000", {aspect("y", "0.6"), aspect("z", "0.75")})},
      {"rounded-box", "a closed block with round edges; layer by layer",
       with_common("40", "length along x, mm", "100000",
                   {aspect("y", "0.75"), aspect("z", "0.5"),
                    option::number("radius_mm", "2", "of the edges, mm", 1e-300, 1e150)})},
      {"bowl", "an open part of a sphere, felt from one side; ring by ring",
       with_common("50", "diameter of the sphere, mm", "100000",
                   {option::number("rim_deg", "75",
                                   "from the lowest point to the rim; above 90 a ball with a mouth", 1, 179),
                    option::choice("felt", "inside", "from which side", {"inside", "outside"})})},
      {"shells", "a hollow ball: a sphere within a sphere; the outer one, then the inner one",
       with_common("40", "outer diameter, mm", "100000",
                   {option::number("gap_mm", "0.6", "thickness of the wall, mm", 1e-300, 1e150)})},
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

namespace {

using geometry::TriangleMesh;

// Up to this jitter a cell's triangles keep their orientation: shifted legs are at least 1 - 2j long and at
// most 2j askew, and (1 - 2j)^2 > (2j)^2 for j < 1/4.
constexpr double kMeshJitter = 0.25;
// Rounding of a ray's end, as a share of the box: a thousand roundings of a coordinate.
constexpr double kRayRounding = 1024.0 * kUnitRoundoff;
// Points per task; does not affect the result.
constexpr std::size_t kGrain = 1 << 14;
// Sampling options; a model's name lists those that differ from the default.
constexpr const char* kSamplingKeys[] = {"sampling", "ratio",       "density", "noise",
                                         "outliers", "outliers_at", "shuffle", "views",
                                         "bias",     "dropout",     "flying",  "registration"};

void fill(const Samples& samples, const geometry::Aabb& box, bool with_mesh, GeneratedModel& model) {
  Cloud& cloud = model.cloud;
  cloud.origin_mm = box.centre_mm();
  cloud.x_mm.resize(samples.count);
  cloud.y_mm.resize(samples.count);
  cloud.z_mm.resize(samples.count);
  cloud.raster = samples.raster;
  if (with_mesh) {
    model.original_mesh = std::make_shared<TriangleMesh>();
    model.original_mesh->vertices_mm.resize(samples.count);
  }
  parallel_each(samples.count, kGrain, 0, [&](std::size_t i) {
    const Vec3 p = samples.point(i);
    const Vec3 local = p - cloud.origin_mm;
    cloud.x_mm[i] = static_cast<float>(local.x());
    cloud.y_mm[i] = static_cast<float>(local.y());
    cloud.z_mm[i] = static_cast<float>(local.z());
    if (with_mesh) model.original_mesh->vertices_mm[i] = p;
  });
  if (with_mesh) model.original_mesh->triangles = samples.triangles();
}

/// Points of the formula inside its box that a scanner sees, range noise included.
Result<Scanned> scanned(const Shape& shape, const Options& options, const CommonOptions& common) {
  ScannerOptions scanner = read_scanner(options);
  scanner.points = count_patches(shape.patches, common);
  scanner.seed = common.seed;
  const geometry::Aabb box = shape.surface->box_mm();
  // A ray's end is off the formula by its rounding.
  const geometry::Aabb reach = box.grown(kRayRounding * box.extent_mm().maxCoeff());
  const FirstHit first = [&](const Vec3& a, const Vec3& b) -> std::optional<geometry::SurfacePoint> {
    std::optional<geometry::SurfacePoint> hit = shape.surface->first_entry(a, b);
    if (hit && !reach.contains(hit->point_mm)) hit.reset();
    return hit;
  };
  return scan(first, box, shape.is_height_field, scanner);
}

/// Fills the points of `samples` or of the patches, with noise and order, and the mesh if there is one.
Status fill_sampled(const Shape& shape, SamplingOptions how, const Options& options,
                    const CommonOptions& common, bool with_mesh, GeneratedModel& model) {
  const geometry::Aabb box = shape.surface->box_mm();
  std::vector<Vec3> points;
  model.nominal_spacing_mm = shape.grid.spacing_mm;
  if (how.way == Sampling::kGrid) {
    points.resize(shape.grid.count);
    parallel_each(points.size(), kGrain, 0, [&](std::size_t i) { points[i] = shape.grid.point(i); });
  } else if (how.way == Sampling::kScan) {
    PALPATE_ASSIGN(Scanned seen, scanned(shape, options, common));
    points = std::move(seen.points_mm);
    model.nominal_spacing_mm = seen.spacing_mm;
    how.noise = 0.0;
  } else {
    Sampled sampled = sample_patches(shape.patches, box, how, common);
    points = std::move(sampled.points_mm);
    model.nominal_spacing_mm = sampled.spacing_mm;
  }
  add_noise_and_outliers(shape, model.nominal_spacing_mm, how, common.seed, points);
  Samples samples = shape.grid;
  samples.count = points.size();
  if (how.way != Sampling::kGrid || how.shuffle) samples.raster.reset();
  if (!how.shuffle) {
    samples.point = [&](std::size_t i) { return points[i]; };
    fill(samples, box, with_mesh, model);
    return Done{};
  }
  const std::vector<std::uint32_t> from = random_permutation(points.size(), common.seed);
  samples.point = [&](std::size_t i) { return points[from[i]]; };
  samples.triangles = [&] {
    std::vector<std::uint32_t> to(from.size());
    for (std::size_t i = 0; i < from.size(); ++i) to[from[i]] = static_cast<std::uint32_t>(i);
    Triangles found = shape.grid.triangles();
    for (auto& triangle : found)
      for (std::uint32_t& corner : triangle) corner = to[corner];
    return found;
  };
  fill(samples, box, with_mesh, model);
  return Done{};
}

std::string spelled(const std::string& name, const Options& options) {
  std::string text = name;
  const Generator* generator = find_generator(name);
  for (const auto& [key, value] : options.all()) {
    const bool usual = std::any_of(
        generator->options.begin(), generator->options.end(),
        [&, k = key, v = value](const OptionSpec& spec) { return spec.key == k && spec.default_value == v; });
    const bool of_sampling =
        std::find(std::begin(kSamplingKeys), std::end(kSamplingKeys), key) != std::end(kSamplingKeys);
    if (!(of_sampling && usual)) text += fmt::format(":{}={}", key, value);
  }
  return text;
}

CommonOptions read_common(const Options& options, bool by_spacing) {
  CommonOptions common;
  common.scale = options.number("scale");
  common.points = options.number("points");
  common.spacing_mm = by_spacing ? options.number("spacing_mm") * common.scale : 0.0;
  common.extent_mm = options.number("extent_mm") * common.scale;
  common.jitter = options.number("jitter");
  common.nonuniform = options.number("nonuniform");
  common.seed = static_cast<std::uint64_t>(options.integer("seed"));
  common.mesh = options.flag("mesh");
  if (options.has("order")) common.order = options.text("order");
  return common;
}

SamplingOptions read_sampling(const Options& options) {
  SamplingOptions how;
  const std::string& way = options.text("sampling");
  how.way = way == "random"  ? Sampling::kRandom
            : way == "blue"  ? Sampling::kBlue
            : way == "lines" ? Sampling::kLines
            : way == "scan"  ? Sampling::kScan
                             : Sampling::kGrid;
  how.ratio = options.number("ratio");
  how.density = options.number("density");
  how.noise = options.number("noise");
  how.outliers = options.number("outliers");
  how.outliers_near = options.text("outliers_at") == "near";
  how.shuffle = options.flag("shuffle");
  return how;
}

/// True if points are placed randomly, so the seed matters.
bool has_chance(const std::string& name, const Options& options) {
  return options.number("jitter") != 0.0 || options.text("sampling") != "grid" ||
         options.number("noise") != 0.0 || options.number("outliers") != 0.0 || options.flag("shuffle") ||
         name == "relief" || name == "pebble";
}

Error no_mesh_with(const std::string& name, const std::string& what, const std::string& advice) {
  return {fmt::format("{}: no mesh can be made with {}", name, what), advice, {}, 0};
}

/// Errors of meshes that the options rule out.
Status check_mesh(const NamedOptions& spec, const CommonOptions& common, const SamplingOptions& how) {
  if (!spec.options.has("mesh") || !common.mesh) return Done{};
  if (common.jitter >= kMeshJitter)
    return no_mesh_with(spec.name, fmt::format("jitter={}, whose triangles could turn over", common.jitter),
                        fmt::format("leave out mesh, or take a jitter below {}", kMeshJitter));
  if (!how.in_place())
    return no_mesh_with(spec.name, "points off the grid", "leave out mesh, or sampling, noise and outliers");
  return Done{};
}

/// Errors beyond the options' own bounds and the shape's.
Status check_sizes(const NamedOptions& spec, const Options& options, const CommonOptions& common) {
  if (common.spacing_mm > 0.0 && common.extent_mm / common.spacing_mm > std::sqrt(kMaxGeneratedPoints))
    return Error{fmt::format("{}: a spacing of {} mm over {} mm makes too many points", spec.name,
                             common.spacing_mm, common.extent_mm),
                 fmt::format("at most {} points a model", kMaxGeneratedPoints)};
  if (spec.name == "slab" && options.number("thickness_mm") > options.number("extent_mm"))
    return Error{"slab: thickness_mm is more than extent_mm", "give a thickness of at most the extent"};
  return Done{};
}

}  // namespace

Result<Options> complete_options(const Generator& generator, const Options& given) {
  PALPATE_ASSIGN(Options complete, validate(given, generator.options, generator.name));
  if (given.has("seed") && complete.integer("seed") != 1 && !has_chance(generator.name, complete))
    return Error{fmt::format("{}: option seed={} does nothing with jitter={} and all points in place",
                             generator.name, given.text("seed"), complete.text("jitter")),
                 "leave it out, or set jitter, sampling, noise, outliers or shuffle"};
  return complete;
}

Result<GeneratedModel> generate(const NamedOptions& spec) {
  const Generator* generator = find_generator(spec.name);
  if (generator == nullptr)
    return Error{fmt::format("there is no generator '{}'", spec.name),
                 "choose from " + joined(names_of(generators()))};
  PALPATE_ASSIGN(Options complete, complete_options(*generator, spec.options));
  const Options& options = complete;
  const bool by_spacing = options.number("spacing_mm") > 0.0;
  if (by_spacing && spec.options.has("points"))
    return Error{fmt::format("{}: points and spacing_mm both given", spec.name), "keep one of them"};
  const CommonOptions common = read_common(options, by_spacing);
  const SamplingOptions how = read_sampling(options);
  PALPATE_TRY(check_mesh(spec, common, how));
  PALPATE_TRY(check_sizes(spec, options, common));
  GeneratedModel model;
  const Shape shape = shape_of(spec.name, options, common);
  model.surface = shape.surface;
  if (!model.surface)
    return Error{fmt::format("{} makes no surface of this kind", spelled(spec.name, options)),
                 "a sinusoid's slope 2 pi A / L may be at most 8, a relief's finest wave must be below its "
                 "side, edges "
                 "and gaps of bodies must fit into them"};
  const double count = how.way == Sampling::kGrid ? static_cast<double>(shape.grid.count)
                                                  : count_patches(shape.patches, common);
  if (count > kMaxGeneratedPoints)
    return Error{fmt::format("{} makes {:.0f} points", spec.name, count),
                 fmt::format("at most {} points a model", kMaxGeneratedPoints)};
  const geometry::Aabb box = model.surface->box_mm();
  // Larger floats relative to the middle would overflow; smaller spacings would vanish.
  constexpr double kLargest = 1e30, kSmallest = 1e-30;
  if (!(box.extent_mm().maxCoeff() < kLargest) || !(shape.grid.spacing_mm > kSmallest))
    return Error{fmt::format("{} does not fit in single precision", spelled(spec.name, options)),
                 "choose a scale between 1e-30 and 1e30 mm"};
  // The name says what there is, so that it can be given again.
  if (!how.in_place() || !(common.jitter < kMeshJitter)) complete.set("mesh", "false");
  model.spec = spelled(spec.name, options);
  const bool with_mesh = common.mesh && common.jitter < kMeshJitter && how.in_place();
  if (how.in_place() && !how.shuffle) {
    model.nominal_spacing_mm = shape.grid.spacing_mm;
    fill(shape.grid, box, with_mesh, model);
  } else {
    PALPATE_TRY(fill_sampled(shape, how, options, common, with_mesh, model));
  }
  return model;
}

}  // namespace palpate::cloud
