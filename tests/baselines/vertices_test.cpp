// `cloud-vertices`: planes at every point against the truth, what may not be felt of how boxes are found, and
// creases: grooves, corners of three planes and ridges against the surface they were taken from.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/replay.h>
#include "baselines/rivals.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"

namespace palpate::baselines::vertices {

using namespace render;

namespace {

test::Stepped ready(const SceneInput& scene, const std::string& spec) {
  Registry registry;
  register_toolkit_renderers(registry);
  registry.add(cloud_vertices_info());
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  (void)test::value_of(renderer->prepare(scene, {1, nullptr}));
  return renderer;
}

std::vector<Frame> run(const test::Stepped& renderer, const std::vector<Vec3>& path) {
  std::vector<Frame> frames;
  renderer->restart(path.front());
  for (const Vec3& h : path) frames.push_back(renderer->step(h, 1e-3));
  return frames;
}

struct Ran {
  std::string hash;
  FrameCounters counters;
  std::size_t contacts = 0;
};

struct Setting {
  Setting(const std::string& model, const std::string& way)
      : scene(generated(model)), path(path_over(scene, way)) {}
  Scene scene;
  trace::ProbePath path;
};

Ran run(const Setting& setting, const std::string& spec) {
  Ran ran;
  const auto renderer = ready(setting.scene.input, spec);
  const trace::ForceTrace trace = trace::replay(*renderer, setting.path).value();
  ran.hash = trace::trace_hash(trace);
  ran.counters = renderer->counters();
  for (const Frame& frame : trace.frames) ran.contacts += frame.contact;
  return ran;
}

TEST(CloudVertices, AnyPartitionDrivesItToTheSameTrace) {
  const std::vector<std::pair<std::string, std::string>> settings = {
      {"sinusoid:points=10000", "weave:frames=4000"},
      {"sinusoid:points=10000:jitter=0.4:nonuniform=0.5", "exploration:frames=6000"},
      {"sphere:points=8000", "weave:frames=4000"},
      {"slab:points=8000", "exploration:frames=6000"},
      {"wedge:points=4000:scale=1e-3", "weave:frames=4000:depth_mm=2e-3:clearance_mm=4e-4:speed_mm_s=0.05"},
      {"torus:points=8000:scale=1e6", "weave:frames=4000:depth_mm=2e6:clearance_mm=4e5:speed_mm_s=5e7"},
  };
  for (const auto& [model, path] : settings) {
    const Setting made(model, path);
    for (const std::string box : {"global", "per-vertex"}) {
      const Ran grid = run(made, "cloud-vertices:box=" + box);
      EXPECT_GT(grid.contacts, 0u) << model;
      EXPECT_LT(grid.contacts, made.path.size()) << model;
      for (const std::string other : {"octree", "quadtree"}) {
        const Ran tree = run(made, "cloud-vertices:box=" + box + ":partition=" + other);
        EXPECT_EQ(tree.hash, grid.hash) << model << " " << path << " " << other << " " << box;
        EXPECT_EQ(tree.contacts, grid.contacts) << model;
        // Ten points a leaf instead of some twenty-five a cell: far fewer boxes are looked at.
        EXPECT_LT(tree.counters.box_tests, grid.counters.box_tests) << model << " " << other;
      }
    }
  }
}

// The side of a contact is judged by planes, so finding a sheet earlier changes nothing but the work.
TEST(CloudVertices, ASweptSphereFindsMoreBoxesAndChangesNoFrame) {
  const Setting made("sinusoid:points=10000", "weave:frames=4000");
  const Ran box = run(made, "cloud-vertices");
  EXPECT_EQ(box.counters.sphere_only, 0u);
  std::uint64_t last = 0;
  for (const std::string sphere : {"0.05", "0", "2"}) {
    const Ran swept = run(made, "cloud-vertices:test=swept-sphere:sphere_mm=" + sphere);
    EXPECT_EQ(swept.hash, box.hash) << sphere;
    EXPECT_GT(swept.counters.sphere_only, last) << sphere;
    EXPECT_GE(swept.counters.box_tests, box.counters.box_tests) << sphere;
    last = swept.counters.sphere_only;
  }
  const Ran tree = run(made, "cloud-vertices:test=swept-sphere:partition=octree");
  EXPECT_EQ(tree.hash, box.hash);
  EXPECT_GT(tree.counters.sphere_only, 0u);
}

TEST(CloudVertices, CellsOfUnevenCloudsHoldFewPointsAndChangeNoFrame) {
  // One sparse place decides the resolution of a whole cloud.
  Scene scene = generated("sinusoid:points=10000:extent_mm=40:amplitude_mm=2:wavelength_mm=40");
  const cloud::Cloud& even = *scene.input.models[0].cloud;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < even.size(); ++i) {
    const Vec3 p = even.point_mm(i);
    if (p.x() < 14.0 || p.y() < 14.0 || i % 16 == 0) points.push_back(p);
  }
  const SceneInput uneven = cloud_of(points);
  paths::PathTarget target;
  target.cloud = uneven.models[0].cloud.get();
  target.box_mm = target.cloud->box_mm();
  const trace::ProbePath path =
      paths::make_path(parse_named_options("exploration:frames=20000:seed=2").value(), target).value();
  std::vector<FrameCounters> counters;
  std::vector<std::vector<Frame>> frames;
  for (const char* spec : {"cloud-vertices:cell=5", "cloud-vertices"}) {
    const auto renderer = ready(uneven, spec);
    frames.push_back(run(renderer, path.hip_mm));
    counters.push_back(renderer->counters());
  }
  for (std::size_t i = 0; i < frames[0].size(); ++i)
    ASSERT_EQ(frames[0][i].force_n, frames[1][i].force_n) << i;
  EXPECT_EQ(counters[0].bound_hits + counters[1].bound_hits, 0u);
  EXPECT_LT(3 * counters[1].box_tests, counters[0].box_tests);
}

// Unshaded, on the eight nearest. On steep jittered parts planes turn from point to point as at an edge,
// where the god object keeps to its face, and the eight nearest in space need not surround a point: it may
// stop beside the nearest one of all.
TEST(CloudVertices, GodObjectIsTheNearestPointOfAll) {
  for (const auto& [spec, most_farther] :
       {std::pair("sinusoid:points=2601", 0.0), std::pair("saddle:points=2601", 0.0),
        std::pair("sphere:points=3000", 0.0), std::pair("sinusoid:points=2601:jitter=0.4", 0.02)}) {
    SCOPED_TRACE(spec);
    const Scene scene = generated(spec);
    const cloud::Cloud& points = *scene.input.models[0].cloud;
    const trace::ProbePath path = path_over(scene, "weave:frames=3000:depth_mm=1");
    const auto renderer = ready(scene.input, "cloud-vertices:neighbours=exact-knn:shading=none");
    renderer->restart(path.hip_mm[0]);
    int contacts = 0, farther = 0;
    for (const Vec3& hip : path.hip_mm) {
      const Frame frame = renderer->step(hip, 1e-3);
      if (!frame.contact) continue;
      ++contacts;
      double nearest = std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < points.size(); ++i)
        nearest = std::min(nearest, (points.point_mm(i) - hip).norm());
      farther += (frame.god_object_mm - hip).norm() > nearest * (1.0 + 1e-12);
    }
    EXPECT_GT(contacts, 1500);
    EXPECT_LE(farther, most_farther * contacts);
  }
}

