// The point renderers against oracles, on generated, degenerate and hostile data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/random.h"
#include "toolkit/metrics/accuracy.h"
#include "toolkit/metrics/reference.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/walkable.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/sheet.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/replay.h"

namespace palpate::render {
namespace {

std::string hash_of(HapticRenderer& renderer, const trace::ProbePath& path) {
  const Result<trace::ForceTrace> trace = trace::replay(renderer, path);
  if (!trace) throw std::runtime_error(trace.error().message());
  return trace::trace_hash(*trace);
}

metrics::Accuracy scored(const Scene& scene, const trace::ProbePath& path, HapticRenderer& renderer) {
  const ModelInput& model = scene.input.models[0];
  auto reference = metrics::analytic_reference(*scene.surface, path, model.surface.stiffness_n_per_mm, 0,
                                               model.world_from_model)
                       .value();
  EXPECT_TRUE(metrics::fill_local_resolution(
      reference, path, *model.cloud, neighbourhood::exact_knn(*model.cloud, 1), model.world_from_model));
  const auto trace = trace::replay(renderer, path).value();
  const metrics::AnalyticTruth truth(*scene.surface, model.world_from_model);
  return metrics::score(path, trace, reference, &truth, {}).value();
}

TEST(Cloud, NeverMissesFalselyTouchesOrSticksBeyondOneLocalResolution) {
  for (const char* spec :
       {"sinusoid:points=40401", "sinusoid:points=40401:jitter=0.4:nonuniform=0.5", "saddle:points=10201",
        "sphere:points=20000", "torus:points=20000", "wedge:points=10201"}) {
    SCOPED_TRACE(spec);
    const Scene scene = generated(spec);
    const trace::ProbePath path = path_over(scene, "weave:frames=12000");
    const auto cloud = prepared(scene.input, "cloud");
    const metrics::Accuracy a = scored(scene, path, *cloud);
    EXPECT_GT(a.contact_frames, 6000u);
    EXPECT_EQ(a.missed_contact_frames, 0u);
    EXPECT_EQ(a.false_contact_frames, 0u);
    EXPECT_EQ(a.longest_stick_frames, 0u);
    // Under a convex edge two faces are equally near; which one holds the god object is then a matter of
    // samples.
    if (std::string(spec).rfind("wedge", 0) != 0) {
      EXPECT_EQ(a.pop_throughs.value_or(99), 0u);
    }
  }
}

/// Two triangulations of the same points lie within half a sagitta of each other and of the truth: what is
/// felt on a raster's own triangles errs as little as on those of any points, and in the same frames.
TEST(Cloud, FeelsARasterAsItFeelsAnyPoints) {
  for (const char* spec :
       {"sinusoid:points=40401", "saddle:points=40401", "torus:points=40000:order=turntable"}) {
    SCOPED_TRACE(spec);
    const Scene scene = generated(spec);
    ASSERT_TRUE(scene.input.models[0].cloud->raster.has_value());
    const trace::ProbePath path = path_over(scene, "weave:frames=6000");
    const auto read = prepared(scene.input, "cloud"), off = prepared(scene.input, "cloud:raster=off");
    const metrics::Accuracy a = scored(scene, path, *read), b = scored(scene, path, *off);
    ASSERT_TRUE(a.force_rms_percent && b.force_rms_percent);
    EXPECT_GT(a.contact_frames, 3000u);
    EXPECT_LT(*a.force_rms_percent, 1.1 * *b.force_rms_percent);
    EXPECT_EQ(a.missed_contact_frames, 0u);
    EXPECT_EQ(a.false_contact_frames, 0u);
    EXPECT_NEAR(static_cast<double>(a.contact_frames), static_cast<double>(b.contact_frames), 2.0);
    EXPECT_NE(hash_of(*read, path), hash_of(*off, path));  // else nothing was compared
  }
}

/// What was read is said, with the option that turns it off; not of points in another order.
TEST(Cloud, SaysThatARasterWasRead) {
  const auto notes = [](const Scene& scene, const std::string& spec) {
    Registry registry;
    register_toolkit_renderers(registry);
    const NamedOptions named = parse_named_options(spec).value();
    const auto renderer = registry.make(named.name, named.options).value();
    const PrepareReport report = renderer->prepare(scene.input, {2, nullptr}).value();
    std::string all;
    for (const std::string& note : report.notes) all += note + "\n";
    return all;
  };
  const Scene raster = generated("sinusoid:points=2601"), any = generated("sinusoid:points=2601:shuffle");
  EXPECT_NE(notes(raster, "cloud").find("2601 of 2601 points are read from its rows and columns"),
            std::string::npos);
  EXPECT_EQ(notes(raster, "cloud:raster=off").find("raster"), std::string::npos);
  EXPECT_EQ(notes(any, "cloud").find("raster"), std::string::npos);
}

TEST(CloudLiteral, SticksWhereTheGrazingPathReentersABox) {
  // The surface of table 7 with its printed parameters, on a part of it.
  const Scene scene = generated("sinusoid:points=160801:extent_mm=40");
  const trace::ProbePath path = path_over(scene, "weave:frames=12000");
  const auto literal = prepared(scene.input, "cloud-literal:box_mm=0.15:resolution_mm=0.1414:shading=none");
  const metrics::Accuracy a = scored(scene, path, *literal);
  EXPECT_GT(a.false_contact_frames, 100u);
  EXPECT_GT(a.longest_stick_frames, 10u);
}

TEST(Cloud, ShadedForceIsCloseToTheTruth) {
  const Scene scene = generated("sinusoid:points=160801");
  const trace::ProbePath path = path_over(scene, "weave:frames=12000");
  const metrics::Accuracy shaded = scored(scene, path, *prepared(scene.input, "cloud"));
  const metrics::Accuracy plain = scored(scene, path, *prepared(scene.input, "cloud:shading=none"));
  ASSERT_TRUE(shaded.force_rms_percent && plain.force_rms_percent);
  // Unshaded, the force is off by stiffness times the way from the foot to the nearest point. Shaded, by the
  // depth times the angle over which the surface bends on that way: at most the depth, 2 mm, over the least
  // radius of curvature, wavelength squared over 4 pi^2 amplitude: 6.33 mm.
  const double radius = 50.0 * 50.0 / (4.0 * std::numbers::pi * std::numbers::pi * 10.0);
  EXPECT_LT(*shaded.force_rms_percent, 2.0 / radius * *plain.force_rms_percent);
  // And that way is at most half the diagonal of a cell on the steepest slope, 4 pi amplitude / wavelength
  // over both.
  const double slope = 2.0 * std::numbers::pi * 10.0 / 50.0;
  const double longest = 0.5 * scene.spacing_mm * std::sqrt(2.0 + 4.0 * slope * slope);
  EXPECT_LT(*plain.force_max_n, 0.5 * longest);
}

/// Frames of `cloud` and of `brute-force` on the same eight nearest, unshaded, where both are in contact.
struct Nearest {
  std::size_t contacts = 0, farther = 0;
};
Nearest nearest_of_all(const std::string& spec) {
  const Scene scene = generated(spec);
  const trace::ProbePath path = path_over(scene, "weave:frames=3000:depth_mm=1");
  const auto fast = prepared(scene.input, "cloud:neighbours=exact-knn:shading=none");
  const auto slow = prepared(scene.input, "brute-force:neighbours=exact-knn");
  fast->restart(path.hip_mm[0]);
  slow->restart(path.hip_mm[0]);
  Nearest result;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const Vec3& hip = path.hip_mm[k];
    const Frame a = fast->step(hip, 1e-3), b = slow->step(hip, 1e-3);
    if (!a.contact || !b.contact) continue;
    ++result.contacts;
    result.farther += (a.god_object_mm - hip).norm() != (b.god_object_mm - hip).norm();
  }
  return result;
}

TEST(Cloud, GodObjectIsTheNearestPointOfAll) {
  for (const char* spec : {"sinusoid:points=2601", "saddle:points=2601", "sphere:points=3000"}) {
    SCOPED_TRACE(spec);
    const Nearest found = nearest_of_all(spec);
    EXPECT_GT(found.contacts, 1500u);
    EXPECT_EQ(found.farther, 0u);
  }
}

// On steep jittered parts planes turn from point to point as at an edge, where the god object keeps to its
// face, and the eight nearest in space need not surround a point: it may stop beside the nearest one of all.
TEST(Cloud, OnJitteredPointsTheGodObjectIsSeldomBesideTheNearest) {
  const Nearest found = nearest_of_all("sinusoid:points=2601:jitter=0.4");
  EXPECT_GT(found.contacts, 1500u);
  EXPECT_LT(found.farther, found.contacts / 100);
}

TEST(Cloud, EntersAThinSlabFromEitherSideAndStaysOnThatSide) {
  const Scene scene = generated("slab:points=20000:thickness_mm=1:extent_mm=40");
  const double top = scene.surface->box_mm().high_mm.z(), bottom = scene.surface->box_mm().low_mm.z();
  for (const double side : {1.0, -1.0}) {
    const auto cloud = prepared(scene.input, "cloud");
    const double start = side > 0 ? top + 2.0 : bottom - 2.0;
    cloud->restart(Vec3(0.3, 0.2, start));
    Frame frame;
    for (int i = 0; i <= 800; ++i)
      frame = cloud->step(Vec3(0.3, 0.2, start - side * 0.01 * i), 1e-3);  // 8 mm, right through
    ASSERT_TRUE(frame.contact);
    // 6 mm below a face whose points are stored to a float's rounding of half the extent, 20 mm.
    constexpr double kStored = 20.0 * 0x1.0p-24;
    EXPECT_NEAR(side * frame.force_n.z(), 0.5 * 6.0, 2.0 * kStored);
    EXPECT_NEAR(frame.god_object_mm.z(), side > 0 ? top : bottom, 2.0 * kStored);
    for (int i = 0; i <= 800; ++i)
      frame = cloud->step(Vec3(0.3, 0.2, start - 8.0 * side + side * 0.01 * i), 1e-3);
    EXPECT_FALSE(frame.contact);
  }
}

// Everything scaled, stiffness kept: contacts are the same and forces scale.
TEST(Cloud, ScalesFromMicrometresToKilometres) {
  std::vector<std::uint8_t> contacts;
  for (const double s : {1e-3, 1.0, 1e6}) {
    std::vector<Vec3> points, hips;
    Random random(5);
    for (int y = 0; y < 60; ++y)
      for (int x = 0; x < 60; ++x)
        points.emplace_back(
            s * Vec3(x + random.uniform(-0.3, 0.3), y + random.uniform(-0.3, 0.3), 0.3 * std::sin(0.2 * x)));
    SceneInput scene = cloud_of(points);
    const auto cloud = prepared(scene, "cloud:shading=facet");
    cloud->restart(s * Vec3(30, 30, 8));
    std::vector<std::uint8_t> here;
    for (int i = 0; i < 4000; ++i) {
      const Frame f = cloud->step(
          s * Vec3(30 + 15 * std::sin(0.003 * i), 30 + 12 * std::cos(0.002 * i), 4 * std::cos(0.01 * i)),
          1e-3);
      here.push_back(f.contact);
      ASSERT_TRUE(is_finite(f.force_n));
    }
    if (contacts.empty()) contacts = here;
    std::size_t differ = 0;
    for (std::size_t i = 0; i < here.size(); ++i) differ += here[i] != contacts[i];
    EXPECT_LE(differ, 4u) << "scale " << s;  // floats round differently at each scale
    EXPECT_GT(std::count(here.begin(), here.end(), 1), 500);
  }
}

TEST(Cloud, RigidMotionMovesTheAnswer) {
  Scene scene = generated("sinusoid:points=10201:jitter=0.3");
  const trace::ProbePath path = path_over(scene, "weave:frames=3000");
  const auto still = prepared(scene.input, "cloud");
  geometry::RigidTransform pose;
  pose.rotation = Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5);
  pose.translation_mm = Vec3(1000, -500, 250);
  scene.input.models[0].world_from_model = pose;
  const auto moved = prepared(scene.input, "cloud");
  still->restart(path.hip_mm[0]);
  moved->restart(pose * path.hip_mm[0]);
  std::size_t contacts = 0, differ = 0;
  for (const Vec3& hip : path.hip_mm) {
    const Frame a = still->step(hip, 1e-3), b = moved->step(pose * hip, 1e-3);
    contacts += a.contact;
    if (a.contact != b.contact || (pose.rotate(a.force_n) - b.force_n).norm() > 1e-9) ++differ;
  }
  EXPECT_GT(contacts, 1000u);
  EXPECT_LE(differ, 3u);  // rounding of the pose may tip a tie
}

