#include "toolkit/cloud/sampling.h"

#include <fmt/format.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <palpate/result.h>
#include "toolkit/cloud/scanner.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/core/statistics.h"
#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::cloud {

// ---- surfaces of generators

namespace {

/// Cells per side of a patch, whose areas give probabilities. Places are uniform in the parameters within a
/// cell.
constexpr std::size_t kCells = 256;
/// Distance of outliers in spacings: beyond noise, near enough to be taken for the surface.
constexpr double kNearestOutlier = 2.0, kFarthestOutlier = 10.0;
/// Pieces in which a scan line's length is measured.
constexpr int kPieces = 64;

/// Cumulative probabilities of a surface's cells.
class AreaTable {
 public:
  AreaTable(const std::vector<Patch>& patches, const geometry::Aabb& box, double density)
      : patches_(patches), middle_x_(box.centre_mm().x()), density_(density) {
    up_to_.resize(patches.size() * kCells * kCells);
    std::vector<double> area(up_to_.size());
    parallel_each(patches.size() * kCells, 1, 0, [&](std::size_t row) { fill_row(row, area); });
    double sum = 0.0;
    for (std::size_t i = 0; i < area.size(); ++i) {
      area_ += area[i];
      sum += area[i] * up_to_[i];
      up_to_[i] = sum;
    }
  }
  [[nodiscard]] double area_mm2() const { return area_; }
  /// The sum of area x density.
  [[nodiscard]] double weight() const { return up_to_.back(); }
  /// Density at p relative to the largest.
  [[nodiscard]] double density_at(const Vec3& p) const { return p.x() > middle_x_ ? 1.0 : 1.0 / density_; }
  [[nodiscard]] DiskSample pick(Random& random) const {
    const double at = random.uniform() * up_to_.back();
    const auto found = std::upper_bound(up_to_.begin(), up_to_.end() - 1, at);
    const auto cell = static_cast<std::size_t>(found - up_to_.begin());
    const Patch& patch = patches_[cell / (kCells * kCells)];
    const double v = static_cast<double>(cell / kCells % kCells), u = static_cast<double>(cell % kCells);
    const double du = random.uniform(), dv = random.uniform();
    return {patch.point((u + du) / kCells, (v + dv) / kCells), patch.sheet, Vec3::Zero()};
  }

 private:
  /// Areas of a row of cells; their densities go to up_to_.
  void fill_row(std::size_t row, std::vector<double>& area) {
    const Patch& patch = patches_[row / kCells];
    const double v0 = static_cast<double>(row % kCells) / kCells,
                 v1 = static_cast<double>(row % kCells + 1) / kCells;
    Vec3 low = patch.point(0.0, v0), high = patch.point(0.0, v1);
    for (std::size_t i = 0; i < kCells; ++i) {
      const double u = static_cast<double>(i + 1) / kCells;
      const Vec3 next_low = patch.point(u, v0), next_high = patch.point(u, v1);
      area[row * kCells + i] = 0.5 * (next_high - low).cross(high - next_low).norm();
      up_to_[row * kCells + i] = density_at(0.25 * (low + high + next_low + next_high));
      low = next_low;
      high = next_high;
    }
  }

  const std::vector<Patch>& patches_;
  double middle_x_, density_;
  double area_ = 0.0;
  std::vector<double> up_to_;
};

std::vector<Vec3> random_places(const AreaTable& table, std::size_t count, std::uint64_t seed) {
  std::vector<Vec3> points(count);
  parallel_each(count, kPointsPerChunk, 0, [&](std::size_t i) {
    Random random = random_for(RandomUse::kPlace, seed, i);
    points[i] = table.pick(random).point;
  });
  return points;
}

double length_along(const Patch& patch, double fixed, bool along_u) {
  double length = 0.0;
  const auto at = [&](double s) { return along_u ? patch.point(s, fixed) : patch.point(fixed, s); };
  Vec3 last = at(0.0);
  for (int i = 1; i <= kPieces; ++i) {
    const Vec3 next = at(static_cast<double>(i) / kPieces);
    length += (next - last).norm();
    last = next;
  }
  return length;
}

/// Lines along u, evenly spaced along v, each with its own phase.
std::vector<Vec3> places_in_lines(const std::vector<Patch>& patches, double spacing_mm, double ratio,
                                  std::uint64_t seed) {
  const double along = spacing_mm / std::sqrt(ratio), across = spacing_mm * std::sqrt(ratio);
  std::vector<Vec3> points;
  std::size_t line = 0;
  for (const Patch& patch : patches) {
    const auto rows =
        static_cast<std::size_t>(std::max(1.0, std::round(length_along(patch, 0.5, false) / across)));
    for (std::size_t row = 0; row < rows; ++row) {
      const double v = (static_cast<double>(row) + 0.5) / static_cast<double>(rows);
      const auto columns =
          static_cast<std::size_t>(std::max(1.0, std::round(length_along(patch, v, true) / along)));
      Random random = random_for(RandomUse::kLine, seed, line++);
      const double phase = random.uniform();
      for (std::size_t i = 0; i < columns; ++i)
        points.push_back(patch.point((static_cast<double>(i) + phase) / static_cast<double>(columns), v));
    }
  }
  return points;
}

}  // namespace