TEST(CloudVertices, PermutedPointsAnswerTheSame) {
  const Scene scene = generated("sinusoid:points=10201:jitter=0.3");
  auto shuffled = std::make_shared<cloud::Cloud>(*scene.input.models[0].cloud);
  shuffled->raster.reset();
  Random random(9);
  for (std::size_t i = shuffled->size(); i > 1; --i) {
    const std::size_t j = random.below(i);
    std::swap(shuffled->x_mm[i - 1], shuffled->x_mm[j]);
    std::swap(shuffled->y_mm[i - 1], shuffled->y_mm[j]);
    std::swap(shuffled->z_mm[i - 1], shuffled->z_mm[j]);
  }
  SceneInput other = scene.input;
  other.models[0].cloud = shuffled;
  const trace::ProbePath path = path_over(scene, "weave:frames=3000");
  const auto a = ready(scene.input, "cloud-vertices:neighbours=exact-knn"),
             b = ready(other, "cloud-vertices:neighbours=exact-knn");
  EXPECT_EQ(trace::trace_hash(trace::replay(*a, path).value()),
            trace::trace_hash(trace::replay(*b, path).value()));
}

TEST(CloudVertices, ALonePointLetsGoWhenTheProbeLeavesSideways) {
  const auto cloud = ready(cloud_of({Vec3(0, 0, 0)}), "cloud-vertices:box_mm=2");
  cloud->restart(Vec3(0, 0, 5));
  EXPECT_TRUE(glide(cloud, Vec3(0, 0, 5), Vec3(0, 0, -0.5), 55).contact);
  EXPECT_FALSE(glide(cloud, Vec3(0, 0, -0.5), Vec3(10, 0, -0.5), 100).contact);
}

