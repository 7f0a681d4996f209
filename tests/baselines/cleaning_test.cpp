// Every step of cleaning on surfaces known by formula.
#include <palpate/baselines.h>
#include <palpate/scene.h>

#include <gtest/gtest.h>

#include <set>

#include "tests/baselines/small_models.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/point_search.h"

namespace palpate::baselines {
namespace {

using test::cloud_of;
using test::generated;
using test::points_of;
using test::refused;

constexpr std::uint64_t kSeed = 5;

Result<scene::CleanedCloud> try_clean(const cloud::Cloud& cloud, const std::string& text, int threads = 1) {
  scene::Cleaning cleaning;
  register_cleaning(cleaning);
  PALPATE_ASSIGN(const auto steps, cleaning.parse(text));
  return cleaning.run(cloud, steps, threads, no_progress());
}

scene::CleanedCloud clean(const cloud::Cloud& cloud, const std::string& text, int threads = 1) {
  SCOPED_TRACE(text);
  return test::value_of(try_clean(cloud, text, threads));
}

/// Every point moved by up to `by` along each axis.
cloud::Cloud noisy(const cloud::Cloud& cloud, double by) {
  Random random(kSeed);
  std::vector<Vec3> points = points_of(cloud);
  for (Vec3& p : points) p += Vec3(random.uniform(-by, by), random.uniform(-by, by), random.uniform(-by, by));
  return cloud_of(points);
}

double rms_distance(const cloud::Cloud& cloud, const geometry::AnalyticSurface& surface,
                    double margin_mm = 0) {
  const geometry::Aabb inner = cloud.box_mm().grown(-margin_mm);
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    if (margin_mm > 0 && (p.x() < inner.low_mm.x() || p.x() > inner.high_mm.x() || p.y() < inner.low_mm.y() ||
                          p.y() > inner.high_mm.y()))
      continue;
    const double d = surface.signed_distance_mm(p);
    sum += d * d;
    ++count;
  }
  EXPECT_GT(count, 0u);
  return std::sqrt(sum / static_cast<double>(count));
}

TEST(Outliers, PlantedOnesGoAndTheSurfaceStays) {
  const cloud::GeneratedModel model = generated("sphere:points=5000");
  std::vector<Vec3> points = points_of(model.cloud);
  Random random(kSeed);
  const double reach = model.cloud.box_mm().extent_mm().x();
  std::set<std::uint32_t> planted;
  for (int i = 0; i < 60; ++i) {
    const Vec3 p(random.uniform(-reach, reach), random.uniform(-reach, reach), random.uniform(-reach, reach));
    if (std::abs(model.surface->signed_distance_mm(p)) < 0.2 * reach) continue;
    planted.insert(static_cast<std::uint32_t>(points.size()));
    points.push_back(p);
  }
  ASSERT_GT(planted.size(), 30u);
  const scene::CleanedCloud made = clean(cloud_of(points), "outliers");
  EXPECT_EQ(made.cloud.size(), model.cloud.size());
  for (const std::uint32_t i : made.from) EXPECT_EQ(planted.count(i), 0u);
}

TEST(Outliers, TheShareIsAnUpperBound) {
  const cloud::Cloud cloud = generated("plane:points=2500").cloud;
  EXPECT_EQ(clean(cloud, "outliers/distance=1e-6/percent=10").cloud.size(), 2250u);
  EXPECT_EQ(clean(cloud, "outliers/percent=0").cloud.size(), 2500u);
  EXPECT_TRUE(refused(try_clean(cloud, "outliers/distance=1e-6"), "every one of 2500"));
}

TEST(Smooth, LowersNoiseByAtLeastHalf) {
  const cloud::GeneratedModel model = generated("sinusoid:points=10000:amplitude_mm=5:wavelength_mm=50");
  const double spacing = search::mean_spacing_mm(model.cloud);
  const cloud::Cloud rough = noisy(model.cloud, 0.4 * spacing);
  const double before = rms_distance(rough, *model.surface, 5 * spacing);
  const double jet = rms_distance(clean(rough, "smooth").cloud, *model.surface, 5 * spacing);
  const double bilateral =
      rms_distance(clean(rough, "smooth/method=bilateral/iterations=2").cloud, *model.surface, 5 * spacing);
  EXPECT_LT(jet, 0.5 * before);
  EXPECT_LT(bilateral, 0.7 * before);
  EXPECT_LT(rms_distance(clean(rough, "smooth/iterations=3").cloud, *model.surface, 5 * spacing), jet);
}

TEST(Smooth, LeavesAPlaneOne) {
  const cloud::Cloud cloud = generated("plane:points=2500").cloud;
  for (const char* how : {"smooth", "smooth/method=bilateral", "smooth/degree=1/neighbours=8"}) {
    const scene::CleanedCloud made = clean(cloud, how);
    ASSERT_EQ(made.cloud.size(), cloud.size());
    EXPECT_LT(made.cloud.box_mm().extent_mm().z(), 1e-6 * cloud.box_mm().extent_mm().x()) << how;
  }
}

TEST(Thin, EveryCellKeepsAPoint) {
  const cloud::Cloud cloud = generated("sphere:points=8000").cloud;
  const double cell = 3.0 * search::mean_spacing_mm(cloud);
  const scene::CleanedCloud made = clean(cloud, "thin/cell=3");
  EXPECT_LT(made.cloud.size(), cloud.size() / 3);
  const search::PointSearch kept(made.cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    ASSERT_LE((made.cloud.point_mm(kept.nearest(p)) - p).norm(), 1.001 * std::sqrt(3.0) * cell);
  }
  for (std::size_t i = 0; i < made.cloud.size(); ++i)
    ASSERT_LT((made.cloud.point_mm(i) - cloud.point_mm(made.from[i])).norm(), 1e-5);
}

TEST(Thin, ClustersAndWlop) {
  const cloud::GeneratedModel model = generated("sphere:points=4000");
  const double spacing = search::mean_spacing_mm(model.cloud);
  const scene::CleanedCloud clusters = clean(model.cloud, "thin/method=hierarchy");
  EXPECT_LT(clusters.cloud.size(), 1000u);
  EXPECT_GT(clusters.cloud.size(), 200u);
  const cloud::Cloud rough = noisy(model.cloud, 0.3 * spacing);
  const scene::CleanedCloud wlop = clean(rough, "thin/method=wlop/percent=25");
  EXPECT_EQ(wlop.cloud.size(), model.cloud.size() / 4);
  EXPECT_LT(rms_distance(wlop.cloud, *model.surface), rms_distance(rough, *model.surface));
  EXPECT_TRUE(refused(try_clean(model.cloud, "thin/method=wlop/percent=0.01"), "percent"));
}

TEST(Upsample, AddsPointsOnTheSurface) {
  const cloud::GeneratedModel model = generated("sphere:points=2000");
  const double spacing = search::mean_spacing_mm(model.cloud);
  const scene::CleanedCloud made = clean(model.cloud, "upsample/factor=3");
  const std::size_t before = model.cloud.size();
  EXPECT_EQ(made.cloud.size(), 3 * before);
  for (std::size_t i = 0; i < before; ++i)
    ASSERT_LT((made.cloud.point_mm(i) - model.cloud.point_mm(i)).norm(), 1e-5) << "points stay";
  for (std::size_t i = before; i < made.cloud.size(); ++i)
    ASSERT_LT(std::abs(model.surface->signed_distance_mm(made.cloud.point_mm(i))), 0.5 * spacing) << i;
  EXPECT_LT(search::mean_spacing_mm(made.cloud), 0.75 * spacing);
}

/// A sinusoid with round holes of these radii, mm, side by side.
cloud::Cloud with_holes(const cloud::Cloud& cloud, const std::vector<double>& radii) {
  const geometry::Aabb box = cloud.box_mm();
  std::vector<Vec3> points;
  for (const Vec3& p : points_of(cloud)) {
    bool keep = true;
    for (std::size_t k = 0; k < radii.size(); ++k) {
      const double x = box.low_mm.x() + box.extent_mm().x() * (static_cast<double>(k) + 1) /
                                            (static_cast<double>(radii.size()) + 1);
      keep = keep && std::hypot(p.x() - x, p.y() - box.centre_mm().y()) > radii[k];
    }
    if (keep) points.push_back(p);
  }
  return cloud_of(points);
}

TEST(FillHoles, ClosesHolesAndNotTheRim) {
  const cloud::GeneratedModel model = generated("sinusoid:points=10000:amplitude_mm=3:wavelength_mm=60");
  const double spacing = search::mean_spacing_mm(model.cloud);
  const cloud::Cloud holed = with_holes(model.cloud, {4 * spacing, 15 * spacing});
  const scene::CleanedCloud made = clean(holed, "fill-holes");
  EXPECT_TRUE(test::contains(made.notes[0], "1 hole filled, 1 wider"));
  const auto missing =
      static_cast<double>(model.cloud.size() - with_holes(model.cloud, {4 * spacing}).size());
  const auto added = static_cast<double>(made.cloud.size() - holed.size());
  EXPECT_GT(added, 0.6 * missing);
  EXPECT_LT(added, 1.6 * missing);
  for (std::size_t i = holed.size(); i < made.cloud.size(); ++i) {
    const Vec3 p = made.cloud.point_mm(i);
    ASSERT_LT(std::abs(model.surface->signed_distance_mm(p)), 0.5 * spacing) << i;
    ASSERT_TRUE(model.cloud.box_mm().grown(spacing).contains(p));
  }
  const scene::CleanedCloud both = clean(holed, "fill-holes/width=100");
  EXPECT_TRUE(test::contains(both.notes[0], "2 holes filled, 0 wider"));
  EXPECT_EQ(clean(model.cloud, "fill-holes/width=1e6").cloud.size(), model.cloud.size()) << "the rim stays";
}

TEST(EveryStep, IsTheSameOnEveryRunAndAtEveryScale) {
  const cloud::Cloud base = noisy(generated("sinusoid:points=2500").cloud, 0.5);
  for (const char* step : {"outliers", "smooth", "smooth/method=bilateral", "thin", "thin/method=hierarchy",
                           "thin/method=wlop", "upsample", "fill-holes"}) {
    const scene::CleanedCloud first = clean(base, step, 1), second = clean(base, step, 2);
    ASSERT_EQ(first.from, second.from) << step;
    EXPECT_EQ(first.cloud.x_mm, second.cloud.x_mm) << step;
    // Powers of two: every rounding is the same.
    for (const double scale : {0x1p-13, 0x1p13}) {
      std::vector<Vec3> points = points_of(base);
      for (Vec3& p : points) p *= scale;
      const scene::CleanedCloud scaled = clean(cloud_of(points), step);
      ASSERT_EQ(scaled.from, first.from) << step << " at scale " << scale;
      for (std::size_t i = 0; i < first.cloud.size(); ++i)
        ASSERT_LT((scaled.cloud.local_mm(i) / scale - first.cloud.local_mm(i)).norm(), 1e-9)
            << step << " at scale " << scale;
    }
  }
}

TEST(EveryStep, SurvivesHostilePoints) {
  std::vector<Vec3> line, heap, far;
  for (int i = 0; i < 300; ++i) {
    line.emplace_back(0.1 * i, 0, 0);
    heap.emplace_back(1, 2, 3);
    far.emplace_back(i % 2 == 0 ? Vec3(0.01 * i, 0.01 * ((7 * i) % 50), 0) : Vec3(1e9, 1e9 + i, 0));
  }
  const std::vector<std::vector<Vec3>> clouds = {{{1, 1, 1}}, {{0, 0, 0}, {1, 0, 0}}, line, heap, far};
  for (const char* step :
       {"outliers", "outliers/neighbours=2", "smooth", "smooth/neighbours=6", "smooth/method=bilateral",
        "thin", "thin/method=hierarchy", "thin/method=wlop", "upsample", "fill-holes"})
    for (const auto& points : clouds) {
      const auto made = try_clean(cloud_of(points), step);
      if (!made) {
        EXPECT_FALSE(made.error().what.empty());
        EXPECT_FALSE(made.error().remedy.empty()) << step << ": " << made.error().what;
        continue;
      }
      ASSERT_FALSE(made->cloud.empty());
      for (std::size_t i = 0; i < made->cloud.size(); ++i) ASSERT_TRUE(is_finite(made->cloud.point_mm(i)));
    }
}

TEST(EveryStep, AJetThatIsNotDeterminedIsRefused) {
  EXPECT_TRUE(refused(try_clean(generated("plane:points=400").cloud, "smooth/degree=4/neighbours=14"),
                      "15 neighbours"));
}

}  // namespace
}  // namespace palpate::baselines
