#include "toolkit/cloud/sampling.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "toolkit/cloud/height_field.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"

namespace palpate::cloud {
namespace {

using geometry::AnalyticSurface;

/// Two numbers in [-1, 1) from seed and point only, independent of threads.
struct Shift {
  double u = 0.0, v = 0.0;
};
Shift shift_of(const CommonOptions& common, std::size_t index) {
  if (common.jitter == 0.0) return {};
  Random random(common.seed + kGolden64 * (index + 1));
  const double u = random.uniform(-1.0, 1.0);
  return {common.jitter * u, common.jitter * random.uniform(-1.0, 1.0)};
}

/// Uneven spacing: moves the share s in [0, 1] of a side so that the spacing varies from 1 - a to 1 + a times
/// the even one; the ends stay.
double warped(double s, double a) {
  return a == 0.0 ? s : s + a / (2.0 * std::numbers::pi) * std::sin(2.0 * std::numbers::pi * s);
}

std::uint32_t whole(double x, double least) {
  return static_cast<std::uint32_t>(std::max(least, std::round(x)));
}

/// Grid rows over a height field in scanner order, `aspect` times as long in y as in x.
Samples sample_height_field(const std::shared_ptr<const AnalyticSurface>& surface,
                            const CommonOptions& common, double aspect = 1.0) {
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
    // Border points move along the border only, so the extent stays.
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
                     const CommonOptions& common) {
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

/// Lattice coordinates as shares in [-1, 1], shifted along their faces.
Vec3 lattice_share(const BoxLattice& lattice, const std::array<std::uint32_t, 3>& cells,
                   const CommonOptions& common, std::size_t i) {
  const auto at = lattice.coordinates(i);
  const Shift shift = shift_of(common, i);
  const double shifts[2] = {shift.u, shift.v};
  Vec3 share;
  int used = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool border = at[axis] == 0 || at[axis] == cells[axis];
    double s = static_cast<double>(at[axis]);
    // A surface point is on the border of some axis, so at most two shifts are used.
    if (!border) s += shifts[used++];
    share[static_cast<int>(axis)] =
        2.0 * warped(s / static_cast<double>(cells[axis]), common.nonuniform) - 1.0;
  }
  return share;
}

/// The direction of a place on the cube [-1, 1]^3, with equal angles between a face's lines.
Vec3 on_unit_sphere(const Vec3& share) {
  const auto angle = [](double s) { return std::tan(0.25 * std::numbers::pi * s); };
  return Vec3(angle(share.x()), angle(share.y()), angle(share.z())).normalized();
}

/// Six cube faces projected to the sphere with equal angles between lines: spacing varies by 1.4.
Samples sample_sphere(double radius, const CommonOptions& common) {
  // 6 n^2 + 2 points; a face spans a quarter turn.
  const std::uint32_t n = common.spacing_mm > 0.0
                              ? whole(0.5 * std::numbers::pi * radius / common.spacing_mm, 1.0)
                              : whole(std::sqrt(std::max(1.0, (common.points - 2.0) / 6.0)), 1.0);
  const BoxLattice lattice(n, n, n);
  Samples samples;
  samples.count = lattice.size();
  samples.spacing_mm = 0.5 * std::numbers::pi * radius / n;
  samples.point = [=](std::size_t i) {
    return Vec3(radius * on_unit_sphere(lattice_share(lattice, {n, n, n}, common, i)));
  };
  samples.triangles = [lattice] { return lattice.triangles(); };
  return samples;
}

Samples sample_slab(double thickness, const CommonOptions& common) {
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

/// A box lattice with `half_ways`, half the arc length from face to opposite face.
Samples sample_rounded_box(const std::shared_ptr<const AnalyticSurface>& surface, const Vec3& half_ways,
                           const CommonOptions& common) {
  const Vec3 ways = 2.0 * half_ways;
  const double area = 2.0 * (ways.x() * ways.y() + ways.y() * ways.z() + ways.z() * ways.x());
  const double spacing = common.spacing_mm > 0.0 ? common.spacing_mm : std::sqrt(area / common.points);
  std::array<std::uint32_t, 3> cells{};
  for (int i = 0; i < 3; ++i) cells[static_cast<std::size_t>(i)] = whole(ways[i] / spacing, 1.0);
  const BoxLattice lattice(cells[0], cells[1], cells[2]);
  Samples samples;
  samples.count = lattice.size();
  samples.spacing_mm = ways.x() / cells[0];
  samples.point = [=](std::size_t i) {
    return geometry::rounded_box_point(*surface, lattice_share(lattice, cells, common, i));
  };
  samples.triangles = [lattice] { return lattice.triangles(); };
  return samples;
}

/// The outer sphere, then the inner one on the same lattice, facing the other way.
Samples sample_shells(double radius, double gap, const CommonOptions& common) {
  CommonOptions half = common;
  half.points = 0.5 * common.points;
  const Samples one = sample_sphere(radius, half);
  Samples samples;
  samples.count = 2 * one.count;
  samples.spacing_mm = one.spacing_mm;
  samples.point = [one, inward = (radius - gap) / radius](std::size_t i) {
    return i < one.count ? one.point(i) : Vec3(inward * one.point(i - one.count));
  };
  samples.triangles = [one] {
    Triangles found = one.triangles();
    const std::size_t outer = found.size();
    const auto shift = static_cast<std::uint32_t>(one.count);
    found.reserve(2 * outer);
    for (std::size_t i = 0; i < outer; ++i)
      found.push_back({found[i][0] + shift, found[i][2] + shift, found[i][1] + shift});
    return found;
  };
  return samples;
}

/// Rings about the axis, evenly spaced from the lowest point to the rim.
Samples sample_bowl(double radius, double rim, geometry::Felt felt, const CommonOptions& common) {
  // The area 2 pi r^2 (1 - cos rim), over the points.
  const double spacing =
      common.spacing_mm > 0.0
          ? common.spacing_mm
          : radius * std::sqrt(2.0 * std::numbers::pi * (1.0 - std::cos(rim)) / common.points);
  const SphereRings rings(radius, rim, spacing);
  Samples samples;
  samples.count = rings.size();
  samples.spacing_mm = spacing;
  samples.point = [rings, common, radius, rim](std::size_t i) {
    const SphereRings::Place at = rings.place(i);
    Shift shift = shift_of(common, i);
    const bool border = at.ring == 0 || at.ring == rings.rings();
    if (border) shift.v = 0.0;
    if (at.ring == 0) shift.u = 0.0;
    const double turn = 2.0 * std::numbers::pi * (at.spoke + shift.u) / at.spokes;
    const double angle =
        rim * warped((static_cast<double>(at.ring) + shift.v) / rings.rings(), common.nonuniform);
    const double side = std::sin(angle);
    return Vec3(radius * Vec3(side * std::cos(turn), side * std::sin(turn), -std::cos(angle)));
  };
  samples.triangles = [rings, felt] {
    Triangles found = rings.triangles();
    if (felt == geometry::Felt::kOutside)
      for (auto& t : found) std::swap(t[1], t[2]);
    return found;
  };
  return samples;
}

/// The six faces of the cube [-1, 1]^3, mapped to a surface by `place`.
void add_cube_faces(std::vector<Patch>& patches, const std::function<Vec3(const Vec3&)>& place,
                    int sheet = 0) {
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0})
      patches.push_back({[=](double u, double v) {
                           Vec3 share;
                           share[axis] = side;
                           share[(axis + 1) % 3] = 2.0 * u - 1.0;
                           share[(axis + 2) % 3] = 2.0 * v - 1.0;
                           return place(share);
                         },
                         sheet});
}

Shape round_shape(std::shared_ptr<const AnalyticSurface> surface, const Samples& sphere,
                  const std::function<Vec3(const Vec3&)>& on_surface) {
  Shape shape;
  shape.surface = std::move(surface);
  if (!shape.surface) return shape;
  shape.grid = sphere;
  shape.grid.point = [on_sphere = sphere.point, on_surface](std::size_t i) {
    return on_surface(on_sphere(i));
  };
  add_cube_faces(shape.patches,
                 [on_surface](const Vec3& share) { return on_surface(on_unit_sphere(share)); });
  return shape;
}

Shape height_field_shape(std::shared_ptr<const AnalyticSurface> surface, const CommonOptions& common,
                         double aspect = 1.0) {
  Shape shape;
  shape.surface = std::move(surface);
  if (!shape.surface) return shape;
  shape.grid = sample_height_field(shape.surface, common, aspect);
  shape.patches.push_back({[s = shape.surface](double u, double v) { return s->at(u, v).point_mm; }});
  shape.is_height_field = true;
  return shape;
}

Shape pebble_shape(const Options& options, const CommonOptions& common) {
  const double radius = 0.5 * common.extent_mm;
  const auto surface =
      geometry::make_pebble(radius, options.number("finest") * radius, options.number("slope"), common.seed);
  return round_shape(surface, sample_sphere(radius, common),
                     [surface](const Vec3& p) { return geometry::pebble_point(*surface, p); });
}

Shape sphere_shape(const CommonOptions& common) {
  const double radius = 0.5 * common.extent_mm;
  Shape shape;
  shape.surface = geometry::make_sphere(radius);
  if (!shape.surface) return shape;
  shape.grid = sample_sphere(radius, common);
  add_cube_faces(shape.patches, [radius](const Vec3& share) { return Vec3(radius * on_unit_sphere(share)); });
  return shape;
}

/// Lengths per axis; x is the extent.
Vec3 lengths_of(const Options& options, const CommonOptions& common) {
  return common.extent_mm * Vec3(1.0, options.number("aspect_y"), options.number("aspect_z"));
}

Shape ellipsoid_shape(const Options& options, const CommonOptions& common) {
  const Vec3 axes = 0.5 * lengths_of(options, common);
  // Uses the lattice of a sphere of similar area (Thomsen's formula, to 1.1 %).
  constexpr double kPower = 1.6075;
  const auto term = [&](int i, int j) {
    return std::pow(axes[i] / axes[0] * axes[j] / axes[0], kPower) / 3.0;
  };
  const double radius = axes[0] * std::pow(term(0, 1) + term(1, 2) + term(2, 0), 0.5 / kPower);
  return round_shape(geometry::make_ellipsoid(axes), sample_sphere(radius, common),
                     [axes](const Vec3& p) { return Vec3(p.normalized().cwiseProduct(axes)); });
}

Shape rounded_box_shape(const Options& options, const CommonOptions& common) {
  const Vec3 lengths = lengths_of(options, common);
  const double radius = options.number("radius_mm") * common.scale;
  Shape shape;
  shape.surface = geometry::make_rounded_box(lengths, radius);
  if (!shape.surface) return shape;
  shape.grid = sample_rounded_box(shape.surface, geometry::rounded_box_half_arcs(lengths, radius), common);
  add_cube_faces(shape.patches,
                 [s = shape.surface](const Vec3& share) { return geometry::rounded_box_point(*s, share); });
  return shape;
}

Shape bowl_shape(const Options& options, const CommonOptions& common) {
  const double radius = 0.5 * common.extent_mm, rim_deg = options.number("rim_deg");
  const double rim = rim_deg * std::numbers::pi / 180.0;
  const geometry::Felt felt =
      options.text("felt") == "inside" ? geometry::Felt::kInside : geometry::Felt::kOutside;
  Shape shape;
  shape.surface = geometry::make_bowl(radius, rim_deg, felt);
  if (!shape.surface) return shape;
  shape.grid = sample_bowl(radius, rim, felt, common);
  shape.patches.push_back({[radius, rim](double u, double v) {
    const double turn = 2.0 * std::numbers::pi * u, side = std::sin(rim * v);
    return Vec3(radius * Vec3(side * std::cos(turn), side * std::sin(turn), -std::cos(rim * v)));
  }});
  return shape;
}

Shape shells_shape(const Options& options, const CommonOptions& common) {
  const double radius = 0.5 * common.extent_mm, gap = options.number("gap_mm") * common.scale;
  Shape shape;
  shape.surface = geometry::make_shells(radius, gap);
  if (!shape.surface) return shape;
  shape.grid = sample_shells(radius, gap, common);
  int sheet = 0;
  for (const double r : {radius, radius - gap})
    add_cube_faces(
        shape.patches, [r](const Vec3& share) { return Vec3(r * on_unit_sphere(share)); }, sheet++);
  return shape;
}

Shape torus_shape(const Options& options, const CommonOptions& common) {
  const double major = 0.5 * common.extent_mm / (1.0 + options.number("tube"));
  const double minor = major * options.number("tube");
  Shape shape;
  shape.surface = geometry::make_torus(major, minor);
  if (!shape.surface) return shape;
  shape.grid = sample_torus(shape.surface, major, minor, common);
  shape.patches.push_back({[s = shape.surface](double u, double v) { return s->at(u, v).point_mm; }});
  return shape;
}

Shape slab_shape(const Options& options, const CommonOptions& common) {
  const double thickness = options.number("thickness_mm") * common.scale;
  const Vec3 half = 0.5 * Vec3(common.extent_mm, common.extent_mm, thickness);
  Shape shape;
  shape.surface = geometry::make_slab(common.extent_mm, thickness);
  if (!shape.surface) return shape;
  shape.grid = sample_slab(thickness, common);
  add_cube_faces(shape.patches, [half](const Vec3& share) { return Vec3(share.cwiseProduct(half)); });
  return shape;
}

}  // namespace