// A pile of more boxes than one frame may test: the touch comes a few frames later; every such frame says so.
TEST(CloudVertices, WorkPastTheBoundIsDoneInTheNextFrame) {
  std::vector<Vec3> points;
  Random random(4);
  for (int i = 0; i < 60000; ++i)
    points.emplace_back(random.uniform(), random.uniform(), 1e-3 * random.uniform());
  points.emplace_back(40, 40, 0);  // a far pair makes the resolution, so all the rest is in one cell
  points.emplace_back(44, 40, 0);
  const auto cloud = ready(cloud_of(points), "cloud-vertices:neighbours=exact-knn");
  cloud->restart(Vec3(0.5, 0.5, 100));
  Frame f = cloud->step(Vec3(0.5, 0.5, -1), 1e-3);
  int frames = 1;
  while (!f.contact && frames < 200) {
    EXPECT_EQ(f.status, FrameStatus::kBoundHit);
    f = cloud->step(Vec3(0.5, 0.5, -1), 1e-3);
    ++frames;
  }
  EXPECT_TRUE(f.contact);
  EXPECT_GT(frames, 3);
  EXPECT_GT(cloud->counters().bound_hits, 0u);
}

// In by the hole and out through the surface: everything is as it was before.
TEST(CloudVertices, AHoleDoesNotTurnItInsideOut) {
  constexpr double kRadius = 50.0;
  const Scene whole = generated("sphere:points=20000:extent_mm=100");
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < whole.input.models[0].cloud->size(); ++i) {
    const Vec3 p = whole.input.models[0].cloud->point_mm(i);
    if (p.x() < 0.98 * kRadius) points.push_back(p);  // the hole is 20 mm wide
  }
  const auto cloud = ready(cloud_of(points), "cloud-vertices");
  const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), above(0, 0.3, kRadius + 5);
  cloud->restart(before);
  EXPECT_FALSE(glide(cloud, before, middle).contact);
  EXPECT_FALSE(glide(cloud, middle, above).contact);
  const Frame frame = glide(cloud, above, Vec3(0, 0.3, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  // 1 mm deep at the default 0.5 N/mm. A facet lies below the sphere, by no more than the square of its
  // corners' distance from its middle over the diameter, and is tilted by that distance over the radius. The
  // corners are neighbours, whose triangles the spacing spans.
  const double spacing = std::sqrt(4.0 * std::numbers::pi * kRadius * kRadius / 20000.0);
  EXPECT_GT(frame.force_n.norm(), 0.5 * (1.0 - spacing * spacing / (2.0 * kRadius)));
  EXPECT_LT(frame.force_n.norm(), 0.5 * 1.0001);
  const Vec3 outward = Vec3(0, 0.3, kRadius - 1).normalized();
  EXPECT_LT((frame.force_n.normalized() - outward).norm(), spacing / kRadius);
}

// A change of point moves the force by stiffness x the largest spacing: just under what is felt nothing is
// shaded, just over it everything that asks for it is.
TEST(CloudVertices, ShadingTurnsExactlyWhereAStepIsFelt) {
  Scene scene = generated("sinusoid:points=2601");
  const auto decided = [&] {
    Registry registry;
    registry.add(cloud_vertices_info());
    return registry.make("cloud-vertices", {}).value()->decide(scene.input, {1, nullptr}).value().models[0];
  };
  const double spacing_mm = decided().spacing_mm.value();
  for (const double share : {0.2, 0.999999, 1.000001, 5.0}) {
    scene.input.models[0].surface.stiffness_n_per_mm = share * kPerceptibleForceStepN / spacing_mm;
    const ModelDecisions said = decided();
    const auto shading = std::find_if(said.decisions.begin(), said.decisions.end(),
                                      [](const Decision& d) { return d.about == "shading"; });
    ASSERT_NE(shading, said.decisions.end());
    EXPECT_EQ(shading->choice, share > 1.0 ? "facet, where a point's spacing asks for it" : "none") << share;
  }
}

// However fine cells are asked for and however large boxes: a segment spans 64 cells, and a box reaches one
// beyond, which is (64 + 4) x 5 x 5 with the borders that rounding touches.
TEST(CloudVertices, FineCellsAreNoMoreThanAFrameMayLookAt) {
  constexpr std::uint64_t kMostCells = 68 * 5 * 5;
  Random random(53);
  std::vector<Vec3> points;
  for (int i = 0; i < 2000; ++i)
    points.push_back(Vec3{random.uniform(-10.0, 10.0), random.uniform(-10.0, 10.0), 0.1 * random.uniform()});
  for (const std::string text : {"cloud-vertices:cell=0.02", "cloud-vertices:box_mm=20",
                                 "cloud-vertices:test=swept-sphere:sphere_mm=15"}) {
    SCOPED_TRACE(text);
    const auto renderer = ready(cloud_of(points), text);
    renderer->restart(Vec3(0, 0, 40));
    std::uint64_t before = 0;
    for (int k = 1; k <= 200; ++k) {
      const Vec3 hip{random.uniform(-12.0, 12.0), random.uniform(-12.0, 12.0), random.uniform(-5.0, 5.0)};
      (void)renderer->step(hip, 1e-3);
      const std::uint64_t now = renderer->counters().cells_visited;
      ASSERT_LE(now - before, kMostCells) << "frame " << k;
      before = now;
    }
    EXPECT_GT(before, 0u);
  }
}

// ---- Creases.

constexpr double kStiffness = 0.5;  // N/mm, every scene's here
constexpr double kScales[] = {1e-3, 1.0, 1e6};
/// Coordinates are floats, of a scene 30 units wide; some facets' planes magnify that by depth over spacing.
constexpr double kStored = 30.0 * 16.0 * kUnitRoundoffFloat;

std::string wedge(double angle_deg, double scale) {
  return "wedge:angle_deg=" + std::to_string(angle_deg) +
         ":extent_mm=12:spacing_mm=0.2:scale=" + std::to_string(scale);
}

std::vector<Vec3> straight(const std::vector<Vec3>& corners, double step, double scale) {
  std::vector<Vec3> path;
  for (std::size_t c = 0; c + 1 < corners.size(); ++c) {
    const Vec3 way = corners[c + 1] - corners[c];
    const int steps = static_cast<int>(std::ceil(way.norm() / step));
    for (int i = 0; i < steps; ++i) path.emplace_back(scale * (corners[c] + way * i / steps));
  }
  path.emplace_back(scale * corners.back());
  return path;
}

/// Along a flank of the wedge z = rise |x| at a depth along the normal, over the edge or the bottom, and
/// along the other.
std::vector<Vec3> across(double rise, double depth, double scale, double step = 0.02) {
  const double below = depth * std::sqrt(1.0 + rise * rise);
  return straight({{-4.0, 0.13, 4.0 * rise + 1.0},
                   {-3.0, 0.23, 3.0 * rise - below},
                   {0.0, 0.53, -below},
                   {3.0, 0.83, 3.0 * rise - below},
                   {4.0, 0.93, 4.0 * rise + 1.0}},
                  step, scale);
}

std::vector<Frame> run(const Scene& scene, const std::string& spec, const std::vector<Vec3>& path) {
  return run(ready(scene.input, spec), path);
}

/// The largest change of force from frame to frame, over the stiffness and the way of the HIP.
double steepest(const std::vector<Frame>& frames, const std::vector<Vec3>& path) {
  double worst = 0.0;
  for (std::size_t i = 1; i < frames.size(); ++i)
    if (frames[i].contact && frames[i - 1].contact)
      worst = std::max(worst, (frames[i].force_n - frames[i - 1].force_n).norm() /
                                  (kStiffness * (path[i] - path[i - 1]).norm()));
  return worst;
}

TEST(Crease, GrooveHoldsByBothFlanks) {
  const double rise = 1.0 / std::sqrt(3.0);  // 120 degrees open
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const Scene scene = generated(wedge(240, s));
    for (const double depth : {0.3, 1.0, 2.0}) {
      const std::vector<Vec3> path = across(rise, depth, s);
      const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                               truth = run(scene, "analytic", path);
      std::size_t held = 0;
      for (std::size_t i = 0; i < path.size(); ++i) {
        if (!truth[i].contact || -path[i].z() + rise * std::abs(path[i].x()) < 0.2 * s) continue;
        ASSERT_TRUE(frames[i].contact) << i;
        ASSERT_LE((frames[i].force_n - truth[i].force_n).norm(), kStored * kStiffness * s)
            << i << " " << depth;
        held += truth[i].god_object_mm.x() == 0.0;
      }
      EXPECT_GT(held, 10u);
      // The free space is convex: its nearest place moves no faster than the HIP, nor does the force.
      EXPECT_LE(steepest(frames, path), 1.0 + 1e-3) << depth;
    }
  }
}

