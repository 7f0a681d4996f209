#include "toolkit/cloud/mesh_samples.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "toolkit/cloud/sampling.h"
#include "toolkit/cloud/scanner.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/option_specs.h"
#include "toolkit/core/statistics.h"
#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::cloud {
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
