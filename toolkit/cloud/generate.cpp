#include "toolkit/cloud/generate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "toolkit/cloud/lattice.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::cloud {
namespace {

using geometry::AnalyticSurface;
using geometry::TriangleMesh;
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

// Indices of a mesh are 32 bits, and a hundred million points with their mesh fill a desktop's memory.
constexpr double kMostPoints = 1e8;
// Up to here a cell's triangles keep their orientation: the shifted legs of a cell are at least 1 - 2j long
// and at most 2j askew, and (1 - 2j)^2 > (2j)^2 for j < 1/4.
constexpr double kMeshJitter = 0.25;
// Points made by one task; the result does not depend on it.
constexpr std::size_t kGrain = 1 << 14;

/// What every generator takes, lengths already scaled.
struct Common {
  double points = 0.0;
  double spacing_mm = 0.0;  ///< 0 = from points
  double extent_mm = 0.0;
  double jitter = 0.0;
  double nonuniform = 0.0;
  std::uint64_t seed = 0;
  double scale = 1.0;
  bool mesh = true;
  std::string order;  ///< of points, where there is a choice
};

/// Points by index, in mm; triangles as an afterthought.
struct Samples {
  std::size_t count = 0;
  std::function<Vec3(std::size_t)> point;
  std::function<Triangles()> triangles;
  std::optional<ScanRaster> raster;
  double spacing_mm = 0.0;
};

/// Two numbers in [-1, 1) that depend on the seed and the point alone, so that threads do not matter.
struct Shift {
  double u = 0.0, v = 0.0;
};
Shift shift_of(const Common& common, std::size_t index) {
  if (common.jitter == 0.0) return {};
  Random random(common.seed + kGolden64 * (index + 1));
  const double u = random.uniform(-1.0, 1.0);
  return {common.jitter * u, common.jitter * random.uniform(-1.0, 1.0)};
}

/// Uneven spacing: the share s in [0, 1] of a side, moved so that the spacing varies from 1 - a to 1 + a
/// times the even one; the ends stay.
double warped(double s, double a) {
  return a == 0.0 ? s : s + a / (2.0 * std::numbers::pi) * std::sin(2.0 * std::numbers::pi * s);
}

std::uint32_t whole(double x, double least) {
  return static_cast<std::uint32_t>(std::max(least, std::round(x)));
}

/// Rows of a grid over a height field, `aspect` times as long in y as in x, scanner order.
Samples sample_height_field(const std::shared_ptr<const AnalyticSurface>& surface, const Common& common,
                            double aspect = 1.0) {
  const bool by_spacing = common.spacing_mm > 0.0;
  const std::uint32_t side = by_spacing ? whole(common.extent_mm / common.spacing_mm, 1.0) + 1
                                        : whole(std::sqrt(common.points / aspect), 2.0);
  const std::size_t columns = side;
  const double cells = static_cast<double>(side - 1);
  const std::uint32_t rows = aspect == 1.0 ? side : whole(aspect * cells, 1.0) + 1;
  const double cells_y = static_cast<double>(rows - 1);
  Samples samples;
  samples.count = columns * rows;
  ScanRaster raster{side, rows};
  if (common.order == "boustrophedon") raster.order = ScanOrder::kBoustrophedon;
  samples.raster = raster;
  samples.spacing_mm = common.extent_mm / cells;
  samples.point = [=](std::size_t i) {
    const std::size_t column = raster.column(i), row = i / columns;
    Shift shift = shift_of(common, row * columns + column);
    // Border points move along the border only, so that the extent stays.
    if (column == 0 || column + 1 == columns) shift.u = 0.0;
    if (row == 0 || row + 1 == rows) shift.v = 0.0;
    const double u = warped((static_cast<double>(column) + shift.u) / cells, common.nonuniform);
    const double v = warped((static_cast<double>(row) + shift.v) / cells_y, common.nonuniform);
    return surface->at(u, v).point_mm;
  };
  samples.triangles = [=] {
    Triangles found;
    found.reserve(2 * (columns - 1) * (rows - 1));
    for (std::uint32_t row = 0; row + 1 < rows; ++row)
      for (std::uint32_t column = 0; column + 1 < side; ++column) {
        const auto at = [&](std::uint32_t r, std::uint32_t c) {
          return static_cast<std::uint32_t>(raster.index(r, c));
        };
        const std::uint32_t p00 = at(row, column), p10 = at(row, column + 1);
        const std::uint32_t p01 = at(row + 1, column), p11 = at(row + 1, column + 1);
        found.push_back({p00, p10, p11});
        found.push_back({p00, p11, p01});
      }
    return found;
  };
  return samples;
}

Samples sample_torus(const std::shared_ptr<const AnalyticSurface>& surface, double major, double minor,
                     const Common& common) {
  const double around_mm = 2.0 * std::numbers::pi * major, tube_mm = 2.0 * std::numbers::pi * minor;
  const double spacing =
      common.spacing_mm > 0.0 ? common.spacing_mm : std::sqrt(around_mm * tube_mm / common.points);
  const std::uint32_t rings = whole(around_mm / spacing, 3.0), spokes = whole(tube_mm / spacing, 3.0);
  Samples samples;
  samples.count = std::size_t{rings} * spokes;
  if (common.order == "turntable") samples.raster = ScanRaster{spokes, rings, ScanOrder::kRaster, true, true};
  samples.spacing_mm = spacing;
  samples.point = [=](std::size_t i) {
    const Shift shift = shift_of(common, i);
    const double u = (static_cast<double>(i / spokes) + shift.u) / rings;
    const double v = (static_cast<double>(i % spokes) + shift.v) / spokes;
    return surface->at(warped(u, common.nonuniform), warped(v, common.nonuniform)).point_mm;
  };
  samples.triangles = [=] {
    Triangles found;
    found.reserve(2 * std::size_t{rings} * spokes);
    for (std::uint32_t ring = 0; ring < rings; ++ring)
      for (std::uint32_t spoke = 0; spoke < spokes; ++spoke) {
        const std::uint32_t next_ring = (ring + 1) % rings, next_spoke = (spoke + 1) % spokes;
        const std::uint32_t p00 = ring * spokes + spoke, p10 = next_ring * spokes + spoke;
        const std::uint32_t p01 = ring * spokes + next_spoke, p11 = next_ring * spokes + next_spoke;
        found.push_back({p00, p10, p11});
        found.push_back({p00, p11, p01});
      }
    return found;
  };
  return samples;
}

/// Lattice coordinate over cells as a share of the side in [-1, 1], shifted along the faces it lies inside
/// of.
Vec3 lattice_share(const BoxLattice& lattice, const std::array<std::uint32_t, 3>& cells, const Common& common,
                   std::size_t i) {
  const auto at = lattice.coordinates(i);
  const Shift shift = shift_of(common, i);
  const double shifts[2] = {shift.u, shift.v};
  Vec3 share;
  int used = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool border = at[axis] == 0 || at[axis] == cells[axis];
    double s = static_cast<double>(at[axis]);
    // A surface point is on the border of at least one axis, so at most two shifts are used.
    if (!border) s += shifts[used++];
    share[static_cast<int>(axis)] =
        2.0 * warped(s / static_cast<double>(cells[axis]), common.nonuniform) - 1.0;
  }
  return share;
}

