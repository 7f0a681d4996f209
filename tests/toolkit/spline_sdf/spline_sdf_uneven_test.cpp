// `cloud-smooth` on points as scanners leave them: in lines, dense here and sparse there, sheets one spacing
// apart, and where two faces meet.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "tests/toolkit/spline_sdf/spline_sdf_scenes.h"
#include "toolkit/geometry/winding_number.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

Score felt_on_torus(const std::vector<Vec3>& points) {
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", 2);
  return score(renderer, torus_path({}, 9000), torus_truth({}), 0.1);
}

/// A `share`-th of the points on one half, from the `first` on.
std::vector<Vec3> thinned_torus(std::size_t points, std::size_t share, std::size_t first) {
  std::vector<Vec3> kept;
  std::size_t at = 0;
  for (const Vec3& p : torus_points({points}))
    if (p.x() < 0.0 || at++ % share == first) kept.push_back(p);
  return kept;
}

// Lines around the tube's axis, eight times as far apart as points along them.
std::vector<Vec3> torus_in_lines(double noise_mm) {
  constexpr int kLines = 64;
  constexpr double kBetween = 2.0 * std::numbers::pi * kTube / kLines;
  Random random(11);
  std::vector<Vec3> points;
  for (int line = 0; line < kLines; ++line) {
    const double b = 2.0 * std::numbers::pi * line / kLines, across = kRing + kTube * std::cos(b);
    const auto count = static_cast<int>(2.0 * std::numbers::pi * across / (kBetween / 8.0));
    for (int i = 0; i < count; ++i) {
      const double a = 2.0 * std::numbers::pi * (i + 0.5 * random.uniform()) / count,
                   r = kTube + noise_mm * random.normal();
      points.emplace_back((kRing + r * std::cos(b)) * std::cos(a), (kRing + r * std::cos(b)) * std::sin(a),
                          r * std::sin(b));
    }
  }
  return points;
}

TEST(CloudSmoothUneven, ScanLinesAreASurface) {
  const Score clean = felt_on_torus(torus_in_lines(0.0)), noisy = felt_on_torus(torus_in_lines(0.02));
  EXPECT_LT(clean.rms_percent, 1.0);
  expect_kept(clean);
  EXPECT_EQ(clean.jumps, 0);
  EXPECT_LT(noisy.rms_percent, 5.0);
  expect_kept(noisy);
}

// A sixteenth of the points on one half: four times the spacing.
TEST(CloudSmoothUneven, AStepOfDensityIsNoBorder) {
  const Score s = felt_on_torus(thinned_torus(100000, 16, 0));
  EXPECT_LT(s.rms_percent, 1.0);
  expect_kept(s);
  EXPECT_EQ(s.jumps, 0);
}

// The same of fewer points, each time others of the sparse half: random points leave voids, and some are
// beside the step, where what is dense begins farther off than its own spacing.
TEST(CloudSmoothUneven, AVoidBesideAStepOfDensityIsNoBorder) {
  for (std::size_t kept = 1; kept < 16; kept += 2) {
    const Score s = felt_on_torus(thinned_torus(20000, 16, kept));
    EXPECT_LT(s.rms_percent, 5.0) << kept;
    EXPECT_EQ(s.missed + s.false_ones, 0) << kept;
  }
}

// Even points on a sphere.
void add_sphere(double radius, double spacing, std::vector<Vec3>& points) {
  const auto count = static_cast<int>(4.0 * std::numbers::pi * radius * radius / (spacing * spacing));
  const double golden = std::numbers::pi * (3.0 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (2.0 * i + 1.0) / count, r = std::sqrt(1.0 - z * z);
    points.push_back(radius * Vec3(r * std::cos(golden * i), r * std::sin(golden * i), z));
  }
}

