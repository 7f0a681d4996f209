// Friction, deformation and texture: laws that hold whatever the points are.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include <palpate/registry.h>
#include "tests/stepped.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {
namespace {

/// A plane of 40 x 40 mm around the origin, z = 0.
Scene plane(double spacing_mm = 0.2) {
  return generated("plane:extent_mm=40:spacing_mm=" + std::to_string(spacing_mm));
}

/// The HIP goes from point to point in a straight line.
std::vector<Vec3> way(const std::vector<Vec3>& corners, int frames) {
  std::vector<Vec3> hips;
  for (std::size_t i = 0; i + 1 < corners.size(); ++i)
    for (int k = 0; k < frames; ++k)
      hips.push_back(corners[i] + (corners[i + 1] - corners[i]) * (static_cast<double>(k) / frames));
  hips.push_back(corners.back());
  return hips;
}

std::vector<Frame> frames_along(const test::Stepped& renderer, const std::vector<Vec3>& hips) {
  std::vector<Frame> frames;
  renderer->restart(hips.front());
  for (const Vec3& h : hips) frames.push_back(renderer->step(h, 1e-3));
  return frames;
}

/// The middle of the plane's surface in the generated frame.
Vec3 middle(const Scene& scene) {
  const geometry::Aabb box = scene.input.models[0].cloud->box_mm();
  return 0.5 * (box.low_mm + box.high_mm);
}

/// A plane with a friction of its own under a renderer, and its middle.
struct Rubbed {
  Rubbed(const surface::Friction& friction, const char* spec = "cloud", double spacing_mm = 0.2)
      : scene(plane(spacing_mm)), m(middle(scene)) {
    scene.input.models[0].surface.friction = friction;
    renderer = prepared(scene.input, spec);
  }
  Scene scene;
  Vec3 m;
  test::Stepped renderer;
};

TEST(Friction, StaticHoldsUntilItsConeAndDynamicAfter) {
  const Rubbed on({0.8, 0.4});
  const Vec3& m = on.m;
  const auto frames =
      frames_along(on.renderer, way({m + Vec3(0, 0, 1), m + Vec3(0, 0, -1), m + Vec3(5, 0, -1)}, 5000));
  double most = 0.0;
  for (const Frame& f : frames)
    if (f.contact && f.force_n.z() > 0) most = std::max(most, f.force_n.head<2>().norm() / f.force_n.z());
  EXPECT_NEAR(most, 0.8, 0.01);
  EXPECT_NEAR(frames.back().force_n.head<2>().norm() / frames.back().force_n.z(), 0.4, 1e-9);
  // One transition, no chatter: the ratio falls by half exactly once.
  int drops = 0;
  for (std::size_t i = 5001; i + 1 < frames.size(); ++i)
    drops += frames[i].force_n.head<2>().norm() > 1.5 * frames[i + 1].force_n.head<2>().norm();
  EXPECT_EQ(drops, 1);
}

TEST(Friction, AMinuteOfStickDriftsNowhere) {
  const Rubbed on({0.7, 0.5}, "cloud", 0.5);
  const Vec3& m = on.m;
  auto frames =
      frames_along(on.renderer, way({m + Vec3(0, 0, 1), m + Vec3(0, 0, -1), m + Vec3(0.3, 0.1, -1)}, 500));
  const Vec3 held = frames.back().god_object_mm;
  // A hand that trembles by 0.05 mm at 9 Hz, 60,000 frames of 1 ms.
  for (int i = 0; i < 60'000; ++i) {
    const double t = 1e-3 * i;
    const Vec3 tremor(0.05 * std::sin(56.0 * t), 0.05 * std::cos(49.0 * t), 0.02 * std::sin(61.0 * t));
    const Frame frame = on.renderer->step(m + Vec3(0.3, 0.1, -1) + tremor, 1e-3);
    ASSERT_TRUE(frame.contact);
    if (i % 1000 == 0) {
      ASSERT_LT((frame.god_object_mm - held).head<2>().norm(), 1e-9) << i;
    }
  }
}

TEST(Friction, NoiseAtTheTransitionDoesNotChatter) {
  const Rubbed on({0.7, 0.5});
  const Vec3& m = on.m;
  on.renderer->restart(m + Vec3(-8, 0, 1));
  (void)on.renderer->step(m + Vec3(-8, 0, -1), 1e-3);
  int falls = 0;
  double last = 0.0;
  for (int i = 0; i < 16'000; ++i) {
    // 1 mm/s, with the 0.055 mm steps of an encoder in depth.
    const double noise = 0.055 * ((i * 7919) % 3 - 1);
    const Frame f = on.renderer->step(m + Vec3(-8.0 + 1e-3 * i, 0, -1.0 + noise), 1e-3);
    const double across = f.force_n.head<2>().norm();
    falls += across < 0.85 * last;
    last = across;
  }
  EXPECT_EQ(falls, 1) << "the one transition from stick to slip";
}

// An exactly flat cloud lies on the border of its cells: the printed search, which looks into the cells of
// the segment alone, loses the contact right below it (3.1.4). Here and below its first remedy is on.
TEST(Friction, LiteralRollsBackAlongThePointsWithinTheCone) {
  const Rubbed on({0.7, 0.7}, "cloud-literal:shading=none:box_mm=0.15:cells=adjacent", 0.1);
  const Vec3& m = on.m;
  const auto frames =
      frames_along(on.renderer, way({m + Vec3(-9, 0, 1), m + Vec3(-9, 0, -1), m + Vec3(9, 0, -1)}, 4000));
  // 1 mm deep, points 0.1 mm apart. The nearest point lies within half a diagonal of the foot, so that the
  // depth that the cone is measured by is that much off too; the last point before the cone's rim is less
  // than a step along the grid away from it.
  const double spacing = 0.1, aside = spacing / std::sqrt(2.0);
  double most = 0.0;
  for (std::size_t i = 6000; i < frames.size(); ++i) {
    ASSERT_TRUE(frames[i].contact);
    const double ratio = frames[i].force_n.head<2>().norm() / frames[i].force_n.z();
    EXPECT_LE(ratio, 0.7 * std::sqrt(1.0 + aside * aside) + aside);
    EXPECT_GE(ratio, 0.7 - spacing - aside);
    most = std::max(most, ratio);
  }
  EXPECT_GE(most, 0.7) << "behind the foot by up to half a step more than the cone";
}

/// What a path of frames gave back: minus the sum of force times displacement, trapezoids, N mm.
double given_back(const std::vector<Vec3>& hips, const std::vector<Frame>& frames) {
  double work = 0.0;
  for (std::size_t i = 1; i < hips.size(); ++i)
    work += 0.5 * (frames[i - 1].force_n + frames[i].force_n).dot(hips[i] - hips[i - 1]);
  return work;
}

/// Half of the plane (x < middle) gives way.
Scene half_soft(double deformation) {
  Scene scene = plane();
  const cloud::Cloud& cloud = *scene.input.models[0].cloud;
  auto properties = std::make_shared<surface::PointProperties>();
  const double middle_x = middle(scene).x();
  for (std::size_t i = 0; i < cloud.size(); ++i)
    properties->deformation.push_back(cloud.point_mm(i).x() < middle_x ? static_cast<float>(deformation)
                                                                       : 0.0f);
  scene.input.models[0].surface.per_point = properties;
  return scene;
}

TEST(Deformation, ScalesTheForceAsFigure46) {
  Scene scene = half_soft(0.5);
  const Vec3 m = middle(scene);
  for (const char* name : {"cloud", "heightfield", "cloud-literal:shading=none:box_mm=0.25:cells=adjacent"}) {
    const auto renderer = prepared(scene.input, name);
    const auto soft = frames_along(renderer, way({m + Vec3(-15, 0, 1), m + Vec3(-15, 0, -1)}, 200));
    EXPECT_NEAR(soft.back().force_n.z(), 0.25, 0.25 * 1e-6) << name;
    const auto rigid = frames_along(renderer, way({m + Vec3(15, 0, 1), m + Vec3(15, 0, -1)}, 200));
    EXPECT_NEAR(rigid.back().force_n.z(), 0.5, 0.5 * 1e-6) << name;
  }
}

TEST(Deformation, BorderKicksInTheLiteralFormAndNotInOurs) {
  Scene scene = half_soft(0.5);
  const Vec3 m = middle(scene);
  // In on the soft side, across, out on the rigid side, and back: a closed way without friction.
  const auto hips = way({m + Vec3(-10, 0, 1), m + Vec3(-10, 0, -2), m + Vec3(10, 0, -2), m + Vec3(10, 0, 1),
                         m + Vec3(-10, 0, 1)},
                        8000);
  const double stored = 0.5 * 0.5 * 2.0 * 2.0;  // at the deepest on the rigid side
  const auto literal = prepared(scene.input, "cloud-literal:shading=none:box_mm=0.25:cells=adjacent");
  // Up to the surface only: beyond it the literal state sticks, which is another defect.
  const auto once =
      way({m + Vec3(-10, 0, 1), m + Vec3(-10, 0, -2), m + Vec3(10, 0, -2), m + Vec3(10, 0, 0)}, 8000);
  const double kick = given_back(once, frames_along(literal, once));
  EXPECT_NEAR(kick, 0.5 * 0.25 * 4.0, 0.005) << "section 3.3.2.3: half (1 - c) k d^2";
  // The other way round it must not swallow more than that either: it is a potential.
  auto back = hips;
  std::reverse(back.begin(), back.end());
  for (const char* name : {"cloud", "heightfield"}) {
    const auto ours = prepared(scene.input, name);
    EXPECT_LT(given_back(hips, frames_along(ours, hips)), 0.01 * stored) << name;
    EXPECT_NEAR(given_back(back, frames_along(ours, back)), 0.0, 0.01 * stored) << name;
  }
}

TEST(Deformation, StiffnessRisesNoFasterThanItsBlend) {
  SurfaceField field;
  std::vector<surface::OrientedPoint> points;
  std::vector<search::Neighbours> links;
  for (std::uint32_t i = 0; i < 100; ++i) {
    points.push_back({0.1f * static_cast<float>(i), 0, 0, surface::kNoNormal});
    search::Neighbours around;
    around.fill(i);
    if (i > 0) around[0] = i - 1;
    if (i < 99) around[1] = i + 1;
    links.push_back(around);
    field.by_point.push_back({i < 50 ? 0.25f : 0.75f, 0, 0});
  }
  EXPECT_EQ(blend_stiffness(field, points, links, 1.0), 9u);  // 1 mm is ten points, the tenth fits as it is
  for (std::uint32_t i = 0; i < 100; ++i) {
    const double expected = i < 50 ? 0.25 : std::min(0.75, 0.25 + 0.5 * 0.1 * (i - 49.0));
    EXPECT_NEAR(static_cast<double>(field.by_point[i].stiffness_n_per_mm), expected, 1e-5) << i;
  }
}

surface::Texture textured(surface::TextureKind kind) {
  surface::Texture t;
  t.kind = kind;
  t.depth_mm = 0.1;
  t.wavelength_mm = 2.0;
  t.axis = Vec3(0.6, 0.8, 0);
  if (kind == surface::TextureKind::kImage) {
    auto image = std::make_shared<surface::TextureImage>();
    image->columns = 20;
    image->rows = 10;
    for (std::uint32_t i = 0; i < 200; ++i)
      image->height.push_back(
          static_cast<std::uint16_t>(32768.0 * (1.0 + std::sin(0.314159265 * (i % 20)) * 0.9)));
    t.image = image;
  }
  return t;
}

TEST(Texture, SlopeIsTheGradientOfTheDepth) {
  using enum surface::TextureKind;
  for (const auto kind : {kGrating, kNoise, kImage}) {
    const surface::Texture t = textured(kind);
    const Vec3 n = Vec3(0.2, -0.3, 0.9).normalized();
    for (int i = 0; i < 200; ++i) {
      const Vec3 p(0.173 * i + 0.0123, -0.091 * i + 0.0061, 0.057 * i + 0.0037);
      const surface::Relief here = t.at(p, n);
      EXPECT_GE(here.depth_mm, -1e-12);
      EXPECT_LE(here.depth_mm, t.depth_mm + 1e-12);
      EXPECT_LE(here.slope.norm(), t.steepest() * (1 + 1e-9) + 1e-12);
      for (int axis = 0; axis < 3; ++axis) {
        Vec3 e = Vec3::Zero();
        e[axis] = 1e-6;
        const double slope = (t.at(p + e, n).depth_mm - t.at(p - e, n).depth_mm) / 2e-6;
        EXPECT_NEAR(slope, here.slope[axis], 1e-4) << static_cast<int>(kind) << " at " << i;
      }
    }
  }
}

TEST(Texture, NoiseHasItsWavelengthAlongEveryLine) {
  Random random(43);
  surface::Texture t = textured(surface::TextureKind::kNoise);
  const auto unit = [&] { return Vec3(random.normal(), random.normal(), random.normal()).normalized(); };
  for (const double wavelength_mm : {2.0, 2e-3, 2e6}) {
    t.wavelength_mm = wavelength_mm;
    double length = 0.0, crossings = 0.0;
    for (int line = 0; line < 60; ++line) {
      t.seed = 1 + static_cast<std::uint64_t>(line / 6);
      const Vec3 along = line % 6 < 3 ? Vec3(Vec3::Unit(line % 6)) : unit();  // the axes too: no lattice
      const Vec3 from = 100.0 * wavelength_mm * unit();
      constexpr int kSteps = 12'500, kAWave = 25;
      int here = 0;
      double before = 0.0;
      for (int i = 0; i <= kSteps; ++i) {
        const Vec3 p = from + along * (wavelength_mm * i / kAWave);
        const double over = t.at(p, Vec3::UnitZ()).depth_mm - 0.5 * t.depth_mm;
        here += i > 0 && (over > 0.0) != (before > 0.0);
        before = over;
      }
      const double waves = static_cast<double>(kSteps) / kAWave;
      // Rice's rate is that of many waves; six of them scatter around it by up to a sixth from line to line.
      EXPECT_NEAR(0.5 * here, waves, 0.2 * waves) << "seed 43, line " << line;
      length += waves;
      crossings += here;
    }
    EXPECT_NEAR(0.5 * crossings, length, 0.03 * length) << wavelength_mm << " mm";
  }
}

// At multiples of the wavelength, of its half and quarter the noise is as steep and as varied as anywhere.
TEST(Texture, NoiseKnowsNoLattice) {
  surface::Texture t = textured(surface::TextureKind::kNoise);
  Random random(47);
  const auto spread = [&](double share) {
    double steep = 0.0, mean = 0.0, square = 0.0;
    constexpr int kEdge = 20;
    for (int i = 0; i < kEdge * kEdge * kEdge; ++i) {
      const Vec3 cell(i % kEdge, i / kEdge % kEdge, i / (kEdge * kEdge));
      const Vec3 inside =
          share > 0.0 ? Vec3::Zero() : Vec3(random.uniform(), random.uniform(), random.uniform());
      const surface::Relief here =
          t.at((share > 0.0 ? share : 1.0) * t.wavelength_mm * (cell + inside), Vec3::UnitZ());
      steep += here.slope.squaredNorm();
      mean += here.depth_mm;
      square += here.depth_mm * here.depth_mm;
    }
    constexpr double kCount = kEdge * kEdge * kEdge;
    mean /= kCount;
    return std::pair{std::sqrt(steep / kCount), std::sqrt(square / kCount - mean * mean)};
  };
  const auto anywhere = spread(0.0);
  EXPECT_GT(anywhere.second, 0.1 * t.depth_mm);
  for (const double share : {1.0, 0.5, 0.25, 0.57735026918962573}) {
    const auto there = spread(share);
    EXPECT_NEAR(there.first, anywhere.first, 0.1 * anywhere.first) << share << ", seed 47";
    EXPECT_NEAR(there.second, anywhere.second, 0.1 * anywhere.second) << share << ", seed 47";
  }
}

TEST(Texture, NoiseIsItsSeedsAlone) {
  surface::Texture a = textured(surface::TextureKind::kNoise), b = a;
  b.seed = a.seed + 1;
  double apart = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const Vec3 p(0.37 * i, -0.11 * i, 0.05 * i);
    EXPECT_EQ(a.at(p, Vec3::UnitZ()).depth_mm, a.at(p, Vec3::UnitX()).depth_mm);
    apart += std::abs(a.at(p, Vec3::UnitZ()).depth_mm - b.at(p, Vec3::UnitZ()).depth_mm) / 1000;
  }
  EXPECT_GT(apart, 0.05 * a.depth_mm);
  // Far beyond where waves can be told apart it stays within its bounds.
  for (const double far : {1e12, 1e16, 1e300}) {
    const surface::Relief there = a.at(Vec3(far, -far, 0.3 * far), Vec3::UnitZ());
    EXPECT_TRUE(there.depth_mm >= 0.0 && there.depth_mm <= a.depth_mm) << far;
    EXPECT_TRUE(is_finite(there.slope)) << far;
  }
}