/// Six faces of a cube, blown up to the sphere with equal angles between the lines of a face: spacing varies
/// by 1.4.
Samples sample_sphere(double radius, const Common& common) {
  // 6 n^2 + 2 points; a face spans a quarter turn.
  const std::uint32_t n = common.spacing_mm > 0.0
                              ? whole(0.5 * std::numbers::pi * radius / common.spacing_mm, 1.0)
                              : whole(std::sqrt(std::max(1.0, (common.points - 2.0) / 6.0)), 1.0);
  const BoxLattice lattice(n, n, n);
  Samples samples;
  samples.count = lattice.size();
  samples.spacing_mm = 0.5 * std::numbers::pi * radius / n;
  samples.point = [=](std::size_t i) {
    const Vec3 share = lattice_share(lattice, {n, n, n}, common, i);
    const auto angle = [](double s) { return std::tan(0.25 * std::numbers::pi * s); };
    return Vec3(radius * Vec3(angle(share.x()), angle(share.y()), angle(share.z())).normalized());
  };
  samples.triangles = [lattice] { return lattice.triangles(); };
  return samples;
}

Samples sample_slab(double thickness, const Common& common) {
  const double extent = common.extent_mm;
  const double area = 2.0 * extent * extent + 4.0 * extent * thickness;
  const double spacing = common.spacing_mm > 0.0 ? common.spacing_mm : std::sqrt(area / common.points);
  const std::uint32_t across = whole(extent / spacing, 1.0), through = whole(thickness / spacing, 1.0);
  const BoxLattice lattice(across, across, through);
  Samples samples;
  samples.count = lattice.size();
  samples.spacing_mm = extent / across;
  samples.point = [=](std::size_t i) {
    const Vec3 share = lattice_share(lattice, {across, across, through}, common, i);
    return Vec3(0.5 * share.cwiseProduct(Vec3(extent, extent, thickness)));
  };
  samples.triangles = [lattice] { return lattice.triangles(); };
  return samples;
}

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
  parallel_chunks(samples.count, kGrain, 0, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Vec3 p = samples.point(i);
      const Vec3 local = p - cloud.origin_mm;
      cloud.x_mm[i] = static_cast<float>(local.x());
      cloud.y_mm[i] = static_cast<float>(local.y());
      cloud.z_mm[i] = static_cast<float>(local.z());
      if (with_mesh) model.original_mesh->vertices_mm[i] = p;
    }
  });
  if (with_mesh) model.original_mesh->triangles = samples.triangles();
}

