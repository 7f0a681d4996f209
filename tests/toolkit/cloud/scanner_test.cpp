// The simulated scanner, and points in the facets of a mesh.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/messages.h"
#include "toolkit/cloud/sampling.h"
#include "toolkit/cloud/scanner.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/parallel.h"
#include "toolkit/core/random.h"
#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::cloud {
namespace {

/// Signed distances of the points to the formula, in spacings.
std::vector<double> off(const GeneratedModel& model) {
  std::vector<double> all;
  for (std::size_t i = 0; i < model.cloud.size(); ++i)
    all.push_back(model.surface->signed_distance_mm(model.cloud.point_mm(i)) / model.nominal_spacing_mm);
  return all;
}

double share(const std::vector<double>& values, double low, double high) {
  return static_cast<double>(
             std::count_if(values.begin(), values.end(), [&](double v) { return v >= low && v <= high; })) /
         static_cast<double>(values.size());
}

TEST(Scanner, CleanRaysEndOnTheSurfaceAtEveryScale) {
  for (const char* scale : {"0.001", "1", "1000000"})
    for (const char* shape : {"ellipsoid", "torus", "sinusoid", "rounded-box"}) {
      const GeneratedModel model =
          made(std::string(shape) + ":sampling=scan:points=6000:views=4:scale=" + scale);
      EXPECT_GT(model.cloud.size(), 3000u) << shape;
      EXPECT_LT(model.cloud.size(), 12000u) << shape;
      EXPECT_EQ(model.original_mesh, nullptr);
      EXPECT_FALSE(model.cloud.raster);
      for (const double d : off(model)) ASSERT_LT(std::abs(d), 1e-3) << shape << " " << scale;
    }
}

TEST(Scanner, OneViewSeesOneSideAndManySeeAll) {
  const GeneratedModel one = made("sphere:sampling=scan:points=5000");
  const geometry::Aabb box = one.surface->box_mm();
  const double z = box.centre_mm().z();
  EXPECT_GT(one.cloud.box_mm().low_mm.z(), z) << "from above, and no ray that grazes";
  const GeneratedModel ten = made("sphere:sampling=scan:points=5000:views=10");
  EXPECT_LT(ten.cloud.box_mm().low_mm.z(), box.low_mm.z() + 0.1 * box.extent_mm().z());
  EXPECT_GT(ten.cloud.box_mm().high_mm.x(), box.high_mm.x() - 0.05 * box.extent_mm().x());
}

TEST(Scanner, RangeNoiseIsAsLargeAsSaid) {
  for (const double noise : {0.05, 0.1, 0.2, 0.3}) {
    // A plane seen from above, far away: ranges stand across it by at most 19 degrees.
    const GeneratedModel model = made("plane:sampling=scan:points=20000:noise=" + std::to_string(noise));
    double squares = 0.0;
    const std::vector<double> distances = off(model);
    for (const double d : distances) squares += d * d;
    EXPECT_NEAR(std::sqrt(squares / static_cast<double>(distances.size())), noise, 0.06 * noise);
  }
}

TEST(Scanner, GrazingRaysReadLong) {
  const GeneratedModel model = made("sphere:sampling=scan:points=20000:bias=0.5");
  const Vec3 centre = model.surface->box_mm().centre_mm();
  const double radius = 0.5 * model.surface->box_mm().extent_mm().x();
  double at_top = 0.0, at_rim = 0.0;
  for (std::size_t i = 0; i < model.cloud.size(); ++i) {
    const Vec3 p = model.cloud.point_mm(i) - centre;
    const double depth = (radius - p.norm()) / model.nominal_spacing_mm;  // longer is deeper
    if (p.z() > 0.99 * radius) at_top = std::max(at_top, std::abs(depth));
    if (p.z() < 0.65 * radius) at_rim = std::max(at_rim, depth);
  }
  EXPECT_LT(at_top, 0.05);
  EXPECT_GT(at_rim, 0.1);
}

TEST(Scanner, DropoutAndFlyingPixelsAreAsManyAsSaid) {
  const std::string scan = "torus:sampling=scan:points=40000:views=3";
  const GeneratedModel whole = made(scan), half = made(scan + ":dropout=0.5"),
                       flying = made(scan + ":flying=0.01");
  EXPECT_NEAR(static_cast<double>(half.cloud.size()) / static_cast<double>(whole.cloud.size()), 0.5, 0.02);
  ASSERT_EQ(flying.cloud.size(), whole.cloud.size());
  const double in_air = 1.0 - share(off(flying), -0.01, 0.01);
  EXPECT_GT(in_air, 0.006);
  EXPECT_LT(in_air, 0.013);
}

TEST(Scanner, RegistrationMovesWholeViews) {
  const GeneratedModel model = made("ellipsoid:sampling=scan:points=8000:views=5:registration=1");
  const std::vector<double> distances = off(model);
  EXPECT_GT(share(distances, -10.0, -0.1) + share(distances, 0.1, 10.0), 0.3);
  EXPECT_EQ(share(distances, -10.0, 10.0), 1.0);
}

TEST(Scanner, RefusesOptionsThatDoNothing) {
  for (const char* bad : {"torus:views=3", "torus:sampling=blue:dropout=0.1", "torus:sampling=scan:views=0",
                          "torus:sampling=scan:dropout=1", "torus:sampling=scan:jitter=0.1",
                          "torus:sampling=scan:ratio=4", "torus:sampling=scan:mesh=true"})
    EXPECT_FALSE(generate(parse_named_options(bad).value())) << bad;
}

TEST(MeshRayCaster, MeetTheNearestFacetFromEitherSide) {
  const GeneratedModel ball = made("sphere:points=2000");
  const geometry::MeshRayCaster rays(*ball.original_mesh);
  const Vec3 c = ball.surface->box_mm().centre_mm();
  const double r = 0.5 * ball.surface->box_mm().extent_mm().x();
  const auto hit = rays.first_hit(c + Vec3(0.1, 0.2, 3.0) * r, c);
  ASSERT_TRUE(hit);
  EXPECT_NEAR((hit->point_mm - c).norm(), r, 0.01 * r);
  EXPECT_GT(hit->normal.z(), 0.9);
  const auto from_inside = rays.first_hit(c, c + Vec3(0.1, 0.2, 3.0) * r);
  ASSERT_TRUE(from_inside);
  EXPECT_LT(from_inside->normal.z(), -0.9);
  EXPECT_FALSE(rays.first_hit(c + Vec3(2, 2, 3) * r, c + Vec3(2, -2, 3) * r));
}

std::shared_ptr<const geometry::TriangleMesh> uneven_mesh() {
  return made("pebble:points=600:jitter=0.2:nonuniform=0.5:seed=3").original_mesh;
}

double distance_to(const geometry::TriangleMesh& mesh, const Vec3& p) {
  double least = 1e300;  // to the planes of facets over which p lies, by brute force
  for (const auto& t : mesh.triangles) {
    const Vec3 &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]], &c = mesh.vertices_mm[t[2]];
    const Vec3 n = (b - a).cross(c - a);
    const bool over = (b - a).cross(p - a).dot(n) >= -1e-9 * n.squaredNorm() &&
                      (c - b).cross(p - b).dot(n) >= -1e-9 * n.squaredNorm() &&
                      (a - c).cross(p - c).dot(n) >= -1e-9 * n.squaredNorm();
    if (over) least = std::min(least, std::abs(n.normalized().dot(p - a)));
  }
  return least;
}

