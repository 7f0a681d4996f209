// Every reconstruction on surfaces known by formula.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <set>

#include "baselines/mesh/mesh_repair.h"
#include "baselines/reconstruct/method_functions.h"
#include "baselines/reconstruct/reconstruct.h"
#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"

namespace palpate::baselines {
namespace {

constexpr std::uint64_t kSeed = 31;

using test::generated;

struct Made {
  geometry::TriangleMesh mesh;
  render::PrepareReport report;
  std::string error;  ///< empty where there is a mesh
};

Made make(const std::string& name, const cloud::Cloud& cloud, const Options& given = {}) {
  Made made;
  const auto* method = test::value_of(find_method(name));
  const Options options = test::value_of(validate(given, method->options, name));
  render::PreparePhases phases(made.report, {1, nullptr});
  auto mesh = make_mesh(*method, cloud, options, 1, phases);
  if (mesh.ok())
    made.mesh = *std::move(mesh);
  else
    made.error = mesh.error().message();
  return made;
}

/// The same in a process of its own.
Result<Reconstruction> make_apart(const std::string& name, const cloud::Cloud& cloud, int threads = 1) {
  const auto method = find_method(name);
  const auto options = validate({}, (*method)->options, name);
  return run_limited(**method, cloud, *options, {}, threads, no_progress());
}

std::vector<std::string> built_methods() {
  std::vector<std::string> names;
  for (const Method& method : methods())
    if (method.not_built.empty()) names.push_back(method.name);
  return names;
}

/// Root mean square and largest distance of the triangles' corners and centres from the formula.
std::pair<double, double> distance(const geometry::TriangleMesh& mesh,
                                   const geometry::AnalyticSurface& surface) {
  double sum = 0.0, most = 0.0;
  std::size_t n = 0;
  const auto add = [&](const Vec3& p) {
    const double d = std::abs(surface.signed_distance_mm(p));
    sum += d * d;
    most = std::max(most, d);
    ++n;
  };
  for (const auto& t : mesh.triangles) {
    add(mesh.vertices_mm[t[0]]);
    add((mesh.vertices_mm[t[0]] + mesh.vertices_mm[t[1]] + mesh.vertices_mm[t[2]]) / 3.0);
  }
  return {std::sqrt(sum / static_cast<double>(n)), most};
}

/// Every edge is run along as often one way as the other: no border, one orientation.
bool is_cycle(const geometry::TriangleMesh& mesh) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, int> runs;
  for (const auto& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      runs[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  return std::all_of(runs.begin(), runs.end(), [](const auto& run) { return run.second == 0; });
}

MeshReport report_of(const geometry::TriangleMesh& mesh) {
  return report_on(test::value_of(SurfaceMesh::build(mesh, 1)));
}

bool sane(const geometry::TriangleMesh& mesh) {
  return std::all_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const auto& t) {
    return std::all_of(t.begin(), t.end(), [&](std::uint32_t v) {
      return v < mesh.vertices_mm.size() && is_finite(mesh.vertices_mm[v]);
    });
  });
}

cloud::Cloud moved(const cloud::Cloud& cloud, double scale, const Vec3& by) {
  std::vector<Vec3> points = test::points_of(cloud);
  for (Vec3& p : points) p = scale * p + by;
  cloud::Cloud built = test::cloud_of(points);
  built.raster = cloud.raster;
  return built;
}

class EveryMethod : public testing::TestWithParam<std::string> {};

TEST_P(EveryMethod, StaysOnASphere) {
  if (GetParam() == "organised") GTEST_SKIP() << "a sphere's points stand in no raster";
  const auto model = generated("sphere:points=4000");
  const Made made = make(GetParam(), model.cloud);
  ASSERT_EQ(made.error, "");
  ASSERT_TRUE(sane(made.mesh));
  const auto [rms, most] = distance(made.mesh, *model.surface);
  RecordProperty("rms_in_spacings", std::to_string(rms / model.nominal_spacing_mm));
  // Chords of a sphere whose edges are a spacing lie within a small part of it; a cube's corner or a facet of
  // the level set is farther off.
  EXPECT_LT(rms, 0.1 * model.nominal_spacing_mm);
  EXPECT_LT(most, 0.6 * model.nominal_spacing_mm);
  EXPECT_GT(made.mesh.triangles.size(), 2000u);
  ASSERT_FALSE(made.report.phases.empty());
}

TEST_P(EveryMethod, StaysOnAWavySheet) {
  const auto model = generated("sinusoid:points=3136");
  const Made made = make(GetParam(), model.cloud);
  ASSERT_EQ(made.error, "");
  ASSERT_TRUE(sane(made.mesh));
  const auto near = std::count_if(made.mesh.triangles.begin(), made.mesh.triangles.end(), [&](const auto& t) {
    const Vec3 centre =
        (made.mesh.vertices_mm[t[0]] + made.mesh.vertices_mm[t[1]] + made.mesh.vertices_mm[t[2]]) / 3.0;
    return std::abs(model.surface->signed_distance_mm(centre)) < 0.5 * model.nominal_spacing_mm;
  });
  const double share = static_cast<double>(near) / static_cast<double>(made.mesh.triangles.size());
  if (GetParam() == "power-crust") {
    EXPECT_GT(near, 2000);  // closed by construction: the sheet, and a lid over it
  } else if (GetParam() == "poisson") {
    EXPECT_GT(share, 0.75);  // a level set curls over at a border
  } else {
    EXPECT_GT(near, 4000);
    EXPECT_GT(share, 0.9);
  }
}

TEST_P(EveryMethod, IsTheSameOnEveryRunForAnyNumberOfThreads) {
  const auto model = generated("sinusoid:points=1600");
  const auto one = make_apart(GetParam(), model.cloud, 1), many = make_apart(GetParam(), model.cloud, 4);
  ASSERT_TRUE(one.ok()) << one.error().message();
  ASSERT_TRUE(many.ok()) << many.error().message();
  EXPECT_TRUE(one->mesh.vertices_mm == many->mesh.vertices_mm);
  EXPECT_TRUE(one->mesh.triangles == many->mesh.triangles);
}

TEST_P(EveryMethod, ScalesWithTheCloudFarFromTheOrigin) {
  const auto model = generated("sinusoid:points=1024:jitter=0.2:seed=5");
  const Made plain = make(GetParam(), model.cloud);
  ASSERT_EQ(plain.error, "");
  for (const double scale : {1e-3, 1e6}) {
    const Made other = make(GetParam(), moved(model.cloud, scale, Vec3(1, -2, 3) * scale * 100.0));
    ASSERT_EQ(other.error, "") << scale;
    ASSERT_TRUE(sane(other.mesh));
    // Moved points are stored with other roundings: a few triangles may differ.
    EXPECT_NEAR(static_cast<double>(other.mesh.triangles.size()),
                static_cast<double>(plain.mesh.triangles.size()),
                0.08 * static_cast<double>(plain.mesh.triangles.size()))
        << scale;
    geometry::Aabb box;
    for (const auto& t : other.mesh.triangles)
      for (const std::uint32_t v : t) box.add(other.mesh.vertices_mm[v] / scale - Vec3(1, -2, 3) * 100.0);
    EXPECT_LT((box.centre_mm() - model.cloud.box_mm().centre_mm()).norm(),
              0.2 * model.cloud.box_mm().extent_mm().norm())
        << scale;
  }
}

TEST_P(EveryMethod, AnswersDegenerateCloudsWithoutCrashing) {
  std::vector<std::vector<Vec3>> clouds(6);
  clouds[0] = {{1, 2, 3}};
  clouds[1] = {{1, 2, 3}, {4, 5, 6}};
  clouds[2].assign(50, Vec3(7, 8, 9));
  for (int i = 0; i < 60; ++i) clouds[3].push_back({1.0 * i, 2.0 * i, 0});
  clouds[4] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  clouds[5] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}, {1, 0, 0}};
  for (std::size_t i = 0; i < clouds.size(); ++i) {
    const auto made = make_apart(GetParam(), test::cloud_of(clouds[i]));  // a crash is of that process
    if (made.ok()) {
      EXPECT_GE(i, 4u);  // no surface before that
      EXPECT_TRUE(sane(made->mesh)) << i;
    } else {
      EXPECT_NE(made.error().message(), "") << i;
    }
  }
}