TEST(Crease, GrooveBetweenThePointsIsOffByNoMoreThanItsFacets) {
  // A column of points on either side of the bottom, half a spacing from it, jittered ones up to 0.7: the
  // facets between them bridge it, and no place of theirs is farther from it than these points.
  const double rise = 1.0 / std::sqrt(3.0), slant = std::sqrt(1.0 + rise * rise);
  for (const auto& [more, bridge] : {std::pair{"", 0.5 * slant}, std::pair{":jitter=0.2", 0.7 * slant}}) {
    SCOPED_TRACE(more);
    const Scene scene = generated("wedge:angle_deg=240:extent_mm=12.2:spacing_mm=0.2" + std::string(more));
    ASSERT_EQ(scene.input.models[0].cloud->size(), 62u * 62u);
    const std::vector<Vec3> path = across(rise, 1.0, 1.0);
    const std::vector<Frame> frames = run(scene, "cloud", path), truth = run(scene, "analytic", path);
    double worst = 0.0, single = 0.0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      if (!truth[i].contact || truth[i].god_object_mm.x() != 0.0) continue;
      worst = std::max(worst, (frames[i].force_n - truth[i].force_n).norm());
      // One flank alone would be wrong by this at the bottom.
      const Vec3 flank = Vec3(-0.5, 0.0, std::sqrt(0.75));
      single = std::max(single, (kStiffness * -flank.dot(path[i]) * flank - truth[i].force_n).norm());
    }
    EXPECT_LE(worst, kStiffness * 0.2 * bridge + 1e-6);
    EXPECT_GT(single, 3.0 * worst);
  }
}