TEST(MeshSamples, StandInTheFacetsAndOffTheVertices) {
  const auto mesh = uneven_mesh();
  for (const char* way : {"random", "blue"})
    for (const char* spacing : {"2", "0.5"}) {
      const auto samples = test::value_of(
          sample_mesh(mesh, parse_named_options(std::string(way) + ":spacing=" + spacing).value()));
      EXPECT_EQ(samples.truth, mesh);
      EXPECT_FALSE(samples.cloud.raster);
      EXPECT_NEAR(samples.spacing_mm, std::stod(spacing) * samples.edge_mm, 0.02 * samples.spacing_mm);
      for (std::size_t i = 0; i < samples.cloud.size(); i += 7)
        ASSERT_LT(distance_to(*mesh, samples.cloud.point_mm(i)), 1e-5 * samples.edge_mm);
      if (way != std::string("blue")) continue;
      double least = 1e300;
      for (std::size_t i = 0; i < samples.cloud.size(); ++i)
        for (std::size_t j = i + 1; j < samples.cloud.size(); ++j)
          least = std::min(least, (samples.cloud.local_mm(i) - samples.cloud.local_mm(j)).norm());
      EXPECT_GT(least, 0.5 * samples.spacing_mm);
    }
}

TEST(MeshSamples, NoiseScanAndSeeds) {
  const auto mesh = uneven_mesh();
  const auto noisy =
      test::value_of(sample_mesh(mesh, parse_named_options("random:points=3000:noise=0.2").value()));
  double squares = 0.0;
  std::size_t counted = 0;
  for (std::size_t i = 0; i < 500; ++i) {
    const double d = distance_to(*mesh, noisy.cloud.point_mm(i));
    if (d > 2.0 * noisy.spacing_mm) continue;  // over an edge: it lies over no facet
    squares += d * d;
    ++counted;
  }
  EXPECT_GT(counted, 400u);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(counted)), 0.2 * noisy.spacing_mm,
              0.04 * noisy.spacing_mm);
  const auto scan =
      test::value_of(sample_mesh(mesh, parse_named_options("scan:points=4000:views=8").value()));
  EXPECT_GT(scan.cloud.size(), 2500u);
  for (std::size_t i = 0; i < scan.cloud.size(); i += 11)
    ASSERT_LT(distance_to(*mesh, scan.cloud.point_mm(i)), 1e-5 * scan.edge_mm);
  std::vector<std::uint64_t> hashes;
  for (const char* seed : {"1", "2", "3", "4", "5", "1"})
    hashes.push_back(content_hash(
        sample_mesh(mesh, parse_named_options("blue:points=900:seed=" + std::string(seed)).value())->cloud));
  EXPECT_EQ(hashes.front(), hashes.back());
  std::sort(hashes.begin(), hashes.end());
  EXPECT_EQ(std::unique(hashes.begin(), hashes.end()) - hashes.begin(), 5);
}