TEST(CloudSmoothUneven, SheetsASpacingApartAreKeptApart) {
  constexpr double kRadius = 10.0, kSpacing = 0.2;
  std::vector<Vec3> points;
  add_sphere(kRadius, kSpacing, points);
  add_sphere(kRadius - 1.25 * kSpacing, kSpacing, points);
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", 2);
  const Score s = score(renderer, sphere_path(kRadius, 9000), sphere_truth(kRadius), 0.1);
  // The field's ridge between the sheets lies within a voxel of both: some frames in a hundred see it.
  EXPECT_LT(s.rms_percent, 2.0);
  expect_kept(s);
  EXPECT_LT(s.jumps, 40);
}

constexpr double kRoofHalf = 6.0;

// A roof of 90 degrees, its ridge along y at z = 0.
std::vector<Vec3> roof(double spacing, double noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<Vec3> points(
      static_cast<std::size_t>(4.0 * std::numbers::sqrt2 * kRoofHalf * kRoofHalf / (spacing * spacing)));
  for (Vec3& p : points) {
    const double x = (2.0 * random.uniform() - 1.0) * kRoofHalf,
                 y = (2.0 * random.uniform() - 1.0) * kRoofHalf;
    const double off = std::numbers::sqrt2 / 2.0 * noise * spacing * random.normal();
    p = Vec3(x + std::copysign(off, x), y, off - std::abs(x));
  }
  return points;
}

/// What holds a HIP at a roof: the face that it came in by, until it is over the other's side of the ridge.
class HeldByARoof {
  mutable double side_ = 1.0;

 public:
  double operator()(const Vec3& at, Vec3& closest) const {
    if (std::abs(at.x()) + at.z() >= 0.0)
      side_ = at.x() < 0.0 ? -1.0 : 1.0;
    else if (side_ * at.x() < at.z())
      side_ = -side_;
    const double off = (side_ * at.x() + at.z()) / std::numbers::sqrt2;
    closest = at - Vec3(side_, 0.0, 1.0) * (off / std::numbers::sqrt2);
    return off;
  }
};

/// Pressed beside the ridge, slid along a face, up, and across near the tip.
std::vector<Vec3> over_the_roof() {
  std::vector<Vec3> path{Vec3(-2.0, 0.0, 0.5)};
  const auto go_to = [&](const Vec3& to) {
    const Vec3 from = path.back();
    const int steps = 1 + static_cast<int>((to - from).norm() / 0.04);
    for (int i = 1; i <= steps; ++i) path.push_back(from + (to - from) * i / steps);
  };
  for (int stroke = 0; stroke < 12; ++stroke) {
    const double side = stroke % 2 == 0 ? 1.0 : -1.0, y = 0.7 * (stroke - 6), x = 0.4 + 0.1 * stroke;
    // No deeper than that the face pressed is the nearer one.
    go_to(Vec3(side * x, y, 0.5));
    go_to(Vec3(side * x, y, -x - 0.3));
    go_to(Vec3(side * 2.5, y + 0.4, -2.5 - 0.8));
    go_to(Vec3(side * 2.5, y + 0.4, 0.5));
    go_to(Vec3(side * 2.0, y, -0.12));
    go_to(Vec3(-side * 2.0, y + 0.3, -0.12));
    go_to(Vec3(-side * 2.0, y + 0.3, 0.5));
  }
  return path;
}

// Of eighteen roofs at random two come out with a patch of a ridge that looks the other way, and are lost
// there: an open sheet has no inside to tell it by (docs/results/smooth.md).
TEST(CloudSmoothUneven, ARidgeInNoiseHolds) {
  constexpr double kSpacing = 0.15, kNear = 1.5 * kSpacing;
  constexpr int kLostRoofs = 2;
  int lost = 0;
  for (const double noise : {0.0, 0.1, 0.2})
    for (std::uint64_t seed = 1; seed <= 6; ++seed) {
      test::Stepped renderer = prepared(cloud_of(roof(kSpacing, noise, seed)), "cloud-smooth", 2);
      const Score s = score(renderer, over_the_roof(), HeldByARoof(), kNear);
      if (s.missed + s.false_ones > 0)
        ++lost;
      else
        EXPECT_LT(s.rms_percent, 7.0) << "noise " << noise << ", seed " << seed;
    }
  EXPECT_LE(lost, kLostRoofs);
}