/// What the seed is of, beside the jitter: without more it does nothing on points that stay where they are.
enum class Seeds { kJitterAlone, kShapeToo };

std::vector<OptionSpec> with_common(std::string extent, std::string extent_help, std::string points,
                                    std::vector<OptionSpec> own, Seeds seeds = Seeds::kJitterAlone) {
  std::vector<OptionSpec> specs = {
      {"points",
       OptionKind::kInteger,
       std::move(points),
       "number of points, the nearest the grid can give",
       {},
       4,
       kMostPoints},
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
       "of the jitter, and of the shape of relief and pebble",
       {},
       0,
       1e18},
      {"scale", OptionKind::kNumber, "1", "multiplies every length", {}, 1e-150, 1e150},
      {"mesh", OptionKind::kFlag, "true", "also make the regular triangulation", {}, 0, 0}};
  for (OptionSpec& spec : specs)
    if (spec.key == "seed" && seeds == Seeds::kJitterAlone) spec.only_with = {{"jitter"}};
  specs.insert(specs.end(), own.begin(), own.end());
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
                    {"slope", OptionKind::kNumber, "0.3", "root mean square of the slope", {}, 1e-6, 1}},
                   Seeds::kShapeToo)},
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
            {"slope", OptionKind::kNumber, "0.2", "about the root mean square of the slope", {}, 1e-6, 1}},
           Seeds::kShapeToo)},
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
  };
}

std::string spelled(const std::string& name, const Options& options) {
  std::string text = name;
  for (const auto& [key, value] : options.all()) text += fmt::format(":{}={}", key, value);
  return text;
}