Shape shape_of(const std::string& name, const Options& options, const CommonOptions& common) {
  if (name == "pebble") return pebble_shape(options, common);
  if (name == "sphere") return sphere_shape(common);
  if (name == "torus") return torus_shape(options, common);
  if (name == "slab") return slab_shape(options, common);
  if (name == "ellipsoid") return ellipsoid_shape(options, common);
  if (name == "rounded-box") return rounded_box_shape(options, common);
  if (name == "bowl") return bowl_shape(options, common);
  if (name == "shells") return shells_shape(options, common);
  if (name == "relief") {
    const double aspect = options.number("aspect");
    return height_field_shape(geometry::make_relief(common.extent_mm, aspect * common.extent_mm,
                                                    options.number("finest_mm") * common.scale,
                                                    options.number("slope"), common.seed),
                              common, aspect);
  }
  if (name == "wedge")
    return height_field_shape(geometry::make_wedge(options.number("angle_deg"), common.extent_mm), common);
  if (name == "saddle")
    return height_field_shape(
        geometry::make_saddle(options.number("curvature_per_mm") / common.scale, common.extent_mm), common);
  if (name == "sinusoid")
    return height_field_shape(
        geometry::make_sinusoid(options.number("amplitude_mm") * common.scale,
                                options.number("wavelength_mm") * common.scale, common.extent_mm),
        common);
  return height_field_shape(geometry::make_plane(common.extent_mm), common);
}

}  // namespace palpate::cloud