Random random_for(RandomUse use, std::uint64_t seed, std::size_t index) {
  // Odd multiples of the squared golden number separate the uses from each other and from the jitter.
  const std::uint64_t apart = kGolden64 * kGolden64 * (2 * static_cast<std::uint64_t>(use) + 1);
  return Random((seed ^ apart) + kGolden64 * (index + 1));
}

double count_patches(const std::vector<Patch>& patches, const CommonOptions& common) {
  if (!(common.spacing_mm > 0.0)) return common.points;
  const AreaTable table(patches, {}, 1.0);
  return std::max(4.0, std::round(table.area_mm2() / (common.spacing_mm * common.spacing_mm)));
}

Sampled sample_patches(const std::vector<Patch>& patches, const geometry::Aabb& box,
                       const SamplingOptions& options, const CommonOptions& common) {
  const AreaTable table(patches, box, options.density);
  const auto count = static_cast<std::size_t>(count_patches(patches, common));
  Sampled sampled;
  sampled.spacing_mm = std::sqrt(table.area_mm2() / static_cast<double>(count));
  switch (options.way) {
    case Sampling::kLines:
      sampled.points_mm = places_in_lines(patches, sampled.spacing_mm, options.ratio, common.seed);
      break;
    case Sampling::kBlue:
      sampled.points_mm = poisson_disk_samples(table, count, box.low_mm, [&](std::size_t i) {
        return random_for(RandomUse::kPlace, common.seed, i);
      });
      break;
    default:
      sampled.points_mm = random_places(table, count, common.seed);
  }
  return sampled;
}

void add_noise_and_outliers(const Shape& shape, double spacing_mm, const SamplingOptions& options,
                            std::uint64_t seed, std::vector<Vec3>& points_mm) {
  if (options.noise == 0.0 && options.outliers == 0.0) return;
  const geometry::Aabb box = shape.surface->box_mm();
  parallel_each(points_mm.size(), kPointsPerChunk, 0, [&](std::size_t i) {
    Vec3& p = points_mm[i];
    Random chance = random_for(RandomUse::kOutlier, seed, i);
    if (options.outliers > 0.0 && chance.uniform() < options.outliers) {
      if (options.outliers_near) {
        const double side = chance.uniform() < 0.5 ? -1.0 : 1.0;
        p += side * chance.uniform(kNearestOutlier, kFarthestOutlier) * spacing_mm * shape.normal_at(p);
      } else {
        for (int axis = 0; axis < 3; ++axis) p[axis] = chance.uniform(box.low_mm[axis], box.high_mm[axis]);
      }
    } else if (options.noise > 0.0) {
      Random random = random_for(RandomUse::kNoise, seed, i);
      p += random.normal() * options.noise * spacing_mm * shape.normal_at(p);
    }
  });
}

std::vector<std::uint32_t> random_permutation(std::size_t count, std::uint64_t seed) {
  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  Random random = random_for(RandomUse::kOrder, seed, 0);
  for (std::size_t left = count; left > 1; --left) std::swap(order[left - 1], order[random.below(left)]);
  return order;
}

// ---- meshes

namespace {

using geometry::MeshSurfaceSampler;
using geometry::TriangleMesh;

constexpr double kMaxSubdivisions = 6.0;  ///< 4096 facets from one

/// Uniform places on a mesh, for dart throwing.
class MeshPlaces {
 public:
  explicit MeshPlaces(const TriangleMesh& mesh) : picker_(mesh) {}
  [[nodiscard]] DiskSample pick(Random& random) const {
    const MeshSurfaceSampler::Pick pick = picker_.pick(random);
    return {pick.point, 0, picker_.scaled_normal(pick.facet)};
  }
  [[nodiscard]] double weight() const { return picker_.area(); }
  [[nodiscard]] double density_at(const Vec3& /*p*/) const { return 1.0; }

 private:
  MeshSurfaceSampler picker_;
};

Random place_random(std::uint64_t seed, std::size_t index) {
  return Random((seed ^ kGolden64) + kGolden64 * (index + 1));
}

std::vector<OptionSpec> with_shared_options(std::vector<OptionSpec> own) {
  std::vector<OptionSpec> specs = {
      option::integer("points", "0", "number of points; 0: by spacing", 0, kMaxGeneratedPoints),
      option::number("spacing", "1", "of points, in median edges of the mesh", 1e-3, 1e3,
                     {{"points", {"0"}}}),
      option::integer("subdivide", "0", "times that Loop's subdivision smooths the mesh first", 0,
                      kMaxSubdivisions),
      option::number("noise", "0",
                     "standard deviation in spacings: along the facet's normal, of a scan "
                     "along the ray",
                     0, 100),
      option::integer("seed", "1", "of what is by chance", 0, 1e18)};
  for (OptionSpec& spec : own) specs.push_back(std::move(spec));
  return specs;
}

double median_edge(const TriangleMesh& mesh) {
  std::vector<double> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const auto& t : mesh.triangles)
    for (std::size_t c = 0; c < 3; ++c)
      edges.push_back((mesh.vertices_mm[t[(c + 1) % 3]] - mesh.vertices_mm[t[c]]).norm());
  return upper_median(std::move(edges));
}