TEST(Texture, MakesNoEnergyAndIsFelt) {
  using enum surface::TextureKind;
  for (const auto kind : {kGrating, kNoise, kImage}) {
    Scene scene = plane();
    scene.input.models[0].surface.texture = textured(kind);
    const Vec3 m = middle(scene);
    const auto renderer = prepared(scene.input, "cloud");
    const auto hips = way({m + Vec3(-5, 0.1, 1), m + Vec3(-5, 0.1, -1), m + Vec3(5, 0.7, -1),
                           m + Vec3(5, 0.7, 1), m + Vec3(-5, 0.1, 1)},
                          8000);
    const auto frames = frames_along(renderer, hips);
    EXPECT_NEAR(given_back(hips, frames), 0.0, 0.01 * 0.25) << static_cast<int>(kind);
    double least = 1e9, most = 0.0;
    for (std::size_t i = 8000; i < 16000; ++i) {
      least = std::min(least, frames[i].force_n.z());
      most = std::max(most, frames[i].force_n.z());
    }
    // Of the depth, 0.1 mm, as force: a grating and an image go all the way down on this line. Six waves of
    // noise are seldom all up or down: their mean square is a twelfth of one's, +- 1.3 of its root a third.
    const double share = kind == kNoise ? 1.0 / 3.0 : 0.4;
    EXPECT_GT(most - least, 0.5 * 0.1 * share) << static_cast<int>(kind);
  }
}