TEST(MeshSamples, RefuseWhatCannotBe) {
  const auto mesh = uneven_mesh();
  for (const char* bad : {"bleu", "blue:spacing=0", "blue:points=100:spacing=0.5", "blue:views=2",
                          "random:points=3", "random:subdivide=7", "blue:spacing=0.001"})
    EXPECT_FALSE(sample_mesh(mesh, parse_named_options(bad).value())) << bad;
  EXPECT_TRUE(test::contains(complete_sampling(parse_named_options("bleu").value()).error().remedy, "blue"));
  const auto nothing = std::make_shared<const geometry::TriangleMesh>();
  EXPECT_FALSE(sample_mesh(nothing, parse_named_options("blue").value()));
}

TEST(Subdivision, GoesToTheSmoothSurfaceAndKeepsBorders) {
  // The regular triangular lattice on a plane stays on it, and its border on the border.
  const GeneratedModel sheet = made("plane:points=121:extent_mm=10");
  geometry::TriangleMesh mesh = *sheet.original_mesh;
  for (int i = 0; i < 2; ++i) mesh = geometry::loop_subdivided(mesh);
  EXPECT_EQ(mesh.triangles.size(), 16 * sheet.original_mesh->triangles.size());
  double area = 0.0;
  for (const auto& t : mesh.triangles) {
    const Vec3 n = (mesh.vertices_mm[t[1]] - mesh.vertices_mm[t[0]])
                       .cross(mesh.vertices_mm[t[2]] - mesh.vertices_mm[t[0]]);
    EXPECT_GT(n.z(), 0.0);
    area += 0.5 * n.z();
  }
  EXPECT_NEAR(area, 100.0, 1.0);  // four corners are rounded
  // A tetrahedron by hand: a new vertex is 3/8 of its edge's ends and 1/8 of the corners across it.
  geometry::TriangleMesh tetrahedron;
  tetrahedron.vertices_mm = {{0, 0, 0}, {8, 0, 0}, {0, 8, 0}, {0, 0, 8}};
  tetrahedron.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  const geometry::TriangleMesh once = geometry::loop_subdivided(tetrahedron);
  ASSERT_EQ(once.vertices_mm.size(), 10u);
  EXPECT_EQ(once.triangles.size(), 16u);
  // Three neighbours: 7/16 of itself and 3/16 of each.
  EXPECT_LT((once.vertices_mm[0] - Vec3(1.5, 1.5, 1.5)).norm(), 1e-12);
  EXPECT_LT((once.vertices_mm[1] - Vec3(3.5, 1.5, 1.5)).norm(), 1e-12);
  EXPECT_LT((once.vertices_mm[4] - Vec3(3, 1, 1)).norm(), 1e-12);  // of 0 and 1
}