/// Three faces of a cube seen from inside, points `step` apart: free where x, y and z are positive.
std::vector<Vec3> corner_points(double step, int side) {
  std::vector<Vec3> points;
  for (int i = 0; i <= side; ++i)
    for (int j = 0; j <= side; ++j) {
      points.emplace_back(i * step, j * step, 0.0);
      if (j > 0) points.emplace_back(i * step, 0.0, j * step);
      if (i > 0 && j > 0) points.emplace_back(0.0, i * step, j * step);
    }
  return points;
}

TEST(Crease, CornerHoldsByThreePlanes) {
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const SceneInput scene = cloud_of(corner_points(0.2 * s, 30));
    const auto cloud = ready(scene, "cloud-vertices:shading=facet");
    // Down into the corner, then about below it: on a face, on an edge between two, in the corner itself.
    std::vector<Vec3> path = straight({{2, 2, 2}, {-0.5, -0.5, -0.5}}, 0.02, s);
    for (int i = 0; i < 4000; ++i) {
      const double t = 0.002 * i;
      path.emplace_back(s * (Vec3(-0.5, -0.5, -0.5) +
                             Vec3(0.8 * std::sin(3 * t), 0.8 * std::sin(2 * t), 0.7 * std::sin(5 * t))));
    }
    const std::vector<Frame> frames = run(cloud, path);
    std::size_t by_planes[4] = {};
    for (std::size_t i = 0; i < path.size(); ++i) {
      const Vec3 truth = kStiffness * (path[i].cwiseMax(0.0) - path[i]);
      if (truth.norm() < 0.2 * s * kStiffness) continue;  // within a spacing of the surface
      ASSERT_TRUE(frames[i].contact) << i;
      ASSERT_LE((frames[i].force_n - truth).norm(), kStored * kStiffness * s)
          << i << " " << path[i].transpose();
      ++by_planes[(path[i].array() < 0.0).count()];
    }
    EXPECT_GT(by_planes[1], 5u);
    EXPECT_GT(by_planes[2], 100u);
    EXPECT_GT(by_planes[3], 500u);
    EXPECT_LE(steepest(frames, path), 1.0 + 1e-3);
  }
}

