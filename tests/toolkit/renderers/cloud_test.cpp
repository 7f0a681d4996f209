// The point renderers against oracles, on generated, degenerate and hostile data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/generate.h>
#include <palpate/paths.h>
#include <palpate/registry.h>
#include <palpate/replay.h>
#include "tests/stepped.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/search/knn.h"

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
  EXPECT_TRUE(metrics::fill_local_resolution(reference, path, *model.cloud,
                                             search::exact_knn(*model.cloud, 1), model.world_from_model));
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
    // Under a convex edge two faces are equally near: which one holds the god object is a matter of samples.
    if (std::string(spec).rfind("wedge", 0) != 0) {
      EXPECT_EQ(a.pop_throughs.value_or(99), 0u);
    }
  }
}

/// What a part of a scan is felt as. Stars are of the points around, but where four points are nearly on a
/// circle, or noise asks for a vote, the blocks that neighbours are looked for in decide, and a border moves
/// those. So in a few frames the god object is on the other diagonal of four points, which turns the normal
/// by less than neighbouring facets differ; all others differ by the rounding of coordinates about another
/// middle.
TEST(Cloud, APartIsFeltAsTheWholeAwayFromItsBorder) {
  constexpr double kSpacingMm = 0.25, kBorderMm = 8.0 * kSpacingMm, kSlideMm = 1.0;
  const Scene scene =
      generated("sinusoid:points=40401:extent_mm=50:wavelength_mm=20:amplitude_mm=2:jitter=0.4:seed=3");
  const cloud::Cloud& cloud = *scene.input.models[0].cloud;
  const geometry::Aabb box = cloud.box_mm().grown(-0.25 * cloud.box_mm().extent_mm().x());
  std::vector<Vec3> whole, part, inner;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.point_mm(i);
    const double inside =
        std::min((p - box.low_mm).head<2>().minCoeff(), (box.high_mm - p).head<2>().minCoeff());
    whole.push_back(p);
    if (inside >= 0.0) part.push_back(p);
    if (inside >= kBorderMm + kSlideMm) inner.push_back(p);
  }
  ASSERT_GT(inner.size(), 1000u);
  const auto of_whole = prepared(cloud_of(whole), "cloud"), of_part = prepared(cloud_of(part), "cloud");
  // Corners round by up to 2^-25 of an extent of 50 mm, and the spring has 0.5 N/mm: twice as much, for
  // facets that are turned by it.
  const double rounding_n = 50.0 * 0x1p-25;
  std::size_t touched = 0, otherwise = 0;
  double most_n = 0.0, most_difference_n = 0.0;
  const auto step = [&](const Vec3& hip) {
    const Frame a = of_whole->step(hip, 1e-3), b = of_part->step(hip, 1e-3);
    const double difference_n = (a.force_n - b.force_n).norm();
    touched += a.contact ? 1u : 0u;
    otherwise += a.contact != b.contact || difference_n > rounding_n ? 1u : 0u;
    most_n = std::max(most_n, a.force_n.norm());
    most_difference_n = std::max(most_difference_n, difference_n);
  };
  for (std::size_t k = 0; k < 400; ++k) {
    const Vec3 p = inner[k * 7919 % inner.size()], above(p.x(), p.y(), 8.0);
    const Vec3 in = p - Vec3(0, 0, 0.4), slid = in + Vec3(kSlideMm, 0.5 * kSlideMm, 0);
    of_whole->restart(above);
    of_part->restart(above);
    for (int i = 0; i <= 40; ++i) step(above + (i / 40.0) * (in - above));
    for (int i = 0; i <= 40; ++i) step(in + (i / 40.0) * (slid - in));
  }
  EXPECT_GT(touched, 8'000u);
  EXPECT_LT(static_cast<double>(otherwise), 0.03 * static_cast<double>(touched));
  EXPECT_LT(most_difference_n, 0.1 * most_n);
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

TEST(CloudLiteral, SticksWhereTheGrazingPathReentersABox) {
  // The surface of table 7 with its printed parameters, on a part of it.
  const Scene scene = generated("sinusoid:points=160801:extent_mm=40");
  const trace::ProbePath path = path_over(scene, "weave:frames=12000");
  const auto literal = prepared(scene.input, "cloud-literal:box_mm=0.15:resolution_mm=0.1414:shading=none");
  const metrics::Accuracy a = scored(scene, path, *literal);
  EXPECT_GT(a.false_contact_frames, 100u);
  EXPECT_GT(a.longest_stick_frames, 10u);
}

// The tree, the layers, the blocks remembered and packed and the clearance of a free HIP: none of them may be
// felt. Both do the same arithmetic on the triangles that count, so that no bit differs.
TEST(Cloud, FeelsWhatIsFoundWithEveryTriangleLookedAt) {
  for (const char* spec : {"sinusoid:points=2601", "sinusoid:points=2601:jitter=0.4:nonuniform=0.5",
                           "saddle:points=2601", "sphere:points=3000", "torus:points=3000",
                           "wedge:points=2601", "slab:points=3000:extent_mm=20:thickness_mm=1.6"}) {
    SCOPED_TRACE(spec);
    const Scene scene = generated(spec);
    for (const char* way :
         {"weave:frames=3000", "exploration:frames=3000", "weave:frames=1000:speed_mm_s=2000"}) {
      const trace::ProbePath path = path_over(scene, way);
      const auto cloud = prepared(scene.input, "cloud"), brute = prepared(scene.input, "brute-force");
      EXPECT_EQ(hash_of(*cloud, path), hash_of(*brute, path)) << way;
      EXPECT_EQ(cloud->counters().bound_hits, 0u) << way;
      EXPECT_LE(cloud->counters().box_tests, brute->counters().box_tests) << way;
    }
  }
}

TEST(Cloud, EntersAThinSlabFromEitherSideAndStaysOnThatSide) {
  const Scene scene = generated("slab:points=20000:thickness_mm=1:extent_mm=40");
  const geometry::Aabb box = scene.surface->box_mm();
  for (const double side : {1.0, -1.0}) {
    const auto cloud = prepared(scene.input, "cloud");
    const double face = side > 0 ? box.high_mm.z() : box.low_mm.z();
    const Vec3 start(0.3, 0.2, face + 2.0 * side), through = start - Vec3(0, 0, 8.0 * side);
    cloud->restart(start);
    const Frame frame = glide(cloud, start, through, 800);
    ASSERT_TRUE(frame.contact);
    // 6 mm below a face whose points are stored to a float's rounding of half the extent, 20 mm.
    constexpr double kStored = 20.0 * 0x1.0p-24;
    EXPECT_NEAR(side * frame.force_n.z(), 0.5 * 6.0, 2.0 * kStored);
    EXPECT_NEAR(frame.god_object_mm.z(), face, 2.0 * kStored);
    EXPECT_FALSE(glide(cloud, through, start, 800).contact);
  }
}

struct Moved {
  const char *renderer, *model;
  std::string scale;
  geometry::RigidTransform pose;
  int may_differ, may_be_off;  ///< frames of another contact, of another force
  double force_n;
};

// Everything scaled, stiffness kept: the same contacts, and forces in scale. Floats round otherwise at each
// scale, and so does a pose: that may tip a tie. The posts' rounding, 1e-6 mm, tilts a facet of 0.2 mm by
// 1e-5.
TEST(PointRenderers, ScalePlaceAndPoseChangeNothing) {
  geometry::RigidTransform far, near;
  far.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  far.translation_mm = {1e6, -3e6, 2e5};
  near.rotation = Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5);
  near.translation_mm = {1000, -500, 250};
  const char *posts = "sinusoid:points=251001:mesh=false", *points = "sinusoid:points=10201:jitter=0.3",
             *ridge = "wedge:angle_deg=120:extent_mm=12:spacing_mm=0.2:jitter=0.2",
             *groove = "wedge:angle_deg=240:extent_mm=12:spacing_mm=0.2:jitter=0.2";
  const Moved all[] = {
      {"heightfield", posts, "0.001", {}, 2, 0, 1e-4}, {"heightfield", posts, "1000000", {}, 2, 0, 1e-4},
      {"heightfield", posts, "1", far, 1, 0, 1e-6},    {"cloud", points, "0.001", {}, 4, 4, 1e-4},
      {"cloud", points, "1000000", {}, 4, 4, 1e-4},    {"cloud", points, "1", near, 3, 3, 1e-9},
      {"cloud", ridge, "1", near, 2, 2, 1e-9},         {"cloud", groove, "1", near, 2, 2, 1e-9}};
  for (const Moved& c : all) {
    SCOPED_TRACE(std::string(c.renderer) + " on " + c.model + ", scale " + c.scale);
    const Scene plain = generated(c.model);
    const trace::ProbePath path = path_over(plain, "weave:frames=6000:speed_mm_s=50:depth_mm=2");
    const auto frames = trace::replay(*prepared(plain.input, c.renderer), path).value().frames;
    const double scale = std::stod(c.scale);
    Scene other = generated(c.model + (":scale=" + c.scale));
    other.input.models[0].world_from_model = c.pose;
    const auto renderer = prepared(other.input, c.renderer);
    renderer->restart(c.pose * (scale * path.hip_mm[0]));
    int contacts = 0, differ = 0, off = 0;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Frame frame = renderer->step(c.pose * (scale * path.hip_mm[i]), 1e-3);
      contacts += frame.contact;
      differ += frame.contact != frames[i].contact;
      if (!frame.contact || !frames[i].contact) continue;
      const Vec3 force = c.pose.inverse().rotate(frame.force_n) / scale,
                 god_object = c.pose.inverse() * frame.god_object_mm / scale;
      off += !((force - frames[i].force_n).norm() <= c.force_n) ||
             (scale == 1.0 && (god_object - frames[i].god_object_mm).norm() > 1e-6);
    }
    EXPECT_GT(contacts, 1000);
    EXPECT_LE(differ, c.may_differ);
    EXPECT_LE(off, c.may_be_off);
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
    for (const char* spec : {"cloud", "cloud-literal", "brute-force", "cloud-literal:cells=crossed"}) {
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

// `cloud` on surfaces that enclose a volume: which side is touched, and what a hole in them may not break.

constexpr double kRadius = 50.0;

/// Points of a sphere around `centre`; the hole, at +x, is 20 mm wide on one of 50 mm.
std::vector<Vec3> sphere_points(double radius, const Vec3& centre, bool with_hole) {
  const auto model =
      cloud::generate(parse_named_options("sphere:points=20000:extent_mm=100").value()).value();
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < model.cloud.size(); ++i) {
    const Vec3 p = model.cloud.point_mm(i) / kRadius;
    if (!with_hole || p.x() < 0.98) points.push_back(centre + radius * p);
  }
  return points;
}

test::Stepped sphere(bool with_hole, const char* renderer = "cloud") {
  return prepared(cloud_of(sphere_points(kRadius, Vec3::Zero(), with_hole)), renderer);
}

// In by the hole and out through the wall: its back holds nobody, and its front is felt as before.
TEST(ClosedCloud, WithAHoleIsFeltFromOutsideAfterTheHipWasInside) {
  const auto cloud = sphere(true, "cloud");
  const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), wall(0, 0.3, kRadius + 1);
  cloud->restart(before);
  EXPECT_FALSE(glide(cloud, before, middle).contact);
  EXPECT_FALSE(glide(cloud, middle, wall).contact);
  const Frame frame = glide(cloud, Vec3(0, 0.3, kRadius + 5), Vec3(0, 0.3, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
}

// As of a vase: in by its mouth, and the wall is there; the same for the smooth surface.
TEST(ClosedCloud, WithAHoleIsFeltFromBothSidesWhereThatIsAskedFor) {
  for (const char* renderer : {"cloud:sides=both", "cloud-smooth:sides=both"}) {
    const auto cloud = sphere(true, renderer);
    const Vec3 before(kRadius + 10, 0, 0), middle(0, 0, 0), wall(0, 0.3, kRadius + 1);
    cloud->restart(before);
    EXPECT_FALSE(glide(cloud, before, middle).contact) << renderer;
    const Frame frame = glide(cloud, middle, wall);
    ASSERT_TRUE(frame.contact) << renderer;
    EXPECT_LT(frame.force_n.z(), 0.0) << renderer;
  }
}

TEST(ClosedCloud, ABowlIsFeltFromBothSides) {
  std::vector<Vec3> points = sphere_points(kRadius, Vec3::Zero(), false);
  std::erase_if(points, [](const Vec3& p) { return p.z() > 0.0; });
  const auto cloud = prepared(cloud_of(points), "cloud");
  const Vec3 above(0, 0.3, kRadius), below(0, 0.3, -kRadius - 5);
  cloud->restart(above);
  Frame frame = glide(cloud, above, Vec3(0, 0.3, -kRadius - 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_GT(frame.force_n.z(), 0.0);
  cloud->restart(below);
  frame = glide(cloud, below, Vec3(0, 0.3, -kRadius + 1));
  ASSERT_TRUE(frame.contact);
  EXPECT_LT(frame.force_n.z(), 0.0);
}

// Pressed against the wall, then along it into the mouth and to the middle: nothing is felt in free air.
TEST(ClosedCloud, AMouthLetsGoOfWhoSlidesIntoIt) {
  const auto cloud = sphere(true, "cloud");
  constexpr double kBeside = 0.3;  // of the way around, from the axis of the mouth
  const auto at = [](double angle, double radius) {
    return Vec3(radius * std::cos(angle), radius * std::sin(angle), 0.0);
  };
  cloud->restart(at(kBeside, kRadius + 2));
  Frame frame = glide(cloud, at(kBeside, kRadius + 2), at(kBeside, kRadius - 1));
  ASSERT_TRUE(frame.contact);
  frame = glide(cloud, at(kBeside, kRadius - 1), at(0.0, kRadius - 1));
  EXPECT_FALSE(frame.contact);
  EXPECT_FALSE(glide(cloud, at(0.0, kRadius - 1), Vec3::Zero()).contact);
}

// Shells that do not touch: each is felt from the side that the HIP was on at the start.
struct Shell {
  Vec3 centre;
  double radius;
};

/// How deep a HIP is in the matter of a shell that was entered at `start`; negative where it is free of it.
double depth_mm(const Shell& shell, const Vec3& start, const Vec3& hip) {
  const double over = (hip - shell.centre).norm() - shell.radius;
  return (start - shell.centre).norm() < shell.radius ? over : -over;
}

/// Frames along a way whose contact or force is not that of the shells.
int wrong_frames(const test::Stepped& renderer, const std::vector<Shell>& shells, const Vec3& start,
                 const std::vector<Vec3>& way) {
  constexpr double kSpacing = 1.3;  // beyond it contact must be right
  constexpr int kFrames = 1000;
  int wrong = 0;
  for (std::size_t leg = 0; leg + 1 < way.size(); ++leg)
    for (int i = 0; i <= kFrames; ++i) {
      const Vec3 hip = way[leg] + (way[leg + 1] - way[leg]) * (static_cast<double>(i) / kFrames);
      const Frame frame = renderer->step(hip, 1e-3);
      double deepest = -1e9;
      for (const Shell& shell : shells) deepest = std::max(deepest, depth_mm(shell, start, hip));
      if (std::abs(deepest) < 0.1 * kSpacing) continue;
      wrong += frame.contact != (deepest > 0.0);
      if (frame.contact && deepest > 0.0) wrong += std::abs(frame.force_n.norm() - 0.5 * deepest) > 0.05;
    }
  return wrong;
}

TEST(ClosedCloud, EachOfTwoHollowSpheresHasASideOfItsOwn) {
  const std::vector<Shell> shells = {{Vec3::Zero(), kRadius}, {Vec3(150, 0, 0), 30.0}};
  std::vector<Vec3> points = sphere_points(kRadius, Vec3::Zero(), true);
  const std::vector<Vec3> other = sphere_points(30.0, shells[1].centre, false);
  points.insert(points.end(), other.begin(), other.end());
  const SceneInput scene = cloud_of(points);
  const auto cloud = prepared(scene, "cloud");
  // Inside the first: its inside wall, out by its hole, the outside of the second.
  const Vec3 inside(0, 5, 0), beside(kRadius + 20, 0, 0);
  cloud->restart(inside);
  EXPECT_EQ(wrong_frames(cloud, shells, inside, {inside, Vec3(0, 5, kRadius + 2), inside}), 0);
  (void)glide(cloud, inside, beside);
  EXPECT_EQ(wrong_frames(cloud, {shells[1]}, inside, {beside, Vec3(122, 0, 0), beside}), 0);
  // A restart inside the second, one outside of both.
  const Vec3 second(150, 0, 3), outside(0, kRadius + 10, 0);
  cloud->restart(second);
  EXPECT_EQ(wrong_frames(cloud, shells, second, {second, Vec3(150, 32, 0), second}), 0);
  cloud->restart(outside);
  EXPECT_EQ(wrong_frames(cloud, shells, outside, {outside, Vec3(0, kRadius - 2, 0), outside}), 0);
}

TEST(ClosedCloud, NestedShellsAreFeltFromBetweenThem) {
  std::vector<Shell> shells;
  std::vector<Vec3> points;
  for (const double radius : {50.0, 30.0, 15.0}) {
    shells.push_back({Vec3::Zero(), radius});
    const std::vector<Vec3> shell = sphere_points(radius, Vec3::Zero(), false);
    points.insert(points.end(), shell.begin(), shell.end());
  }
  const auto cloud = prepared(cloud_of(points), "cloud");
  Random random(31);
  for (const double at : {5.0, 22.0, 40.0, 60.0})
    for (int run = 0; run < 5; ++run) {
      SCOPED_TRACE(testing::Message() << "seed 31, start at " << at << " mm, run " << run);
      const Vec3 u = Vec3(random.normal(), random.normal(), random.normal()).normalized();
      const Vec3 start = at * u;
      cloud->restart(start);
      const double in = at > 50 ? 48 : at > 30 ? 28 : at > 15 ? 13 : 0;
      const double out = at < 15 ? 17 : at < 30 ? 32 : 52;
      EXPECT_EQ(wrong_frames(cloud, shells, start, {start, in * u, start}), 0);
      EXPECT_EQ(wrong_frames(cloud, shells, start, {start, out * u, start}), 0);
    }
}

// A surface that gives way keeps places for points to come: these may not tell where the inside is.
TEST(ClosedCloud, GivingWayDoesNotTurnAThinPlateInsideOut) {
  Scene scene = generated("slab:points=3000:thickness_mm=1:extent_mm=10");
  scene.input.models[0].surface.dent = {100.0, 1.0, 1.0};  // never reached
  const auto cloud = prepared(scene.input, "cloud");
  const geometry::Aabb box = scene.surface->box_mm();
  Random random(37);
  int missed = 0;
  for (int run = 0; run < 400; ++run) {
    const double side = run % 2 == 0 ? 1.0 : -1.0;
    const Vec3 start(random.uniform(-4, 4), random.uniform(-4, 4),
                     side > 0 ? box.high_mm.z() + 0.5 : box.low_mm.z() - 0.5);
    cloud->restart(start);
    const Frame frame = glide(cloud, start, start - Vec3(0, 0, 0.8 * side));
    missed += !frame.contact || frame.force_n.z() * side <= 0.0;
  }
  EXPECT_EQ(missed, 0) << "seed 37";
}

}  // namespace
}  // namespace palpate::render