// Floor and wall: pressed into both by three spacings, the god object stands in the corner and goes along it.
TEST(CloudSmoothUneven, ACornerHolds) {
  Random random(5);
  std::vector<Vec3> points;
  for (int i = 0; i < 20000; ++i)
    points.push_back(Vec3{10.0 * random.uniform(), 20.0 * random.uniform(), 0.0});
  for (int i = 0; i < 20000; ++i)
    points.push_back(Vec3{0.0, 20.0 * random.uniform(), 10.0 * random.uniform()});
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", 2);
  renderer->restart(Vec3(1.0, 5.0, 1.0));
  Frame frame;
  for (int k = 0; k <= 200; ++k) frame = renderer->step(Vec3(1.0 - 0.0065 * k, 5.0, 1.0 - 0.0065 * k), 0.001);
  ASSERT_TRUE(frame.contact);
  double worst = 0.0;
  int lost = 0;
  for (int k = 0; k <= 400; ++k) {
    const Vec3 h(-0.3, 5.0 + 0.02 * k, -0.3);
    frame = renderer->step(h, 0.001);
    if (!frame.contact) {
      ++lost;
      continue;
    }
    worst = std::max(worst, (frame.god_object_mm - Vec3(0.0, h.y(), 0.0)).norm());
  }
  // Where chance left a void beside the corner it waits there for some spacings, and at a wider one the open
  // sheet is left: docs/results/smooth.md says so.
  EXPECT_LT(worst, 0.6);
  EXPECT_LT(lost, 60);
}

// A piece of another sheet over a floor, as of a scan put a little off: past its border the floor holds.
TEST(CloudSmoothUneven, BelowASheetThatEndsTheNextOneHolds) {
  Random random(6);
  std::vector<Vec3> points;
  for (int i = 0; i < 20000; ++i)
    points.push_back(Vec3{random.uniform(-10.0, 10.0), random.uniform(-10.0, 10.0), 0.0});
  for (int i = 0; i < 10000; ++i)
    points.push_back(Vec3{random.uniform(-10.0, 0.0), random.uniform(-10.0, 10.0), 0.8});
  test::Stepped renderer = prepared(cloud_of(points), "cloud-smooth", 2);
  for (const double y : {-6.0, -1.0, 3.0}) {
    renderer->restart(Vec3(-3.0, y, 1.5));
    Frame frame;
    for (int k = 0; k <= 100; ++k) frame = renderer->step(Vec3(-3.0, y, 1.5 - 0.02 * k), 0.001);
    ASSERT_TRUE(frame.contact);
    ASSERT_NEAR(frame.god_object_mm.z(), 0.8, 0.01) << "the upper sheet";
    for (int k = 0; k <= 150; ++k) frame = renderer->step(Vec3(-3.0 + 0.04 * k, y, -0.5), 0.001);
    EXPECT_TRUE(frame.contact);
    EXPECT_NEAR(frame.god_object_mm.z(), 0.0, 0.01) << "the floor";
  }
}

// `cloud-smooth`: which pieces of surface are felt from one side, and from which.

using geometry::normal_orientation, geometry::winding_number, geometry::AreaElement;

constexpr double kBall = 12.0;

Vec3 by_chance_on_ball(Random& random) {
  const double z = 2.0 * random.uniform() - 1.0, a = 2.0 * std::numbers::pi * random.uniform();
  const double r = std::sqrt(1.0 - z * z);
  return {r * std::cos(a), r * std::sin(a), z};
}