TEST(Crease, RidgeKeepsTheGodObjectOnItsFaceUpToTheEdge) {
  const double fall = -1.0 / std::sqrt(3.0);  // 120 degrees of material
  for (const double s : kScales) {
    SCOPED_TRACE(s);
    const Scene scene = generated(wedge(120, s));
    const std::vector<Vec3> path = across(fall, 0.5, s);
    const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                             truth = run(scene, "analytic", path);
    std::size_t contacts = 0, turned = 0;
    for (std::size_t i = 0; i < path.size(); ++i) {
      if (!truth[i].contact || std::abs(path[i].x()) > 2.0 * s) continue;
      ++contacts;
      turned += !((frames[i].force_n - truth[i].force_n).norm() <= kStored * kStiffness * s);
    }
    EXPECT_GT(contacts, 200u);
    EXPECT_LE(turned, 1u);  // the frame in which it passes the edge may be a rounding early or late
  }
}

TEST(Crease, AlongARidgeTheGodObjectFollowsOnItsFace) {
  // Past the points nearest to the HIP, before the edge: the god object goes along the edge with the HIP.
  const Scene scene = generated(wedge(120, 1.0));
  const std::vector<Vec3> path = straight(
      {{-2, -3, 0}, {-1, -3, -0.1}, {0.2, -3, -0.7}, {0.2, 3, -0.7}, {0.3, 3, -0.75}, {0.3, -3, -0.75}}, 0.02,
      1.0);
  const std::vector<Frame> frames = run(scene, "cloud-vertices:shading=facet", path),
                           truth = run(scene, "analytic", path);
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (!truth[i].contact || truth[i].force_n.norm() < 0.2 * kStiffness) continue;
    ++contacts;
    ASSERT_LE((frames[i].force_n - truth[i].force_n).norm(), kStored * kStiffness) << i;
  }
  EXPECT_GT(contacts, 500u);
}

}  // namespace
}  // namespace palpate::baselines::vertices