TEST(Texture, TurningTheForceKeepsItsSize) {
  Scene scene = plane();
  scene.input.models[0].surface.texture = textured(surface::TextureKind::kGrating);
  scene.input.models[0].surface.texture.effect = surface::TextureEffect::kForce;
  const Vec3 m = middle(scene);
  const auto renderer = prepared(scene.input, "cloud");
  const auto frames =
      frames_along(renderer, way({m + Vec3(-5, 0, 1), m + Vec3(-5, 0, -1), m + Vec3(5, 0, -1)}, 2000));
  double aside = 0.0;
  for (std::size_t i = 2000; i < frames.size(); ++i) {
    EXPECT_NEAR(frames[i].force_n.norm(), 0.5, 1e-6);
    aside = std::max(aside, frames[i].force_n.head<2>().norm());
  }
  EXPECT_GT(aside, 0.05);
}

TEST(Texture, TooSteepAReliefIsMadeFlatter) {
  Scene scene = plane();
  scene.input.models[0].surface.texture = textured(surface::TextureKind::kGrating);
  scene.input.models[0].surface.texture.depth_mm = 5.0;
  PrepareReport report;
  const auto field = test::value_of(build_uniform_surface_field(scene.input.models[0].surface, report));
  EXPECT_NEAR(field.texture.steepest(), surface::kMaxTextureSlope, 1e-12);
  EXPECT_EQ(report.notes.size(), 1u);
}