/// Parts of a ball about `at` below a height in radii, of 24 voxels radius; the normals point outwards.
std::vector<AreaElement> ball_parts(double below, double side, const Vec3& at) {
  constexpr std::size_t kParts = 3000;
  constexpr double kRadius = 24.0;
  Random random(5);
  std::vector<AreaElement> parts;
  const double area = 4.0 * std::numbers::pi * kRadius * kRadius / static_cast<double>(kParts);
  for (std::size_t i = 0; i < kParts; ++i) {
    const Vec3 n = by_chance_on_ball(random);
    if (n.z() > below) continue;
    parts.push_back({(at + kRadius * n).cast<float>(), (side * area * n).cast<float>()});
  }
  return parts;
}

TEST(CloudSmoothSides, TheShareOfDirectionsTellsInsideFromOutside) {
  const Vec3 at(100.0, -40.0, 7.0);
  const std::vector<AreaElement> ball = ball_parts(2.0, 1.0, at), turned = ball_parts(2.0, -1.0, at);
  for (const Vec3& d : {Vec3(0, 0, 0), Vec3(10, 5, -8), Vec3(0, -14, 3)}) {
    EXPECT_NEAR(winding_number(ball, at + d), 1.0, 0.05);
    EXPECT_NEAR(winding_number(turned, at + d), -1.0, 0.05);
  }
  for (const Vec3& d : {Vec3(40, 0, 0), Vec3(-25, 25, 0), Vec3(300, 200, -90)})
    EXPECT_NEAR(winding_number(ball, at + d), 0.0, 0.05);
}

TEST(CloudSmoothSides, WhatIsFarCountsByItsSum) {
  const Vec3 at(100.0, -40.0, 7.0);
  std::vector<AreaElement> open = ball_parts(0.3, 1.0, at);
  std::sort(open.begin(), open.end(), [](const AreaElement& a, const AreaElement& b) {
    return std::pair(std::floor(a.middle.x()), a.middle.y()) <
           std::pair(std::floor(b.middle.x()), b.middle.y());
  });
  const geometry::SurfaceParts tree(open), none{std::vector<AreaElement>()};
  Random random(8);
  for (int i = 0; i < 2000; ++i) {
    const Vec3 d = 50.0 * random.uniform() * by_chance_on_ball(random);
    EXPECT_NEAR(tree.winding_number(at + d), winding_number(open, at + d), 0.01) << d.transpose();
    EXPECT_EQ(none.winding_number(at + d), 0.0);
  }
}

TEST(CloudSmoothSides, ABallIsClosedUntilAQuarterOfItIsGone) {
  const Vec3 at(3.0, 60.0, 7.0);
  for (const double side : {1.0, -1.0}) {
    for (const double below : {2.0, 0.95, 0.8, 0.65})
      EXPECT_EQ(normal_orientation(ball_parts(below, side, at)), static_cast<float>(side)) << below;
    for (const double below : {0.3, 0.0, -0.5})
      EXPECT_EQ(normal_orientation(ball_parts(below, side, at)), 0.0f);
  }
  EXPECT_EQ(normal_orientation({}), 0.0f);
}

/// Points by chance on a ball, with noise, in the directions that `keep` keeps.
std::vector<Vec3> ball_points(std::size_t count, const std::function<bool(const Vec3&)>& keep) {
  Random random(17);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 n = by_chance_on_ball(random);
    const double off = 0.02 * random.normal();
    if (keep(n)) points.push_back((kBall + off) * n);
  }
  return points;
}

/// The frames in which the probe is held on its way between two places, in steps of 0.02 mm.
int held_frames(test::Stepped& renderer, const Vec3& from, const Vec3& to) {
  const int steps = static_cast<int>((to - from).norm() / 0.02);
  int held = 0;
  for (int i = 1; i <= steps; ++i)
    held += renderer->step(from + (to - from) * (static_cast<double>(i) / steps), 0.001).contact;
  return held;
}

/// The mouth is 30 degrees about z: a fifteenth of the ball.
test::Stepped ball_with_a_mouth() {
  return prepared(cloud_of(ball_points(30000, [](const Vec3& n) { return n.z() < 0.866; })), "cloud-smooth");
}