TEST(Cloud, PermutedPointsAnswerTheSame) {
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
  const auto a = prepared(scene.input, "cloud:neighbours=exact-knn"),
             b = prepared(other, "cloud:neighbours=exact-knn");
  EXPECT_EQ(hash_of(*a, path), hash_of(*b, path));
}

TEST(Cloud, SameHashForAnyThreads) {
  const Scene scene = generated("sinusoid:points=40401:jitter=0.3");
  const trace::ProbePath path = path_over(scene, "weave:frames=2000");
  for (const char* spec : {"cloud:neighbours=modified-knn", "cloud-literal:box_mm=0.3", "brute-force"}) {
    const auto one = prepared(scene.input, spec, 1), many = prepared(scene.input, spec, 4);
    trace::ProbePath short_path = path;
    if (std::string(spec) == "brute-force") {
      short_path.t_s.resize(200);
      short_path.hip_mm.resize(200);
    }
    EXPECT_EQ(hash_of(*one, short_path), hash_of(*many, short_path));
  }
}

TEST(PointRenderers, SurviveHostileInput) {
  std::vector<std::vector<Vec3>> clouds = {
      {Vec3(1, 2, 3)},
      {Vec3(0, 0, 0), Vec3(1, 0, 0)},
      std::vector<Vec3>(200, Vec3(7, 7, 7)),
      {},
  };
  for (int i = 0; i < 50; ++i) clouds[3].emplace_back(i, 2.0 * i, -i);  // collinear
  const double inf = std::numeric_limits<double>::infinity(), nan = std::numeric_limits<double>::quiet_NaN();
  for (const auto& points : clouds)
    for (const char* spec :
         {"cloud", "cloud-literal", "brute-force", "cloud:box=per-vertex", "cloud-literal:cells=crossed"}) {
      SCOPED_TRACE(std::string(spec) + " on " + std::to_string(points.size()));
      const auto renderer = prepared(cloud_of(points), spec);
      renderer->restart(points[0] + Vec3(0, 0, 50));
      Random random(2);
      for (int i = 0; i < 300; ++i) {
        Vec3 hip = points[0] + 3.0 * Vec3(random.normal(), random.normal(), random.normal());
        if (i % 50 == 3) hip *= 1e9;
        const Frame f = renderer->step(hip, 1e-3);
        ASSERT_TRUE(is_finite(f.force_n));
      }
      for (const Vec3& bad : {Vec3(nan, 0, 0), Vec3(inf, 0, 0)}) {
        const Frame f = renderer->step(bad, 1e-3);
        EXPECT_EQ(f.status, FrameStatus::kNonFinite);
        EXPECT_EQ(f.force_n, Vec3::Zero().eval());
      }
    }
}

