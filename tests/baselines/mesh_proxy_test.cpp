// The sphere proxy: never through, never stuck, never where it does not belong.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "baselines/reference/facet_tree.h"
#include "tests/baselines/indexed.h"
#include "tests/baselines/small_models.h"

namespace palpate::baselines {
namespace {

using test::expect_near;
using test::kStiffness;
using test::make;
using test::Probe;

double distance_to(const geometry::TriangleMesh& mesh, const Vec3& p) {
  return std::sqrt(test::least_distance_sq(mesh, p));
}

std::string sphere(double radius_mm, const char* more = ":tip=centre") {
  return "mesh-proxy:mesh=original:radius_mm=" + std::to_string(radius_mm) + more;
}

TEST(MeshProxy, PlaneFromBothSidesBySkinAndByCentre) {
  const auto flat = test::flat_mesh(10, 10.0);
  for (const double side : {1.0, -1.0}) {
    const Vec3 from{0.3, 0.4, 1.1 * side}, to{2.3, -1.4, -1.0 * side};
    Probe skin = make(flat, sphere(0.25, ""));
    skin.renderer->restart(from);
    EXPECT_FALSE(skin.to({0.3, 0.4, 0.01 * side}).contact);
    render::Frame frame = skin.glide({0.3, 0.4, 0.01 * side}, to, 0.05);
    ASSERT_TRUE(frame.contact);
    expect_near(frame.god_object_mm, {2.3, -1.4, 0}, 1e-9);
    expect_near(frame.force_n, {0, 0, kStiffness * side}, 1e-9);
    EXPECT_FALSE(skin.to({2.3, -1.4, 0.1 * side}).contact);
    Probe centre = make(flat, sphere(0.25));
    centre.renderer->restart(from);
    EXPECT_FALSE(centre.to({0.3, 0.4, 0.26 * side}).contact);
    EXPECT_TRUE(centre.to({0.3, 0.4, 0.24 * side}).contact);
    frame = centre.glide({0.3, 0.4, 0.24 * side}, to, 0.05);
    expect_near(frame.god_object_mm, {2.3, -1.4, 0.25 * side}, 1e-9);
    expect_near(frame.force_n, {0, 0, kStiffness * 1.25 * side}, 1e-9);
  }
}

TEST(MeshProxy, GrooveHoldsByTwoPlanesAndCornerByThree) {
  constexpr double kRadius = 0.4;
  Probe groove =
      make(test::height_mesh(20, 10.0, [](double x, double) { return std::abs(x); }), sphere(kRadius));
  render::Frame frame = groove.press({0.5, 0.2, 3}, {0.05, 0.7, -1}, 0.05);
  expect_near(frame.god_object_mm, {0, 0.7, kRadius * std::sqrt(2.0)}, 1e-9);
  Probe corner = make(test::box_mesh(5, 5, 5), sphere(kRadius));
  frame = corner.press({0, 0, 0}, {6, 7, 8}, 0.05);
  expect_near(frame.god_object_mm, Vec3::Constant(5 - kRadius), 1e-9);
  expect_near(frame.force_n, kStiffness * (Vec3::Constant(5 - kRadius) - Vec3(6, 7, 8)), 1e-8);
}

// Round an edge the sphere rolls: its centre keeps a radius from the edge.
TEST(MeshProxy, RollsOverEdgesAndLetsGo) {
  Probe probe = make(test::box_mesh(5, 5, 5), sphere(0.5));
  render::Frame frame = probe.press({0, 0, 6}, {4.9, 0, 4.9}, 0.1);
  EXPECT_TRUE(frame.contact);
  // The HIP is a hair outside of the edge: the centre lies on the cylinder, in the HIP's direction.
  frame = probe.to({5.1, 0, 5.1});
  ASSERT_TRUE(frame.contact);
  for (int i = 0; i < 20; ++i) frame = probe.to({5.1, 0, 5.1});
  expect_near(frame.god_object_mm, Vec3(5, 0, 5) + 0.5 * Vec3(1, 0, 1).normalized(), 1e-6);
  EXPECT_FALSE(probe.glide({5.1, 0, 5.1}, {6, 0, 4}, 0.05).contact);
}

TEST(MeshProxy, ThinSlabsAreNotPassed) {
  for (const double thickness : {1.0, 0.1, 0.01})
    for (const double step : {0.05, 0.5, 5.0}) {
      const auto slab = test::box_mesh(20, 20, thickness / 2);
      for (const double radius : {1e-4, 0.1, 1.0}) {
        Probe probe = make(slab, sphere(radius, ""));
        for (const double side : {1.0, -1.0}) {
          const Vec3 from{0.37, 0.21, 3 * side}, to{3.1, 2.2, -2.5 * side};
          probe.press(from, to, step);
          render::Frame frame;
          for (int i = 0; i < 50; ++i) frame = probe.to(to);
          ASSERT_TRUE(frame.contact) << thickness << ' ' << step << ' ' << radius;
          expect_near(frame.god_object_mm, {3.1, 2.2, side * thickness / 2}, 1e-8);
        }
      }
    }
}

/// Facets anywhere in any direction, crossing, some without area.
geometry::TriangleMesh soup(Random& random, int facets) {
  geometry::TriangleMesh mesh;
  for (int i = 0; i < facets; ++i) {
    const Vec3 at{random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-5, 5)};
    const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    for (int c = 0; c < 3; ++c)
      mesh.vertices_mm.push_back(at +
                                 Vec3(random.uniform(-2, 2), random.uniform(-2, 2), random.uniform(-2, 2)));
    if (i % 10 == 0) mesh.vertices_mm.back() = 0.5 * (mesh.vertices_mm[first] + mesh.vertices_mm[first + 1]);
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

// Against brute force: at slow and absurd speeds the sphere keeps its distance from every facet; and held
// still it is where no small move would bring it nearer to the HIP.
TEST(MeshProxy, KeepsItsDistanceInASoupOfFacetsAndRestsAtLocalMinima) {
  constexpr std::uint64_t kSeed = 7;
  constexpr double kRadius = 0.3, kNudge = 1e-5;
  Random random(kSeed);
  for (int run = 0; run < 6; ++run) {
    const auto mesh = soup(random, 60);
    Probe probe = make(mesh, sphere(kRadius));
    Vec3 hip{20, 0, 0};
    probe.renderer->restart(hip);
    for (int i = 0; i < 400; ++i) {
      const double reach = i % 50 == 0 ? 1e5 : 0.3;
      hip = i % 50 == 1 ? Vec3::Zero() : hip;
      hip += reach * Vec3(random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1));
      render::Frame frame = probe.to(hip);
      ASSERT_GT(distance_to(mesh, frame.god_object_mm), kRadius - 1e-9) << "seed " << kSeed << " frame " << i;
      if (i % 20 != 19) continue;
      for (int k = 0; k < 30; ++k) frame = probe.to(hip);
      if (!frame.contact) continue;
      const double pulled = (frame.god_object_mm - hip).norm();
      for (int k = 0; k < 200; ++k) {
        const Vec3 way = kNudge * Vec3(random.normal(), random.normal(), random.normal()).normalized();
        const Vec3 there = frame.god_object_mm + way;
        if (distance_to(mesh, there) < kRadius) continue;
        // On round places the first order vanishes: what is left is nudge^2 / (2 radius) and the like.
        ASSERT_GT((there - hip).norm(), pulled - kNudge * kNudge * (1.0 + 1.0 / kRadius))
            << "seed " << kSeed << " run " << run << " frame " << i;
      }
    }
  }
}

TEST(MeshProxy, BeginsSmallWhereThereIsNoRoomAndGrows) {
  const auto flat = test::flat_mesh(10, 10.0);
  Probe probe = make(flat, sphere(0.5));
  for (const double start : {0.1, -0.1}) {
    probe.renderer->restart({0, 0, start});
    EXPECT_FALSE(probe.to({0, 0, start}).contact);
    expect_near(probe.glide({0, 0, start}, {0, 0, -5 * start}, 0.01).god_object_mm, {0, 0, start}, 2e-4);
    EXPECT_FALSE(probe.glide({0, 0, -5 * start}, {0, 0, 10 * start}, 0.01).contact);
    expect_near(probe.glide({0, 0, 10 * start}, {0, 0, -start}, 0.01).god_object_mm,
                {0, 0, std::copysign(0.5, start)}, 1e-9);
  }
  // On the surface it has no side and no body; once off it, it has both.
  probe.renderer->restart({0, 0, 0});
  EXPECT_FALSE(probe.to({0, 0, 0}).contact);
  EXPECT_FALSE(probe.to({0, 0, 1}).contact);
  expect_near(probe.to({0, 0, -1}).god_object_mm, {0, 0, 0.5}, 1e-9);
}

TEST(MeshProxy, HostilePlaces) {
  geometry::TriangleMesh one;
  one.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  one.triangles = {{0, 1, 2}};
  Probe probe = make(one, "mesh-proxy:mesh=original");
  probe.renderer->restart({0.2, 0.2, 1e9});
  EXPECT_FALSE(probe.to({0.2, 0.2, 1e9}).contact);
  render::Frame frame;
  for (int i = 0; i < 100; ++i) frame = probe.to({0.2, 0.2, -1e9});
  EXPECT_TRUE(std::isfinite(frame.force_n.norm()));
  frame = probe.to({std::nan(""), 0, 0});
  EXPECT_EQ(frame.status, render::FrameStatus::kNonFinite);
  EXPECT_EQ(frame.force_n, Vec3::Zero());
  render::Registry registry;
  register_baseline_renderers(registry);
  EXPECT_FALSE(registry.make("mesh-proxy", parse_named_options("mesh-proxy:radius=-1")->options).ok());
}

/// What crosses holds a point alone: asked for beside a sphere it would do nothing.
TEST(MeshProxy, LooksForCrossingsAsAPointAlone) {
  EXPECT_FALSE(test::made("mesh-proxy:mesh=original:crossings=true").ok());
  EXPECT_FALSE(test::made("mesh-proxy:mesh=original:radius=0:radius_mm=1:crossings=true").ok());
  EXPECT_TRUE(test::made("mesh-proxy:mesh=original:radius=0:crossings=true").ok());
}

TEST(MeshProxy, MotionAndScaleChangeNothing) {
  const geometry::TriangleMesh mesh =
      test::height_mesh(60, 10.0, [](double x, double y) { return 0.1 * test::sinusoid(10 * x, 10 * y); });
  const geometry::RigidTransform pose{Eigen::Quaterniond(0.4, 0.5, -0.6, 0.2).normalized(),
                                      Vec3(1e4, -3e4, 2e4)};
  const char* options = "mesh-proxy:mesh=original:radius=2";
  Probe still = make(mesh, options), posed = make(mesh, options, pose);
  Probe small = make(test::moved(mesh, {}, 1e-3), options), large = make(test::moved(mesh, {}, 1e6), options);
  const Vec3 start{0, 0, 5};
  still.renderer->restart(start);
  posed.renderer->restart(pose * start);
  small.renderer->restart(start * 1e-3);
  large.renderer->restart(start * 1e6);
  std::size_t touched = 0;
  for (int i = 0; i < 3000; ++i) {
    const double t = i * 1e-3;
    const Vec3 hip{7 * std::sin(2.1 * t), 6 * std::sin(3.3 * t + 0.2), 2.2 * std::cos(11 * t) + 0.8};
    const render::Frame frame = still.to(hip), other = posed.to(pose * hip);
    touched += frame.contact;
    ASSERT_EQ(frame.contact, other.contact) << i;
    ASSERT_LT((pose * frame.god_object_mm - other.god_object_mm).norm(), 1e-6) << i;
    ASSERT_LT((frame.god_object_mm - 1e3 * small.to(hip * 1e-3).god_object_mm).norm(), 1e-6) << i;
    ASSERT_LT((frame.god_object_mm - 1e-6 * large.to(hip * 1e6).god_object_mm).norm(), 1e-6) << i;
  }
  EXPECT_GT(touched, 1000u);
}

TEST(MeshProxy, WithoutSizeItIsTheGodObject) {
  const auto mesh = test::height_mesh(60, 50.0, test::sinusoid);
  Probe point = make(mesh), proxy = make(mesh, "mesh-proxy:mesh=original:radius=0");
  point.renderer->restart({0, 0, 25});
  proxy.renderer->restart({0, 0, 25});
  for (int i = 0; i < 2000; ++i) {
    const double t = i * 1e-3;
    const Vec3 hip{30 * std::sin(2 * t), 20 * std::sin(3 * t), test::sinusoid(0, 0) * std::cos(9 * t)};
    ASSERT_EQ(point.to(hip).god_object_mm, proxy.to(hip).god_object_mm) << i;
  }
}

TEST(MeshProxy, ShadingIsExactOnAPlaneAndSmoothsEdges) {
  Probe flat = make(test::flat_mesh(10, 10.0), "mesh-proxy:mesh=original:shading=interpolated");
  expect_near(flat.press({0, 0, 5}, {1, 1, -1}, 0.1).force_n, {0, 0, 0.5}, 1e-6);
  // The sphere rests on up to three facets, each shaded for itself, and their number changes: 3.1 measured.
  test::expect_shading_to_smooth_edges("mesh-proxy:mesh=original:radius=0.1", 3.5);
}

// ---- The jam test: held still anywhere on a dense mesh, a frictionless proxy comes to rest, and rests where
// the pull is one that the facets it touches can bear. Small meshes; the full one is mesh_jam's.

/// Angle of rounding alone: coordinates of 50 mm to 1e-11 mm, pulls of 1 mm, facets of 0.1 mm.
constexpr double kRounding = 1e-7;

TEST(Rest, KnowsARestFromAJam) {
  const auto flat = test::flat_mesh(4, 10.0);
  const SurfaceMesh mesh = std::move(SurfaceMesh::build(flat, 1)).value();
  const FacetTree tree(mesh);
  // A point on a plane, pulled along the normal, askew, and not touching.
  EXPECT_LT(rest_of(mesh, tree, {1.1, 0.3, 0}, 0, 1e-9, {1.1, 0.3, -1}).off_rad, 1e-12);
  EXPECT_NEAR(rest_of(mesh, tree, {1.1, 0.3, 0}, 0, 1e-9, {1.2, 0.3, -1}).off_rad, std::atan(0.1), 1e-9);
  EXPECT_EQ(rest_of(mesh, tree, {1.1, 0.3, 1}, 0, 1e-9, {1.1, 0.3, -1}).touched, 0u);
  EXPECT_GT(rest_of(mesh, tree, {1.1, 0.3, 1}, 0, 1e-9, {1.1, 0.3, -1}).off_rad, 1.5);
  // A sphere in a groove: any pull between the two normals is borne, others not.
  const auto vee = test::height_mesh(4, 10.0, [](double x, double) { return std::abs(x); });
  const SurfaceMesh groove = std::move(SurfaceMesh::build(vee, 1)).value();
  const FacetTree groove_tree(groove);
  const Vec3 in{0, 0.3, 0.5 * std::sqrt(2.0)};
  const Vec3 centre = in - groove.origin_mm();
  EXPECT_LT(rest_of(groove, groove_tree, centre, 0.5, 1e-9, centre - Vec3(0.9, 0, 1)).off_rad, 1e-9);
  EXPECT_NEAR(rest_of(groove, groove_tree, centre, 0.5, 1e-9, centre - Vec3(1, 0, 0)).off_rad, std::atan(1.0),
              1e-9);
  EXPECT_GT(rest_of(groove, groove_tree, centre, 0.5, 1e-9, centre - Vec3(0, 0.1, 1)).off_rad, 0.09);
}

struct Case {
  const char* options;
  double radius_mm;
};

class Jam : public testing::TestWithParam<Case> {};

/// Every stop of a winding way 1 mm under the surface, reached along the surface at three speeds.
TEST_P(Jam, NoStopIsAJam) {
  const geometry::TriangleMesh source = test::height_mesh(400, 50.0, test::sinusoid);
  const SurfaceMesh mesh = std::move(SurfaceMesh::build(source, 1)).value();
  const FacetTree tree(mesh);
  Probe probe = make(source, GetParam().options);
  const auto hip_at = [](double t) {
    const double x = 38 * std::sin(1.3 * t + 0.3), y = 38 * std::sin(0.9 * t);
    return Vec3(x, y, test::sinusoid(x, y) - 1.0);
  };
  for (const double dt : {1e-4, 1e-3, 2e-2}) {
    probe.press(hip_at(0) + Vec3(0, 0, 5), hip_at(0), 0.05);
    double t = 0.0;
    for (int stop = 0; stop < 34; ++stop) {
      for (int i = 0; i < 30; ++i) ASSERT_TRUE(probe.to(hip_at(t += dt)).contact);
      const Vec3 hip = hip_at(t);
      render::Frame frame = probe.to(hip), last;
      int calls = 1;
      do {
        last = frame;
        frame = probe.to(hip);
      } while (++calls < 50 &&
               (frame.god_object_mm != last.god_object_mm || frame.status != render::FrameStatus::kOk));
      ASSERT_LT(calls, 50) << "comes to no rest at stop " << stop;
      const Rest rest = rest_of(mesh, tree, frame.god_object_mm - mesh.origin_mm(), GetParam().radius_mm,
                                1e-9, hip - mesh.origin_mm());
      ASSERT_LT(rest.off_rad, kRounding) << "stop " << stop << " dt " << dt;
      t += 0.011;  // some stops are reached by a leap
    }
  }
  EXPECT_EQ(probe.renderer->counters().bound_hits, 0u);
}

INSTANTIATE_TEST_SUITE_P(Probes, Jam,
                         testing::Values(Case{"mesh-godobject:mesh=original", 0.0},
                                         Case{"mesh-proxy:mesh=original:tip=centre:radius_mm=0.1", 0.1},
                                         Case{"mesh-proxy:mesh=original:tip=centre:radius_mm=0.3", 0.3},
                                         Case{"mesh-proxy:mesh=original:tip=centre:radius_mm=1", 1.0}),
                         [](const auto& jam) {
                           return jam.param.radius_mm == 0.0
                                      ? std::string("point")
                                      : "sphere" + std::to_string(static_cast<int>(10 * jam.param.radius_mm));
                         });

}  // namespace
}  // namespace palpate::baselines