TEST(CloudSmoothSides, ABallWithAMouthIsFeltFromOutsideAloneWhereTheReplayBeginsThere) {
  test::Stepped renderer = ball_with_a_mouth();
  const Vec3 above(0, 0, kBall + 3.0);
  renderer->restart(above);
  EXPECT_EQ(held_frames(renderer, above, Vec3(0, 0, 0)), 0);
  // Out through the wall, from behind.
  for (const Vec3& way : {Vec3(1, 0, 0), Vec3(0.3, -0.9, -0.2), Vec3(0, 0.1, -1)}) {
    const Vec3 out = (kBall + 2.0) * way.normalized();
    EXPECT_EQ(held_frames(renderer, Vec3(0, 0, 0), out), 0);
    // And in again, which is felt.
    EXPECT_NEAR(held_frames(renderer, out, 0.5 * out), (0.5 * (kBall + 2.0) - 2.0) / 0.02, 5);
    renderer->release_contact(Vec3(0, 0, 0));
  }
}

TEST(CloudSmoothSides, ABallWithAMouthIsFeltFromInsideWhereTheReplayBeginsThere) {
  test::Stepped renderer = ball_with_a_mouth();
  for (const Vec3& begin : {Vec3(0, 0, 0), Vec3(kBall - 0.4, 0, 0)}) {
    renderer->restart(begin);
    EXPECT_NEAR(held_frames(renderer, begin, Vec3(kBall + 1.0, 0, 0)), 1.0 / 0.02, 5);
  }
}

/// A field errs by a third of a spacing at thin walls: who begins in front of one may seem to be behind it.
TEST(CloudSmoothSides, WhoBeginsJustBehindTheSurfaceFeelsItFromOutside) {
  test::Stepped renderer = ball_with_a_mouth();
  const double spacing = std::sqrt(4.0 * std::numbers::pi * kBall * kBall / 30000.0);
  const Vec3 begin(kBall - 0.3 * spacing, 0, 0), out(kBall + 1.0, 0, 0);
  renderer->restart(begin);
  held_frames(renderer, begin, out);
  EXPECT_NEAR(held_frames(renderer, out, Vec3(kBall - 1.0, 0, 0)), 1.0 / 0.02, 5);
}

TEST(CloudSmoothSides, AHalfBallIsFeltFromBothSides) {
  test::Stepped renderer =
      prepared(cloud_of(ball_points(30000, [](const Vec3& n) { return n.z() < 0.0; })), "cloud-smooth");
  const Vec3 below(0, 0, -kBall - 1.0), above(0, 0, 1.0);
  renderer->restart(below);
  EXPECT_NEAR(held_frames(renderer, below, Vec3(0, 0, -kBall + 1.0)), 1.0 / 0.02, 5);
  renderer->release_contact(above);
  EXPECT_NEAR(held_frames(renderer, above, Vec3(0, 0, -kBall - 1.0)), 1.0 / 0.02, 5);
}

TEST(CloudSmoothSides, ComingOutOfAHoleDoesNotCatchTheProbe) {
  // Twelve holes of 9 degrees: the probe goes in by one, and out through the wall.
  Random random(23);
  std::vector<Vec3> holes;
  for (int i = 0; i < 12; ++i) holes.push_back(by_chance_on_ball(random));
  const auto whole = [&](const Vec3& n) {
    return std::none_of(holes.begin(), holes.end(), [&](const Vec3& hole) { return n.dot(hole) > 0.9877; });
  };
  test::Stepped renderer = prepared(cloud_of(ball_points(40000, whole)), "cloud-smooth");
  renderer->restart((kBall + 1.0) * holes[0]);
  int caught = 0;
  for (const Vec3& hole : holes) {
    renderer->release_contact((kBall + 1.0) * hole);
    const Vec3 in = (kBall - 1.5) * hole;
    const Vec3 aside = (hole + 0.6 * hole.unitOrthogonal()).normalized();
    const int held = held_frames(renderer, (kBall + 1.0) * hole, in) +
                     held_frames(renderer, in, (kBall - 1.5) * aside) +
                     held_frames(renderer, (kBall - 1.5) * aside, (kBall + 1.0) * aside);
    caught += held > 0;
  }
  // Beside the brim of a hole the surface goes on for a spacing or two, and pushes the probe out again.
  EXPECT_LE(caught, 2);
}