TEST(Subdivision, WeldsWhatIsOnePlace) {
  geometry::TriangleMesh soup;
  soup.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 0}};
  soup.triangles = {{0, 1, 2}, {3, 4, 5}, {0, 6, 4}};
  const geometry::TriangleMesh one = geometry::welded(soup);
  EXPECT_EQ(one.vertices_mm.size(), 4u);
  ASSERT_EQ(one.triangles.size(), 2u) << "a facet that lost a corner is left out";
  EXPECT_EQ(one.triangles[1], (std::array<std::uint32_t, 3>{1, 3, 2}));
}

Cloud generated(const std::string& text) {
  return generate(*parse_named_options(text))->cloud;
}
/// The same points in another order.
Cloud shuffled(Cloud cloud, std::uint64_t seed) {
  Random random(seed);
  for (std::size_t i = cloud.size(); i-- > 1;) {
    const std::size_t j = random.below(i + 1);
    std::swap(cloud.x_mm[i], cloud.x_mm[j]);
    std::swap(cloud.y_mm[i], cloud.y_mm[j]);
    std::swap(cloud.z_mm[i], cloud.z_mm[j]);
  }
  cloud.raster.reset();
  return cloud;
}

TEST(Statistics, DensityIsPointsPerBoxVolume) {
  const Statistics s = describe(cloud_of({{0, 0, 0}, {2, 0, 0}, {2, 5, 0}, {1, 1, 0.5}}));
  EXPECT_EQ(s.points, 4u);
  EXPECT_DOUBLE_EQ(s.density_per_mm3, 4.0 / (2 * 5 * 0.5));
  EXPECT_TRUE(std::isinf(describe(generated("plane:points=100")).density_per_mm3));
}

TEST(Statistics, DuplicatesAreCountedAsPointsMinusPlaces) {
  const Cloud c = cloud_of({{1, 1, 1}, {0, 0, 0}, {1, 1, 1}, {-1, 2, 0}, {1, 1, 1}, {0, 0, -0.0}});
  EXPECT_EQ(count_duplicates(c), 3u);
  EXPECT_EQ(count_duplicates(generated("sphere:points=5000")), 0u);
}

TEST(Statistics, BoundsWhatStoringLoses) {
  constexpr std::uint64_t kSeed = 7;
  SCOPED_TRACE(kSeed);
  for (const double scale : {1e-3, 1.0, 1e6}) {
    Random random(kSeed);
    std::vector<Vec3> points;
    for (int i = 0; i < 1000; ++i)
      points.push_back(scale * Vec3(random.uniform() + 1e3, 5.0 * random.uniform(), random.uniform()));
    const Cloud cloud = cloud_of(points);
    double worst = 0.0;
    for (std::size_t i = 0; i < points.size(); ++i)
      worst = std::max(worst, (cloud.point_mm(i) - points[i]).norm());
    EXPECT_LE(worst, stored_rounding_mm(cloud)) << scale;
    EXPECT_GT(worst, 0.1 * stored_rounding_mm(cloud)) << "no looser than needed";
  }
  EXPECT_EQ(stored_rounding_mm(Cloud{}), 0.0);
}

