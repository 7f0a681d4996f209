// Where planes meet, the god object is the place nearest to the HIP that all of them allow: exact answers for
// corners, ridges, valleys and pits, whatever the mesh's edges do there.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "baselines/mesh/surface_mesh.h"
#include "experiments/stress/shapes.h"
#include "tests/baselines/small_models.h"
#include "toolkit/geometry/half_space_projection.h"

namespace palpate::baselines {
namespace {

using geometry::HalfSpace;
using geometry::RigidTransform;
using geometry::TriangleMesh;
using test::kStiffness;
using test::Probe;

constexpr const char* kPoint = "mesh-godobject:mesh=original:crossings=true";
constexpr const char* kNoRadius = "mesh-proxy:mesh=original:radius=0:crossings=true";
constexpr const char* kSphere = "mesh-proxy:mesh=original:radius_mm=0.5:tip=centre";
constexpr double kRadius = 0.5;

/// Rounding of what is computed on lengths of this size: 2^-40 of them. A place where planes meet at a small
/// angle is known less well.
constexpr double kRounding = 0x1p-40;

/// A square of 2 half by 2 half across an axis, `cells` by `cells`, its middle at `at`.
TriangleMesh axis_sheet(int axis, const Vec3& at, double half, int cells) {
  TriangleMesh mesh = test::flat_mesh(cells, half);
  for (Vec3& v : mesh.vertices_mm) {
    Vec3 p;
    p[axis] = 0.0;
    p[(axis + 1) % 3] = v.x();
    p[(axis + 2) % 3] = v.y();
    v = p + at;
  }
  return mesh;
}

/// One model a part where `apart`, else one mesh.
render::SceneInput scene_of(const std::vector<TriangleMesh>& parts, bool apart,
                            const RigidTransform& pose = {}, double scale = 1.0) {
  render::SceneInput scene;
  if (apart) {
    for (const TriangleMesh& part : parts) {
      scene.models.push_back(test::model_of(test::moved(part, {}, scale)));
      scene.models.back().world_from_model = pose;
    }
    return scene;
  }
  TriangleMesh all;
  for (const TriangleMesh& part : parts) all = test::joined(std::move(all), part);
  scene.models.push_back(test::model_of(test::moved(all, {}, scale)));
  scene.models[0].world_from_model = pose;
  return scene;
}

struct Rests {
  int rests = 0, wrong = 0;
  std::string first;
};

struct Sweep {
  std::vector<HalfSpace> planes;  ///< what the god object keeps to
  Vec3 start;
  std::vector<Vec3> hips;
  double step_mm = 0.05;
  RigidTransform pose{};
  double scale = 1.0;
  double least_sine = 1.0;  ///< of an angle between two planes
};

/// Glides from `start` to each HIP and compares the rest with the projection on the half spaces.
Rests sweep(Probe& probe, const Sweep& s) {
  Rests rests;
  for (const Vec3& local : s.hips) {
    const Vec3 exact_local =
        geometry::nearest_feasible(s.planes, local, kRounding * (1.0 + local.norm()), 0.0).point;
    const Vec3 start = s.pose * Vec3(s.start * s.scale), hip = s.pose * Vec3(local * s.scale),
               exact = s.pose * Vec3(exact_local * s.scale);
    probe.press(start, hip, s.step_mm * s.scale);
    const render::Frame frame = probe.to(hip);
    const double size = (s.scale * (20.0 + local.norm()) + s.pose.translation_mm.norm()) / s.least_sine;
    ++rests.rests;
    if (frame.contact && (frame.god_object_mm - exact).norm() <= kRounding * size &&
        (frame.force_n - kStiffness * (exact - hip)).norm() <= kRounding * size)
      continue;
    if (rests.wrong++ == 0)
      rests.first = fmt::format("HIP {} {} {}: god object {} {} {}, not {} {} {}, contact {}", local.x(),
                                local.y(), local.z(), frame.god_object_mm.x(), frame.god_object_mm.y(),
                                frame.god_object_mm.z(), exact.x(), exact.y(), exact.z(), frame.contact);
  }
  return rests;
}

void expect_right(const Rests& rests) {
  EXPECT_EQ(rests.wrong, 0) << "of " << rests.rests << "; first: " << rests.first;
}

/// Whole numbers under all, some or one of the planes x, y, z >= 0.
std::vector<Vec3> whole_rests() {
  std::vector<Vec3> hips;
  for (int x = -3; x <= 3; ++x)
    for (int y = -3; y <= 3; ++y)
      for (int z = -3; z <= 3; ++z)
        if (x < 0 || y < 0 || z < 0) hips.push_back({double(x), double(y), double(z)});
  return hips;
}

std::vector<Vec3> random_rests(Random& random, int count) {
  std::vector<Vec3> hips;
  while (static_cast<int>(hips.size()) < count) {
    const Vec3 p(6 * random.uniform() - 3, 6 * random.uniform() - 3, 6 * random.uniform() - 3);
    if (p.minCoeff() < -0.01) hips.push_back(p);
  }
  return hips;
}

/// The octant that keeps a sphere's centre a radius away.
std::vector<HalfSpace> octant(double radius) {
  return {{Vec3::UnitX(), radius}, {Vec3::UnitY(), radius}, {Vec3::UnitZ(), radius}};
}
const std::vector<HalfSpace> kOctant = octant(0.0);

/// Three planes through the origin; `shift` moves each in itself, so that vertices meet vertices or not.
std::vector<TriangleMesh> three_planes(double half, int cells, double shift) {
  std::vector<TriangleMesh> planes;
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 at = Vec3::Zero();
    at[(axis + 1) % 3] = shift;
    at[(axis + 2) % 3] = 1.7 * shift;
    planes.push_back(axis_sheet(axis, at, half, cells));
  }
  return planes;
}

TEST(MeshCorner, ThreePlanesHoldJointly) {
  const struct {
    const char* options;
    double radius, step;
  } probes[] = {{kPoint, 0.0, 0.05},
                {kPoint, 0.0, 20.0},
                {kNoRadius, 0.0, 0.05},
                {kNoRadius, 0.0, 20.0},
                {kSphere, kRadius, 0.3}};
  for (const auto& [options, radius, step] : probes)
    for (const bool apart : {true, false})
      for (const double shift : {0.0, 0.3}) {
        SCOPED_TRACE(fmt::format("{}, {}, shift {}, steps of {}", options, apart ? "models" : "one mesh",
                                 shift, step));
        Probe probe = test::prepare(scene_of(three_planes(8, 16, shift), apart), options);
        expect_right(sweep(probe, {octant(radius), {2.2, 1.9, 2.6}, whole_rests(), step}));
      }
}

/// `count` triangles around `at`, across an axis.
TriangleMesh fan(int axis, const Vec3& at, double radius, int count) {
  TriangleMesh mesh;
  mesh.vertices_mm.push_back(at);
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    Vec3 p = at;
    p[(axis + 1) % 3] += radius * std::cos(angle);
    p[(axis + 2) % 3] += radius * std::sin(angle);
    mesh.vertices_mm.push_back(p);
    const auto a = static_cast<std::uint32_t>(1 + i), b = static_cast<std::uint32_t>(1 + (i + 1) % count);
    mesh.triangles.push_back({0, a, b});
  }
  return mesh;
}