Common read_common(const Options& options, bool by_spacing) {
  Common common;
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

/// The surface (null where there is none) and its samples.
Samples sample(const std::string& name, const Options& options, const Common& common,
               std::shared_ptr<const AnalyticSurface>& surface) {
  if (name == "pebble") {
    const double radius = 0.5 * common.extent_mm;
    surface = geometry::make_pebble(radius, options.number("finest") * radius, options.number("slope"),
                                    common.seed);
    if (!surface) return Samples{};
    Samples samples = sample_sphere(radius, common);
    samples.point = [surface, on_sphere = samples.point](std::size_t i) {
      return geometry::on_pebble(*surface, on_sphere(i));
    };
    return samples;
  }
  if (name == "sphere") {
    surface = geometry::make_sphere(0.5 * common.extent_mm);
    return surface ? sample_sphere(0.5 * common.extent_mm, common) : Samples{};
  }
  if (name == "torus") {
    const double major = 0.5 * common.extent_mm / (1.0 + options.number("tube"));
    const double minor = major * options.number("tube");
    surface = geometry::make_torus(major, minor);
    return surface ? sample_torus(surface, major, minor, common) : Samples{};
  }
  if (name == "slab") {
    const double thickness = options.number("thickness_mm") * common.scale;
    surface = geometry::make_slab(common.extent_mm, thickness);
    return surface ? sample_slab(thickness, common) : Samples{};
  }
  if (name == "relief") {
    const double aspect = options.number("aspect");
    surface = geometry::make_relief(common.extent_mm, aspect * common.extent_mm,
                                    options.number("finest_mm") * common.scale, options.number("slope"),
                                    common.seed);
    return surface ? sample_height_field(surface, common, aspect) : Samples{};
  }
  if (name == "wedge") {
    surface = geometry::make_wedge(options.number("angle_deg"), common.extent_mm);
  } else if (name == "saddle") {
    surface = geometry::make_saddle(options.number("curvature_per_mm") / common.scale, common.extent_mm);
  } else if (name == "sinusoid") {
    surface = geometry::make_sinusoid(options.number("amplitude_mm") * common.scale,
                                      options.number("wavelength_mm") * common.scale, common.extent_mm);
  } else {
    surface = geometry::make_plane(common.extent_mm);
  }
  return surface ? sample_height_field(surface, common) : Samples{};
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

Result<GeneratedModel> generate(const NamedOptions& spec) {
  const Generator* generator = find_generator(spec.name);
  if (generator == nullptr)
    return Error{fmt::format("there is no generator '{}'", spec.name),
                 "choose from " + joined(names_of(generators())),
                 {},
                 0};
  PALPATE_ASSIGN(Options complete, validate(spec.options, generator->options, spec.name));
  const Options& options = complete;
  const bool by_spacing = options.number("spacing_mm") > 0.0;
  if (by_spacing && spec.options.has("points"))
    return Error{fmt::format("{}: points and spacing_mm both given", spec.name), "keep one of them", {}, 0};
  const Common common = read_common(options, by_spacing);
  if (spec.options.has("mesh") && common.mesh && common.jitter >= kMeshJitter)
    return Error{fmt::format("{}: no mesh can be made with jitter={}, whose triangles could turn over",
                             spec.name, common.jitter),
                 fmt::format("leave out mesh, or take a jitter below {}", kMeshJitter),
                 {},
                 0};

  if (by_spacing && common.extent_mm / common.spacing_mm > std::sqrt(kMostPoints))
    return Error{fmt::format("{}: a spacing of {} mm over {} mm makes too many points", spec.name,
                             common.spacing_mm, common.extent_mm),
                 fmt::format("at most {} points a model", kMostPoints),
                 {},
                 0};
  if (spec.name == "slab" && options.number("thickness_mm") > options.number("extent_mm"))
    return Error{
        "slab: thickness_mm is more than extent_mm", "give a thickness of at most the extent", {}, 0};
  GeneratedModel model;
  const Samples samples = sample(spec.name, options, common, model.surface);
  if (!model.surface)
    return Error{
        fmt::format("{} makes no surface of this kind", spelled(spec.name, options)),
        "a sinusoid's slope 2 pi A / L may be at most 8, a relief's finest wave must be below its side",
        {},
        0};
  if (static_cast<double>(samples.count) > kMostPoints)
    return Error{fmt::format("{} makes {} points", spec.name, samples.count),
                 fmt::format("at most {} points a model", kMostPoints),
                 {},
                 0};
  const geometry::Aabb box = model.surface->box_mm();
  // Beyond this a float relative to the middle would overflow, below it the spacing would vanish.
  constexpr double kLargest = 1e30, kSmallest = 1e-30;
  if (!(box.extent_mm().maxCoeff() < kLargest) || !(samples.spacing_mm > kSmallest))
    return Error{fmt::format("{} does not fit in single precision", spelled(spec.name, options)),
                 "choose a scale between 1e-30 and 1e30 mm",
                 {},
                 0};
  model.spec = spelled(spec.name, options);
  model.nominal_spacing_mm = samples.spacing_mm;
  fill(samples, box, common.mesh && common.jitter < kMeshJitter, model);
  return model;
}

}  // namespace palpate::cloud