TEST(Statistics, FindsTheScannersRaster) {
  for (const ScanOrder order : {ScanOrder::kRaster, ScanOrder::kBoustrophedon})
    for (const char* how : {"", ":jitter=0.4", ":nonuniform=0.8", ":scale=0.001", ":scale=1000000"}) {
      SCOPED_TRACE(how);
      const bool to_and_fro = order == ScanOrder::kBoustrophedon;
      Cloud c =
          generated(std::string("sinusoid:points=900") + (to_and_fro ? ":order=boustrophedon" : "") + how);
      c.raster.reset();
      Random random(3);  // turns are never exact
      for (std::size_t i = 0; i < c.size() && to_and_fro && how[0] == '\0'; ++i)
        c.x_mm[i] += static_cast<float>(random.uniform(-0.002, 0.002)) * c.x_mm[0];
      const auto raster = find_raster(c);
      ASSERT_TRUE(raster);
      EXPECT_EQ(raster->columns, 30u);
      EXPECT_EQ(raster->rows, 30u);
      EXPECT_EQ(raster->order, order);
      EXPECT_FALSE(find_raster(shuffled(c, 5)));
    }
  Cloud round = generated("torus:points=3000:order=turntable");
  ASSERT_TRUE(round.raster);
  EXPECT_TRUE(round.raster->columns_wrap && round.raster->rows_wrap);
  round.raster.reset();
  EXPECT_FALSE(find_raster(round)) << "what goes round is not recognised";
  // Rows along z, falling, as a scanner that stands upright delivers them.
  std::vector<Vec3> upright;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 7; ++column)
      upright.push_back({0.1 * row * column, 2.0 * row, -1.0 * column});
  const auto raster = find_raster(cloud_of(upright));
  ASSERT_TRUE(raster);
  EXPECT_EQ(raster->columns, 7u);
  EXPECT_EQ(raster->rows, 4u);
  upright.pop_back();
  EXPECT_FALSE(find_raster(cloud_of(upright))) << "a hole";
  EXPECT_FALSE(find_raster(generated("sphere:points=3000")));
  EXPECT_FALSE(find_raster(cloud_of({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}}))) << "one row";
}

TEST(Statistics, TellsHeightFieldsFromBodies) {
  for (const char* field :
       {"sinusoid", "plane", "saddle", "wedge:angle_deg=60", "sinusoid:jitter=0.4:nonuniform=0.5"})
    for (const char* scale : {"0.001", "1000000"}) {
      const Cloud c = generated(std::string(field) + ":points=10000:scale=" + scale);
      EXPECT_TRUE(is_single_valued(c)) << field;
      EXPECT_TRUE(is_single_valued(shuffled(c, 3))) << field << ", whatever the order";
    }
  for (const char* body : {"sphere:points=10000", "torus:points=10000", "slab:points=10000",
                           "slab:points=10000:thickness_mm=0.01"})
    EXPECT_FALSE(is_single_valued(generated(body))) << body;
  EXPECT_FALSE(is_single_valued(cloud_of({{0, 0, 0}, {0, 1, 0}, {0, 2, 5}}))) << "no extent in x";
}

TEST(Sample, IsSomeOfThePointsInTheirOrder) {
  const Cloud whole = generated("torus:points=5000");
  const Cloud some = random_subset(whole, 700, 3);
  ASSERT_EQ(some.size(), 700u);
  std::size_t at = 0;
  for (std::size_t i = 0; i < some.size(); ++i) {
    while (at < whole.size() && whole.point_mm(at) != some.point_mm(i)) ++at;
    ASSERT_LT(at++, whole.size()) << "no point of the cloud, or out of order: " << i;
  }
  EXPECT_EQ(random_subset(whole, 700, 3).x_mm, some.x_mm) << "the same for the same seed";
  EXPECT_NE(random_subset(whole, 700, 4).x_mm, some.x_mm);
  EXPECT_EQ(random_subset(whole, whole.size(), 3).x_mm, whole.x_mm);
  EXPECT_EQ(random_subset(whole, 2 * whole.size(), 3).size(), whole.size());
}

TEST(Cloud, MorePointsThanPlacesAreRefusedUnread) {
  const Vec3 only = Vec3::Zero();
  // No such memory is there: the count alone is looked at.
  const std::span<const Vec3> many(&only, std::size_t{1} << 31);
  EXPECT_TRUE(test::refused(build_cloud(many, NonFinite::kRefuse), "several models"));
}

}  // namespace
}  // namespace palpate::cloud