TEST(Properties, WrongValuesAreRefused) {
  using surface::Surface;
  const auto per_point = [](std::vector<float> deformation, std::vector<float> stiffness) {
    auto p = std::make_shared<surface::PointProperties>();
    p->deformation = std::move(deformation);
    p->stiffness_n_per_mm = std::move(stiffness);
    return p;
  };
  const std::function<void(Surface&)> changes[] = {
      [](Surface& s) { s.stiffness_n_per_mm = -1; },
      [](Surface& s) { s.stiffness_n_per_mm = 0; },
      [](Surface& s) {
        s.friction = {0.3, 0.5};
      },
      [](Surface& s) {
        s.friction = {-0.3, -0.5};
      },
      [](Surface& s) {
        s.friction = {std::nan(""), 0.5};
      },
      [](Surface& s) { s.deformation = 1.0; },
      [](Surface& s) { s.texture.kind = surface::TextureKind::kGrating; },
      [](Surface& s) { s.texture = textured(surface::TextureKind::kImage), s.texture.image = nullptr; },
      [&](Surface& s) { s.per_point = per_point({0.5f}, {}); },
      [&](Surface& s) { s.per_point = per_point({}, std::vector<float>(441, 0.0f)); }};
  for (const auto& change : changes)
    for (const char* name : {"cloud", "cloud-literal"}) {
      Scene scene = plane(2.0);
      change(scene.input.models[0].surface);
      EXPECT_FALSE(prepare_report(scene.input, name)) << &change - changes;
    }
}

}  // namespace
}  // namespace palpate::render
