// The analytic reference, and the local resolution of a cloud.
#include "toolkit/metrics/reference.h"

#include <gtest/gtest.h>

#include <cmath>

#include "toolkit/core/random.h"
#include "toolkit/geometry/analytic_shapes.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/metrics/truth.h"

namespace palpate::metrics {
namespace {

constexpr double kStiffness = 0.5;

trace::ProbePath path_through(const std::vector<Vec3>& corners_mm, int frames_a_leg) {
  trace::ProbePath path;
  path.name = "test";
  for (std::size_t c = 0; c + 1 < corners_mm.size(); ++c) {
    for (int i = 0; i < frames_a_leg; ++i) {
      const double t = static_cast<double>(i) / frames_a_leg;
      path.hip_mm.push_back((1.0 - t) * corners_mm[c] + t * corners_mm[c + 1]);
      path.t_s.push_back(0.001 * static_cast<double>(path.t_s.size()));
    }
  }
  return path;
}

geometry::RigidTransform some_pose() {
  geometry::RigidTransform pose;
  pose.rotation = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, 3.0).normalized());
  pose.translation_mm = {100.0, -50.0, 20.0};
  return pose;
}

TEST(AnalyticReference, PlaneToTheDigit) {
  const auto plane = geometry::make_plane(100.0);
  const trace::ProbePath path = path_through({{0, 0, 1}, {3, 0, -2}, {5, 5, -1}, {5, 5, 1}}, 40);
  const auto r = analytic_reference(*plane, path, kStiffness, 0.0, {});
  ASSERT_TRUE(r) << r.error().message();
  EXPECT_EQ(r->name, "analytic");
  EXPECT_NE(r->exactness.find("halving"), std::string::npos);
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vec3& h = path.hip_mm[i];
    const trace::TruthFrame& f = r->frames[i];
    EXPECT_EQ(f.frame.contact, h.z() < 0.0) << i;
    EXPECT_NEAR(f.signed_distance_mm, h.z(), 1e-13) << i;
    EXPECT_NEAR(f.frame.force_n.z(), h.z() < 0.0 ? -kStiffness * h.z() : 0.0, 1e-13) << i;
    EXPECT_NEAR(f.frame.force_n.head<2>().norm(), 0.0, 1e-13) << i;
    contacts += f.frame.contact ? 1u : 0u;
  }
  EXPECT_GT(contacts, 60u);
}

TEST(AnalyticReference, ForceLimitKeepsTheDirection) {
  const auto plane = geometry::make_plane(100.0);
  const auto r = analytic_reference(*plane, path_through({{0, 0, 1}, {0, 0, -9}}, 20), kStiffness, 1.0, {});
  ASSERT_TRUE(r);
  EXPECT_NEAR(r->frames.back().frame.force_n.z(), 1.0, 1e-15);
  EXPECT_NEAR(r->frames.back().signed_distance_mm, -8.5, 1e-12) << "the distance is not limited";
}

TEST(AnalyticReference, SphereUnderAPose) {
  const auto sphere = geometry::make_sphere(10.0);
  const geometry::RigidTransform pose = some_pose();
  trace::ProbePath path = path_through({{0, 0, 11}, {0, 0, 9}, {8, 0, 3}, {11, 0, 0}}, 50);
  std::vector<Vec3> model_mm = path.hip_mm;
  for (Vec3& h : path.hip_mm) h = pose * h;
  const auto r = analytic_reference(*sphere, path, kStiffness, 0.0, pose);
  ASSERT_TRUE(r);
  const AnalyticTruth truth(*sphere, pose);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double d = model_mm[i].norm() - 10.0;
    EXPECT_NEAR(r->frames[i].signed_distance_mm, d, 1e-12);
    EXPECT_NEAR(truth.signed_distance_mm(path.hip_mm[i]), d, 1e-12);
    const Vec3 normal = pose.rotate(model_mm[i].normalized());
    EXPECT_NEAR((r->frames[i].normal - normal).norm(), 0.0, 1e-9);
    EXPECT_NEAR((truth.closest(path.hip_mm[i]).normal - normal).norm(), 0.0, 1e-9);
    if (d < 0.0) {
      EXPECT_NEAR((r->frames[i].frame.force_n + kStiffness * d * normal).norm(), 0.0, 1e-9);
    }
  }
}