// Forty facets in one plane meet where the probe rests, on each of three models.
TEST(MeshCorner, NoPlaneIsCrowdedOutByFacetsOfAnother) {
  std::vector<TriangleMesh> fans;
  for (int axis = 0; axis < 3; ++axis) fans.push_back(fan(axis, Vec3::Zero(), 9.0, 40));
  for (const RigidTransform& pose :
       {RigidTransform{}, RigidTransform{Eigen::Quaterniond(0.5, -0.5, 0.1, 0.7).normalized(), {1, 2, 3}}}) {
    Probe probe = test::prepare(scene_of(fans, true, pose), kPoint);
    Sweep s{kOctant, {0.7, 0.9, 0.8}, whole_rests(), 0.05};
    s.pose = pose;
    expect_right(sweep(probe, s));
  }
}

// The same turned, moved away and scaled, at random places.
TEST(MeshCorner, ThreePlanesHoldWhereverTheyAreAndHoweverLarge) {
  Random random(11);
  for (const bool apart : {true, false})
    for (const double scale : {1e-3, 1.0, 1e6}) {
      const Eigen::Quaterniond turn =
          Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal()).normalized();
      const RigidTransform pose{turn, scale * Vec3(31.0, -77.0, 12.0)};
      for (const double shift : {0.0, 0.3}) {
        SCOPED_TRACE(fmt::format("{}, scale {}, shift {}", apart ? "models" : "one mesh", scale, shift));
        Probe probe = test::prepare(scene_of(three_planes(8, 16, shift), apart, pose, scale), kPoint);
        Sweep s{kOctant, {2.2, 1.9, 2.6}, random_rests(random, 40), 0.1};
        s.pose = pose;
        s.scale = scale;
        expect_right(sweep(probe, s));
        s.hips = whole_rests();
        expect_right(sweep(probe, s));
      }
    }
}

/// A square of 2 half by 2 half across `normal`, `cells` by `cells`, its middle at `at`.
TriangleMesh sheet(const Vec3& normal, const Vec3& at, double half, int cells) {
  const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), normal);
  return test::moved(test::flat_mesh(cells, half), {turn, at});
}

