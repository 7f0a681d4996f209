// The probes on one mesh, a point and a sphere: never through, never stuck, never where they do not belong.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "baselines/reference/facet_tree.h"
#include "tests/baselines/meshes.h"
#include "tests/baselines/small_models.h"

namespace palpate::baselines {
namespace {

using test::expect_held;
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

struct Tip {
  const char* options;
  double radius_mm;
  bool skin = false;  ///< the god object is on the sphere, not its centre
  [[nodiscard]] Vec3 god_object(const Vec3& centre, const Vec3& hip) const {
    return skin ? Vec3(centre + radius_mm * (hip - centre).normalized()) : centre;
  }
};
constexpr Tip kTips[] = {{"mesh-godobject:mesh=original", 0.0},
                         {"mesh-proxy:mesh=original:radius_mm=0.25", 0.25, true},
                         {"mesh-proxy:mesh=original:radius_mm=0.25:tip=centre", 0.25}};

TEST(MeshTips, PlaneFromBothSides) {
  for (const Tip& tip :
       {kTips[0], kTips[1], kTips[2], Tip{"vgraph:mesh=original", 0.0},
        Tip{"vgraph:mesh=original:graph=mesh", 0.0}, Tip{"vgraph:mesh=original:triangles=ring", 0.0}})
    for (const double side : {1.0, -1.0}) {
      SCOPED_TRACE(tip.options);
      const double height = tip.skin ? 0.0 : tip.radius_mm;
      const auto over = [&](double by) { return Vec3(0.3, 0.4, (height + by) * side); };
      const Vec3 to(2.3, -1.4, -1.0 * side), on(2.3, -1.4, height * side);
      Probe probe = make(test::flat_mesh(10, 10.0), tip.options);
      probe.renderer->restart(over(1.1));
      EXPECT_FALSE(probe.to(over(0.01)).contact);
      EXPECT_TRUE(probe.to(over(-0.01)).contact);
      const render::Frame frame = probe.glide(over(-0.01), to, 0.05);
      expect_held(frame, on, 1e-9);
      expect_near(frame.force_n, kStiffness * (on - to), 1e-9);
      EXPECT_FALSE(probe.to(on + Vec3(0, 0, 0.1 * side)).contact);
    }
}

TEST(MeshTips, GrooveHoldsByTwoPlanesAndCornerByThree) {
  for (const Tip& tip : kTips) {
    SCOPED_TRACE(tip.options);
    Probe groove =
        make(test::height_mesh(20, 10.0, [](double x, double) { return std::abs(x); }), tip.options);
    const Vec3 below(0.05, 0.7, -1), beyond(6, 7, 8);
    expect_held(groove.press({0.5, 0.2, 3}, below, 0.05),
                tip.god_object({0, 0.7, tip.radius_mm * std::sqrt(2.0)}, below), 1e-9);
    // Seen from inside, a box's corner holds by three planes.
    Probe corner = make(test::box_mesh(5, 5, 5), tip.options);
    const render::Frame frame = corner.press({0, 0, 0}, beyond, 0.05);
    const Vec3 held = tip.god_object(Vec3::Constant(5 - tip.radius_mm), beyond);
    expect_held(frame, held, 1e-9);
    expect_near(frame.force_n, kStiffness * (held - beyond), 1e-8);
  }
}

/// Along the sinusoid 1.5 mm below it, in steps of `step_mm`: the most that the force turns in one.
double largest_turn(Probe& probe, double step_mm) {
  const auto below = [](double x) { return Vec3(x, 3, test::sinusoid(x, 3) - 1.5); };
  Vec3 last = probe.press({-20, 3, 30}, below(-20), 0.1).force_n;
  double most = 0.0;
  for (double x = -20; x < 20; x += step_mm) {
    const Vec3 force = probe.to(below(x)).force_n;
    most = std::max(most, (force.normalized() - last.normalized()).norm());
    last = force;
  }
  return most;
}

// On facets the force turns at once where the god object crosses an edge, however small the step. Shaded it
// turns there by the second pass alone: the target is put back on to the facet, off the shading normal by the
// square of the sine of the angle between the two, about half of the edge's, on either side. A sphere rests
// on up to three facets, each shaded for itself, and their number changes: 3.1 measured.
TEST(MeshTips, ShadingIsExactOnAPlaneAndSmoothsEdges) {
  for (const auto& [tip, carriers] : {std::pair("mesh-godobject:mesh=original", 1.0),
                                      std::pair("mesh-proxy:mesh=original:radius=0.1", 3.5)}) {
    SCOPED_TRACE(tip);
    const std::string smooth = tip + std::string(":shading=interpolated");
    Probe flat = make(test::flat_mesh(10, 10.0), smooth);
    expect_near(flat.press({0, 0, 5}, {1, 1, -1}, 0.1).force_n, {0, 0, 0.5}, 1e-6);
    const auto coarse = test::height_mesh(30, 50.0, test::sinusoid);
    Probe bare = make(coarse, tip), shaded = make(coarse, smooth);
    const double edge = largest_turn(bare, 0.02), half = std::sin(0.5 * edge);
    EXPECT_GT(edge, 0.05) << "the facets' edges are felt";
    EXPECT_GT(largest_turn(bare, 0.005), 0.9 * edge);
    EXPECT_LT(largest_turn(shaded, 0.02), carriers * 2.0 * half * half);
    EXPECT_LT(largest_turn(shaded, 0.005), carriers * 2.0 * half * half);
  }
}

TEST(MeshTips, MotionAndScaleChangeNothing) {
  const geometry::TriangleMesh mesh =
      test::height_mesh(60, 10.0, [](double x, double y) { return 0.1 * test::sinusoid(10 * x, 10 * y); });
  const geometry::RigidTransform pose{Eigen::Quaterniond(0.4, 0.5, -0.6, 0.2).normalized(),
                                      Vec3(1e4, -3e4, 2e4)};
  for (const char* options : {"mesh-godobject:mesh=original", "mesh-proxy:mesh=original:radius=2"}) {
    SCOPED_TRACE(options);
    Probe still = make(mesh, options), posed = make(mesh, options, pose);
    Probe small = make(test::moved(mesh, {}, 1e-3), options),
          large = make(test::moved(mesh, {}, 1e6), options);
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
      ASSERT_LT((pose.rotate(frame.force_n) - other.force_n).norm(), 1e-6) << i;
      for (const auto& [probe, scale] : {std::pair(&small, 1e-3), {&large, 1e6}}) {
        const render::Frame scaled = probe->to(hip * scale);
        ASSERT_EQ(frame.contact, scaled.contact) << i << " at " << scale;
        ASSERT_LT((frame.god_object_mm - scaled.god_object_mm / scale).norm(), 1e-6) << i << " at " << scale;
      }
    }
    EXPECT_GT(touched, 1000u);
  }
}

// Round an edge the sphere rolls: its centre keeps a radius from the edge.
TEST(MeshProxy, RollsOverEdgesAndLetsGo) {
  Probe probe = make(test::box_mesh(5, 5, 5), sphere(0.5));
  EXPECT_TRUE(probe.press({0, 0, 6}, {4.9, 0, 4.9}, 0.1).contact);
  // The HIP is a hair outside of the edge: the centre lies on the cylinder, in the HIP's direction.
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(probe.to({5.1, 0, 5.1}).contact);
  expect_held(probe.to({5.1, 0, 5.1}), Vec3(5, 0, 5) + 0.5 * Vec3(1, 0, 1).normalized(), 1e-6);
  EXPECT_FALSE(probe.glide({5.1, 0, 5.1}, {6, 0, 4}, 0.05).contact);
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
  EXPECT_FALSE(test::made("mesh-proxy:radius=-1").ok());
}

/// What crosses holds a point alone: asked for beside a sphere it would do nothing.
TEST(MeshProxy, LooksForCrossingsAsAPointAlone) {
  EXPECT_FALSE(test::made("mesh-proxy:mesh=original:crossings=true").ok());
  EXPECT_FALSE(test::made("mesh-proxy:mesh=original:radius=0:radius_mm=1:crossings=true").ok());
  EXPECT_TRUE(test::made("mesh-proxy:mesh=original:radius=0:crossings=true").ok());
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

// The jam test: held still anywhere on a dense mesh, a frictionless proxy comes to rest, and rests where
// the pull is one that the facets it touches can bear. Small meshes.

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

class Jam : public testing::TestWithParam<Tip> {};

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

constexpr Tip kJams[] = {{"mesh-godobject:mesh=original", 0.0},
                         {"mesh-proxy:mesh=original:tip=centre:radius_mm=0.1", 0.1},
                         {"mesh-proxy:mesh=original:tip=centre:radius_mm=0.3", 0.3},
                         {"mesh-proxy:mesh=original:tip=centre:radius_mm=1", 1.0}};
INSTANTIATE_TEST_SUITE_P(Probes, Jam, testing::ValuesIn(kJams), [](const auto& jam) {
  const auto tenths_mm = static_cast<int>(10 * jam.param.radius_mm);
  return tenths_mm == 0 ? std::string("point") : "sphere" + std::to_string(tenths_mm);
});

}  // namespace
}  // namespace palpate::baselines