TEST(AnalyticReference, StaysOnItsSheetOfAThinSlab) {
  const auto slab = geometry::make_slab(50.0, 1.0);
  // From above down to 0.2 mm over the lower face: the nearest face is the lower one, the constrained god
  // object stays up.
  const trace::ProbePath path = path_through({{0, 0, 2}, {0, 0, -0.3}, {3, 0, -0.3}, {3, 0, 2}}, 60);
  const auto r = analytic_reference(*slab, path, kStiffness, 0.0, {});
  ASSERT_TRUE(r);
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!r->frames[i].frame.contact) continue;
    EXPECT_NEAR(r->frames[i].frame.god_object_mm.z(), 0.5, 1e-12);
    EXPECT_GT(r->frames[i].frame.force_n.z(), 0.0);
  }
}

TEST(AnalyticReference, ScoresPerfectlyAgainstItself) {
  const auto sinusoid = geometry::make_sinusoid(10.0, 50.0, 100.0);
  const trace::ProbePath path = path_through({{20, 12, 25}, {2, 1, 18.5}, {6, 9, 10}, {1, 3, 25}}, 200);
  auto r = analytic_reference(*sinusoid, path, kStiffness, 0.0, {});
  ASSERT_TRUE(r);
  for (trace::TruthFrame& frame : r->frames) frame.local_resolution_mm = 0.2;
  const AnalyticTruth truth(*sinusoid, {});
  const auto a = score(path, as_trace(*r), *r, &truth, {});
  ASSERT_TRUE(a) << a.error().message();
  EXPECT_GT(a->contact_frames, 50u);
  EXPECT_EQ(a->force_rms_n, 0.0);
  EXPECT_EQ(a->pop_throughs, 0u);
  EXPECT_LT(*a->god_object_surface_max_mm, 1e-9);
  const auto e = observe_energy(path, as_trace(*r), kStiffness);
  ASSERT_TRUE(e);
  EXPECT_LT(*e->generated_percent, 1.0) << "only sampling at entry and exit";
}

TEST(AnalyticReference, RefusesBadPaths) {
  const auto plane = geometry::make_plane(100.0);
  const auto inside =
      analytic_reference(*plane, path_through({{0, 0, -1}, {0, 0, 1}}, 5), kStiffness, 0.0, {});
  ASSERT_FALSE(inside);
  EXPECT_EQ(inside.error().line, 2);
  EXPECT_FALSE(analytic_reference(*plane, {}, kStiffness, 0.0, {}));
  trace::ProbePath bad = path_through({{0, 0, 1}, {0, 0, 2}}, 3);
  EXPECT_FALSE(analytic_reference(*plane, bad, 0.0, 0.0, {}));
  bad.hip_mm[2].x() = std::nan("");
  EXPECT_EQ(analytic_reference(*plane, bad, kStiffness, 0.0, {}).error().line, 4);
}

cloud::Cloud cloud_of(const std::vector<Vec3>& points) {
  auto made = cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  EXPECT_TRUE(made.ok());
  return std::move(made).value();
}

TEST(LocalResolution, DistanceToTheLastNeighbourThere) {
  // A 5 x 5 grid of 1 mm: an inner point's eighth neighbour is a diagonal away.
  std::vector<Vec3> points;
  for (int y = 0; y < 5; ++y) {
    for (int x = 0; x < 5; ++x) points.emplace_back(x - 2, y - 2, 0.0);
  }
  cloud::Cloud cloud = cloud_of(points);
  neighbourhood::NeighbourTable table;
  table.of.resize(25);
  for (std::uint32_t i = 0; i < 25; ++i) table.of[i].fill(i);
  table.of[12] = {7, 11, 13, 17, 6, 8, 16, 18};  // the middle
  table.of[13] = {12, 13, 13, 13, 13, 13, 13, 13};
  const geometry::RigidTransform pose = some_pose();
  const auto plane = geometry::make_plane(5.0);
  trace::ProbePath path = path_through({{0.1, 0.2, 3}, {0.1, 0.2, -0.5}, {1.1, 0, -0.5}, {1.1, 0, 0}}, 2);
  for (Vec3& h : path.hip_mm) h = pose * h;
  auto r = analytic_reference(*plane, path, kStiffness, 0.0, pose);
  ASSERT_TRUE(r);
  ASSERT_TRUE(fill_local_resolution(*r, path, cloud, table, pose));
  EXPECT_NEAR(r->frames[0].local_resolution_mm, std::sqrt(2.0), 1e-12) << "free, above the middle";
  EXPECT_NEAR(r->frames[2].local_resolution_mm, std::sqrt(2.0), 1e-12) << "in contact at the middle";
  EXPECT_NEAR(r->frames[4].local_resolution_mm, 1.0, 1e-12) << "a point with one neighbour";
  table.of.pop_back();
  EXPECT_FALSE(fill_local_resolution(*r, path, cloud, table, pose));
}

}  // namespace
}  // namespace palpate::metrics