TEST_P(EveryMethod, AnswersCoplanarAndRepeatedPoints) {
  const auto plane = generated("plane:points=900");
  const auto flat = make_apart(GetParam(), plane.cloud);
  if (flat.ok()) {
    EXPECT_TRUE(sane(flat->mesh));
    EXPECT_GT(flat->mesh.triangles.size(), 100u);
  }
  const auto model = generated("sinusoid:points=1024");
  const std::vector<Vec3> once = test::points_of(model.cloud);
  std::vector<Vec3> twice = once;
  twice.insert(twice.end(), once.begin(), once.end());
  const auto made = make_apart(GetParam(), test::cloud_of(twice));
  if (GetParam() == "organised") {
    EXPECT_FALSE(made.ok());
    return;
  }
  ASSERT_TRUE(made.ok()) << made.error().message();
  EXPECT_TRUE(sane(made->mesh));
  EXPECT_GT(made->mesh.triangles.size(), 1000u);
}

INSTANTIATE_TEST_SUITE_P(Reconstruction, EveryMethod, testing::ValuesIn(built_methods()), test::test_name);

TEST(Reconstruction, ClosesClosedSurfacesOutward) {
  const auto sphere = generated("sphere:points=4000"), torus = generated("torus:points=6000");
  for (const char* name : {"advancing-front", "poisson", "power-crust", "marching-cubes"})
    for (const auto* model : {&sphere, &torus}) {
      const Made made = make(name, model->cloud);
      ASSERT_EQ(made.error, "") << name;
      EXPECT_TRUE(is_cycle(made.mesh)) << name;
      if (std::string(name) != "power-crust") {  // whose facets may meet in fours at an edge
        const MeshReport report = report_of(made.mesh);
        EXPECT_EQ(report.boundary_edges, 0u) << name;
        EXPECT_EQ(report.components, 1u) << name;
      }
      // The regular triangulation that the points come with is turned outward.
      EXPECT_NEAR(test::volume_of(made.mesh), test::volume_of(*model->original_mesh),
                  0.02 * test::volume_of(*model->original_mesh))
          << name;
    }
}