TEST(Cloud, ALonePointLetsGoWhenTheProbeLeavesSideways) {
  const auto cloud = prepared(cloud_of({Vec3(0, 0, 0)}), "cloud:box_mm=2");
  cloud->restart(Vec3(0, 0, 5));
  Frame f;
  for (int i = 0; i <= 55; ++i) f = cloud->step(Vec3(0, 0, 5 - 0.1 * i), 1e-3);
  EXPECT_TRUE(f.contact);
  for (int i = 0; i <= 100; ++i) f = cloud->step(Vec3(0.1 * i, 0, -0.5), 1e-3);
  EXPECT_FALSE(f.contact);
}

TEST(Cloud, WorkPastTheBoundIsDoneInTheNextFrame) {
  // A pile of more boxes than one frame may test: the touch comes a few frames later, and every such frame
  // says so.
  std::vector<Vec3> points;
  Random random(4);
  for (int i = 0; i < 60000; ++i)
    points.emplace_back(random.uniform(), random.uniform(), 1e-3 * random.uniform());
  points.emplace_back(40, 40, 0);  // a far pair makes the resolution, so all the rest is in one cell
  points.emplace_back(44, 40, 0);
  const auto cloud = prepared(cloud_of(points), "cloud:neighbours=exact-knn");
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

TEST(Cloud, RefusesWhatItCannotRender) {
  SceneInput none = cloud_of({Vec3(0, 0, 0)});
  none.models.clear();
  Registry registry;
  register_toolkit_renderers(registry);
  EXPECT_FALSE(registry.make("cloud", {}).value()->prepare(none, {}));
  SceneInput soft = cloud_of({Vec3(0, 0, 0)});
  soft.models[0].surface.stiffness_n_per_mm = 0;
  EXPECT_FALSE(registry.make("cloud", {}).value()->prepare(soft, {}));
  Options scanner;
  scanner.set("neighbours", "scanner-path");
  EXPECT_FALSE(registry.make("cloud", scanner).value()->prepare(cloud_of({Vec3(0, 0, 0)}), {}));
}

}  // namespace
}  // namespace palpate::render