/// A vase about z with a wall of 2.5 spacings: the radius of the wall's middle at a share of its height.
constexpr double kVaseHeight = 70.0, kVaseWall = 1.8;
double vase_radius(double height) {
  return 20.0 + 10.0 * std::sin(3.2 * height) * (1.0 - 0.3 * height);
}
std::vector<Vec3> vase_points() {
  constexpr double kSpacing = kVaseWall / 2.5, kFloor = 3.0;
  Random random(29);
  std::vector<Vec3> points;
  const auto ring = [&](double radius, double z, bool jitters_along_z) {
    const int count = std::max(static_cast<int>(2.0 * std::numbers::pi * radius / kSpacing), 1);
    for (int i = 0; i < count; ++i) {
      const double turn = 2.0 * std::numbers::pi * (i + random.uniform(0.0, 0.8)) / count,
                   off = random.uniform(-0.4, 0.4) * kSpacing;
      const double r = jitters_along_z
                           ? vase_radius((z + off) / kVaseHeight) + radius - vase_radius(z / kVaseHeight)
                           : radius + off;
      points.push_back({r * std::cos(turn), r * std::sin(turn), jitters_along_z ? z + off : z});
    }
  };
  for (double z = 0.5 * kSpacing; z < kVaseHeight - 0.4 * kSpacing; z += kSpacing) {
    ring(vase_radius(z / kVaseHeight) + 0.5 * kVaseWall, z, true);
    if (z > kFloor + 0.4 * kSpacing) ring(vase_radius(z / kVaseHeight) - 0.5 * kVaseWall, z, true);
  }
  const auto disc = [&](double from, double to, double z) {
    for (double r = from + 0.5 * kSpacing; r < to - 0.4 * kSpacing; r += kSpacing) ring(r, z, false);
  };
  disc(0.0, vase_radius(0.0) + 0.5 * kVaseWall, 0.0);
  disc(0.0, vase_radius(kFloor / kVaseHeight) - 0.5 * kVaseWall, kFloor);
  disc(vase_radius(1.0) - 0.5 * kVaseWall, vase_radius(1.0) + 0.5 * kVaseWall, kVaseHeight);
  return points;
}

// From the inner side of its wall no direction leads out, so its faces say by their edges what is inside.
TEST(CloudSmoothSides, AVaseIsFeltOnBothSidesOfItsWallAndOnItsRim) {
  test::Stepped renderer = prepared(cloud_of(vase_points()), "cloud-smooth");
  int rightly = 0, all = 0;
  const auto poke = [&](const Vec3& from, const Vec3& surface, const Vec3& in) {
    renderer->restart(from);
    // From 0.15 mm above the surface to 0.15 mm below it, for edges and jitter.
    rightly += held_frames(renderer, from, surface - 0.15 * in) == 0 &&
                       held_frames(renderer, surface - 0.15 * in, surface + 0.4 * in) > 10
                   ? 1
                   : 0;
    ++all;
  };
  for (int i = 0; i < 40; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / 40.0, z = 8.0 + 1.4 * i;
    const Vec3 out(std::cos(turn), std::sin(turn), 0.0), up(0, 0, 1);
    const double r = vase_radius(z / kVaseHeight);
    poke((r - 6.0) * out + z * up, (r - 0.5 * kVaseWall) * out + z * up, out);
    poke((r + 6.0) * out + z * up, (r + 0.5 * kVaseWall) * out + z * up, -out);
    const Vec3 rim = vase_radius(1.0) * out + kVaseHeight * up;
    poke(rim + 4.0 * up, rim, -up);
  }
  EXPECT_EQ(rightly, all);
}

}  // namespace
}  // namespace palpate::spline_sdf