std::vector<Vec3> scattered(const TriangleMesh& mesh, bool blue, std::size_t count, double sigma_mm,
                            std::uint64_t seed) {
  std::vector<Vec3> points, facing;
  if (blue) {
    geometry::Aabb box;
    for (const Vec3& p : mesh.vertices_mm) box.add(p);
    points = poisson_disk_samples(
        MeshPlaces(mesh), count, box.low_mm, [&](std::size_t i) { return place_random(seed, i); }, &facing);
  } else {
    const MeshSurfaceSampler picker(mesh);
    for (std::size_t i = 0; i < count; ++i) {
      Random random = place_random(seed, i);
      const MeshSurfaceSampler::Pick pick = picker.pick(random);
      points.push_back(pick.point);
      facing.push_back(picker.scaled_normal(pick.facet));
    }
  }
  for (std::size_t i = 0; sigma_mm > 0.0 && i < count; ++i)
    points[i] += sigma_mm * place_random(~seed, i).normal() * facing[i].normalized();
  return points;
}

}  // namespace

const std::vector<MeshSampling>& mesh_samplings() {
  static const std::vector<MeshSampling> kAll = {
      {"random", "anywhere in the facets, even by area", with_shared_options({})},
      {"blue", "the same with a least distance of 0.7 spacings", with_shared_options({})},
      {"scan", "the rays of a simulated scanner", with_shared_options(scanner_specs({}))}};
  return kAll;
}

const MeshSampling* find_mesh_sampling(std::string_view name) {
  for (const MeshSampling& sampling : mesh_samplings())
    if (sampling.name == name) return &sampling;
  return nullptr;
}

Result<Options> complete_sampling(const NamedOptions& given) {
  const MeshSampling* sampling = find_mesh_sampling(given.name);
  if (sampling == nullptr)
    return Error{fmt::format("there is no way '{}' of sampling a mesh", given.name),
                 did_you_mean(given.name, names_of(mesh_samplings()),
                              "choose from " + joined(names_of(mesh_samplings())))};
  return validate(given.options, sampling->options, given.name);
}

Result<MeshSamples> sample_mesh(std::shared_ptr<const TriangleMesh> mesh, const NamedOptions& spec) {
  PALPATE_ASSIGN(const Options options, complete_sampling(spec));
  MeshSamples made;
  made.truth = std::move(mesh);
  for (long long i = 0; i < options.integer("subdivide"); ++i) {
    if (4.0 * static_cast<double>(made.truth->triangles.size()) > kMaxGeneratedPoints)
      return Error{fmt::format("{}: a subdivided mesh of too many triangles", spec.name),
                   "give a smaller subdivide"};
    made.truth = std::make_shared<const TriangleMesh>(
        geometry::loop_subdivided(i == 0 ? geometry::welded(*made.truth) : *made.truth));
  }
  const double area = made.truth->empty() ? 0.0 : MeshSurfaceSampler(*made.truth).area();
  if (!(area > 0.0) || !std::isfinite(area))
    return Error{fmt::format("{}: the mesh has no area to take points from", spec.name), "give a mesh"};
  made.edge_mm = median_edge(*made.truth);
  const double by_spacing = area / std::pow(options.number("spacing") * made.edge_mm, 2.0);
  const double wanted = options.integer("points") > 0 ? options.number("points") : std::round(by_spacing);
  if (!(wanted >= 4.0) || !(wanted <= kMaxGeneratedPoints))
    return Error{
        fmt::format("{}: {:.3g} points are {}", spec.name, wanted, wanted < 4.0 ? "too few" : "too many"),
        fmt::format("choose points or spacing for 4 to {} points", kMaxGeneratedPoints)};
  const auto seed = static_cast<std::uint64_t>(options.integer("seed"));
  made.spacing_mm = std::sqrt(area / wanted);
  std::vector<Vec3> points;
  if (spec.name == "scan") {
    ScannerOptions scanner = read_scanner(options);
    scanner.points = wanted;
    scanner.seed = seed;
    geometry::Aabb box;
    for (const auto& t : made.truth->triangles)
      for (const std::uint32_t v : t) box.add(made.truth->vertices_mm[v]);
    const geometry::MeshRayCaster rays(*made.truth);
    PALPATE_ASSIGN(Scanned seen, scan([&](const Vec3& a, const Vec3& b) { return rays.first_hit(a, b); }, box,
                                      false, scanner));
    points = std::move(seen.points_mm);
    made.spacing_mm = seen.spacing_mm;
  } else {
    points = scattered(*made.truth, spec.name == "blue", static_cast<std::size_t>(wanted),
                       options.number("noise") * made.spacing_mm, seed);
  }
  PALPATE_ASSIGN(made.cloud, build_cloud(points, NonFinite::kRefuse));
  made.spec = spec.name;
  for (const auto& [key, value] : options.all()) made.spec += fmt::format(":{}={}", key, value);
  return made;
}

}  // namespace palpate::cloud