TEST(Reconstruction, FollowsANoisySphere) {
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  const auto model = generated("sphere:points=4000");
  const double sigma = 0.1 * model.nominal_spacing_mm;
  std::vector<Vec3> points = test::points_of(model.cloud);
  for (Vec3& p : points) p += sigma * Vec3(random.normal(), random.normal(), random.normal());
  const cloud::Cloud noisy = test::cloud_of(points);
  for (const std::string& name : built_methods()) {
    if (name == "organised") continue;
    const Made made = make(name, noisy);
    ASSERT_EQ(made.error, "") << name;
    EXPECT_LT(distance(made.mesh, *model.surface).first, 0.25 * model.nominal_spacing_mm) << name;
  }
}

TEST(Reconstruction, DoesNotDependOnTheOrderOfPoints) {
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  const auto model = generated("torus:points=3000:jitter=0.2:seed=2");
  std::vector<std::uint32_t> order(model.cloud.size());
  std::iota(order.begin(), order.end(), 0u);
  for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.below(i)]);
  cloud::Cloud shuffled = model.cloud;
  shuffled.raster.reset();
  for (std::size_t i = 0; i < order.size(); ++i) {
    shuffled.x_mm[i] = model.cloud.x_mm[order[i]];
    shuffled.y_mm[i] = model.cloud.y_mm[order[i]];
    shuffled.z_mm[i] = model.cloud.z_mm[order[i]];
  }
  // Delaunay triangulations of points in general position are unique.
  const auto keys = [](const geometry::TriangleMesh& mesh, const std::vector<std::uint32_t>& name_of) {
    std::set<std::array<std::uint32_t, 3>> all;
    for (auto t : mesh.triangles) {
      for (std::uint32_t& v : t) v = name_of[v];
      std::sort(t.begin(), t.end());
      all.insert(t);
    }
    return all;
  };
  std::vector<std::uint32_t> same(order.size());
  std::iota(same.begin(), same.end(), 0u);
  const auto plain = make("alpha-shape", model.cloud), other = make("alpha-shape", shuffled);
  EXPECT_EQ(keys(plain.mesh, same), keys(other.mesh, order));
  const auto crust = make("power-crust", model.cloud), other_crust = make("power-crust", shuffled);
  EXPECT_NEAR(test::volume_of(crust.mesh), test::volume_of(other_crust.mesh),
              1e-3 * test::volume_of(crust.mesh));
}

TEST(Reconstruction, NormalsByPlanesAndByCgalAgreeOnASphere) {
  const auto model = generated("sphere:points=4000");
  for (const char* normals : {"planes", "pca", "jet"}) {
    Options options;
    options.set("normals", normals);
    options.set("poisson_on", std::string(normals) == "pca" ? "delaunay" : "octree");
    const Made made = make("poisson", model.cloud, options);
    ASSERT_EQ(made.error, "") << normals;
    EXPECT_TRUE(is_cycle(made.mesh)) << normals;
    EXPECT_NEAR(test::volume_of(made.mesh), test::volume_of(*model.original_mesh),
                0.02 * test::volume_of(*model.original_mesh))
        << normals;
  }
}

TEST(Reconstruction, OrganisedMeshGoesRoundATurntable) {
  const auto model = generated("torus:points=2500:order=turntable");
  ASSERT_TRUE(model.cloud.raster.has_value());
  const Made made = make("organised", model.cloud);
  ASSERT_EQ(made.error, "");
  const MeshReport report = report_of(made.mesh);
  EXPECT_TRUE(report.closed);
  EXPECT_EQ(made.mesh.triangles.size(), 2 * model.cloud.size());
}

TEST(Reconstruction, OrganisedMeshLeavesLongEdgesOut) {
  // Two squares, one ten spacings above the other: a column of cells between them.
  std::vector<Vec3> points;
  const std::uint32_t columns = 20, rows = 15;
  for (std::uint32_t r = 0; r < rows; ++r)
    for (std::uint32_t c = 0; c < columns; ++c) points.emplace_back(c, r, c < 10 ? 0.0 : 10.0);
  cloud::Cloud cloud = test::cloud_of(points);
  cloud.raster = cloud::ScanRaster{columns, rows};
  Options options;
  EXPECT_EQ(make("organised", cloud, options).mesh.triangles.size(), 2u * 19u * 14u);
  options.set("organised_longest", "4");
  EXPECT_EQ(make("organised", cloud, options).mesh.triangles.size(), 2u * 18u * 14u);
}

TEST(Reconstruction, NamesWhatThereIs) {
  EXPECT_TRUE(test::refused(find_method("nurbs"), "power-crust"));
  std::set<std::string> keys;
  for (const OptionSpec& spec : all_method_options("mesh")) {
    EXPECT_TRUE(keys.insert(spec.key).second) << spec.key;
    EXPECT_NE(spec.help, "") << spec.key;
  }
}

}  // namespace
}  // namespace palpate::baselines