/// Planes through the origin that hold from below, each an oblique sheet of its own.
struct Pit {
  std::vector<HalfSpace> planes;
  std::vector<TriangleMesh> sheets;
};
Pit pit_of(const std::vector<Vec3>& normals, double half, int cells) {
  Pit pit;
  for (const Vec3& n : normals) {
    pit.planes.push_back({n.normalized(), 0.0});
    pit.sheets.push_back(sheet(n.normalized(), Vec3::Zero(), half, cells));
  }
  return pit;
}

// Three oblique planes, four in a pyramid's pit, two in obtuse valleys: every sheet goes through all others.
TEST(MeshCorner, ObliquePitsAndValleys) {
  Random random(12);
  const std::vector<std::vector<Vec3>> shapes{
      {{1, 0.2, 1}, {-1, 0.4, 1}, {0.1, -1, 1}},
      {{1, 0, 1}, {-1, 0, 1}, {0, 1, 1}, {0, -1, 1}},
      {{0.2, 0, 1}, {-0.2, 0.03, 1}},
      {{0.05, 0, 1}, {-0.05, 0.01, 1}, {0, 0.06, 1}},
  };
  for (std::size_t shape = 0; shape < shapes.size(); ++shape)
    for (const bool apart : {true, false}) {
      SCOPED_TRACE(fmt::format("shape {}, {}", shape, apart ? "models" : "one mesh"));
      const Pit pit = pit_of(shapes[shape], 9, 18);
      std::vector<Vec3> hips;
      for (const Vec3& p : random_rests(random, 120))
        if (p.z() < -0.2) hips.push_back(p);
      Probe probe = test::prepare(scene_of(pit.sheets, apart), kPoint);
      Sweep s{pit.planes, {0.1, 0.2, 4.0}, hips, 0.05};
      for (const HalfSpace& a : pit.planes)
        for (const HalfSpace& b : pit.planes)
          if (&a != &b) s.least_sine = std::min(s.least_sine, a.normal.cross(b.normal).norm());
      expect_right(sweep(probe, s));
    }
}

/// z = 0, x = 0 and y = 0, from `low` to `high` along the other two, each cut into its own number of cells.
std::vector<TriangleMesh> uneven_planes(double low, double high, std::array<int, 3> cells) {
  std::vector<TriangleMesh> planes;
  const double half = 0.5 * (high - low), middle = 0.5 * (high + low);
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 at = Vec3::Constant(middle);
    at[axis] = 0.0;
    planes.push_back(axis_sheet(axis, at, half, cells[static_cast<std::size_t>(axis)]));
  }
  return planes;
}

// Sheets of one mesh whose edges lie in one another, and walls that stand on a floor, straight and turned:
// no vertices are shared, or only some.
TEST(MeshCorner, SheetsOfOneMeshThatMeetWithoutSharingVertices) {
  Random random(13);
  const std::array<std::array<int, 3>, 4> cuts{{{16, 16, 16}, {16, 10, 12}, {7, 9, 11}, {16, 4, 1}}};
  for (const auto& cut : cuts)
    for (const bool turned : {false, true}) {
      RigidTransform pose;
      if (turned)
        pose.rotation = Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
                            .normalized();
      const auto through = uneven_planes(-8.0, 8.0, cut), quarter = uneven_planes(0.0, 8.0, cut);
      const std::vector<std::pair<const char*, std::vector<TriangleMesh>>> rooms{
          {"through one another", through},
          {"end at one another", quarter},
          {"walls on a floor", {quarter[0], quarter[1], through[2]}}};
      for (const auto& [name, parts] : rooms) {
        SCOPED_TRACE(fmt::format("{}, cells {} {} {}, {}", name, cut[0], cut[1], cut[2],
                                 turned ? "turned" : "straight"));
        std::vector<TriangleMesh> placed;
        for (const TriangleMesh& part : parts) placed.push_back(test::moved(part, pose));
        Probe probe = test::prepare(scene_of(placed, false), kPoint);
        // What ends ends there: a HIP beyond is free.
        std::vector<Vec3> hips;
        for (const Vec3& p : whole_rests())
          if (&parts == &rooms[0].second || p.maxCoeff() < 0.0) hips.push_back(p);
        Sweep s{kOctant, {2.2, 1.9, 2.6}, hips, 0.05};
        s.pose = pose;
        expect_right(sweep(probe, s));
      }
    }
}

// Corners of very many facets, as turned bodies have them on their axis: exact answers as far as a frame
// looks at all of them, and a warning beyond.

constexpr const char* kPointsOnFans[] = {"mesh-godobject:mesh=original", "mesh-proxy:mesh=original:radius=0"};
/// Rounding on lengths of some 20 mm, in a god object that many facets decide.
constexpr double kFanRoundingMm = 1e-9;

/// A profile that is not divided: one facet between two corners.
constexpr double kUndivided = 1e9;
TriangleMesh turned_body(const std::vector<experiments::OnProfile>& profile, int count) {
  return experiments::turned_mesh(profile, kUndivided, count);
}

/// A cylinder with a deep narrow pit from above, its bottom at the origin.
TriangleMesh body_with_pit(int count) {
  return turned_body({{0, -6}, {8, -6}, {8, 10}, {2, 10}, {0, 0}}, count);
}

// Below the bottom of a pit the god object stays there, wherever the HIP goes: each of the facets holds it.
TEST(MeshFan, ThePitOfAFunnelHolds) {
  for (const char* options : kPointsOnFans)
    for (const int count : {400, 1000}) {
      SCOPED_TRACE(std::string(options) + ", facets " + std::to_string(count));
      Probe probe = test::make(body_with_pit(count), options);
      EXPECT_TRUE(probe.report.warnings.empty()) << probe.report.warnings.front();
      constexpr int kWays = 36;
      for (int k = 0; k < kWays; ++k) {
        const double angle = 2.0 * std::numbers::pi * (k + 0.3) / kWays;
        const Vec3 start(0.01, 0.02, 15.0), below(0.01, 0.02, -1.0),
            beside(1.7 * std::cos(angle), 1.7 * std::sin(angle), -1.0);
        ASSERT_TRUE(probe.press(start, below, 0.05).contact) << k;
        const render::Frame frame = probe.glide(below, beside, 0.05);
        ASSERT_TRUE(frame.contact) << k;
        test::expect_near(frame.god_object_mm, Vec3::Zero(), kFanRoundingMm);
        test::expect_near(frame.force_n, -kStiffness * beside, kFanRoundingMm);
        EXPECT_FALSE(probe.glide(beside, below, 0.05).force_n.z() < 0.0);
        EXPECT_FALSE(probe.glide(below, start, 0.05).contact) << k;
      }
    }
}

// Under the tip of a blunt cone the HIP goes from one side to the other in one frame: the god object follows
// to the facet that is nearest there.
TEST(MeshFan, TheTipOfABluntConeIsGoneOver) {
  constexpr int kCount = 1000;
  const Vec3 tip(0, 0, 2);
  std::vector<Vec3> normals;
  const auto corner = [](int k) {
    const double angle = 2.0 * std::numbers::pi * k / kCount;
    return Vec3(6.0 * std::cos(angle), 6.0 * std::sin(angle), 0.0);
  };
  for (int k = 0; k < kCount; ++k)
    normals.push_back((corner(k) - tip).cross(corner(k + 1) - tip).normalized());
  for (const char* options : kPointsOnFans) {
    SCOPED_TRACE(options);
    Probe probe = test::make(turned_body({{0, -2}, {6, -2}, {6, 0}, {0, 2}}, kCount), options);
    constexpr int kWays = 24;
    for (int k = 0; k < kWays; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k + 0.4) / kWays;
      const Vec3 across(0.5 * std::cos(angle), 0.5 * std::sin(angle), 0.0), down(0, 0, 1.5);
      ASSERT_TRUE(probe.press(down + across + Vec3(0, 0, 4), down + across, 0.05).contact);
      // A walk of half the fan may take a frame more than one.
      probe.to(down - across);
      const render::Frame frame = probe.to(down - across);
      ASSERT_TRUE(frame.contact) << k;
      double nearest = std::numeric_limits<double>::max();
      for (const Vec3& n : normals) nearest = std::min(nearest, std::abs(n.dot(down - across - tip)));
      EXPECT_NEAR((frame.god_object_mm - (down - across)).norm(), nearest, kFanRoundingMm) << k;
    }
  }
}

// What is more than a frame looks at is said before the first one.
TEST(MeshFan, MoreThanAFrameLooksAtIsWarnedOf) {
  constexpr int kCount = 3 * static_cast<int>(kMaxFan);
  Probe probe = test::make(body_with_pit(kCount), kPointsOnFans[0]);
  ASSERT_EQ(probe.report.warnings.size(), 1u);
  EXPECT_NE(
      probe.report.warnings.front().find(std::to_string(kCount) + " of the mesh's faces meet at one vertex"),
      std::string::npos)
      << probe.report.warnings.front();
  // Far from the axis nothing is lost.
  const Vec3 above(5.1, 0.3, 14.0), inside(5.1, 0.3, 9.6);
  test::expect_near(probe.press(above, inside, 0.05).force_n, Vec3(0, 0, 0.4 * kStiffness), kFanRoundingMm);
}

}  // namespace
}  // namespace palpate::baselines
