#include <gtest/gtest.h>

#include "baselines/proximity/crossings.h"
#include "tests/baselines/indexed.h"
#include "toolkit/core/random.h"

namespace palpate::baselines {
namespace {

constexpr std::uint64_t kSeed = 20240607;

/// Segments through vertices, edges and facets of a bumpy surface, at several scales, near and far from the
/// origin: not one may miss.
TEST(SegmentIndex, NoSegmentSlipsThroughEdgesOrVertices) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const geometry::TriangleMesh unit = test::height_mesh(60, 50.0, test::sinusoid);
  std::size_t tried = 0, missed = 0;
  for (const double scale : {1e-3, 1.0, 1e6})
    for (const double shift : {0.0, 1e5}) {
      const geometry::RigidTransform motion{Eigen::Quaterniond(0.5, 0.1, -0.7, 0.3).normalized(),
                                            Vec3::Constant(shift * scale)};
      const test::Indexed built = test::indexed(test::moved(unit, motion, scale));
      const double reach = 3.0 * scale;
      for (int i = 0; i < 30000; ++i) {
        const auto f = static_cast<std::uint32_t>(random.below(built.mesh->facets().size()));
        const Facet& facet = built.mesh->facet(f);
        const auto corner = static_cast<std::uint32_t>(random.below(3));
        Vec3 aim = facet.corner[corner];
        if (i % 2 == 1) aim += (facet.corner[after(corner)] - aim) * random.uniform();
        bool boundary = false;
        for (std::uint32_t c = 0; c < 3; ++c)
          boundary |= built.mesh->around_corner(half_facet(f, 0), c, [](HalfFacet) {});
        if (boundary) continue;
        const Vec3 n = built.mesh->normal(half_facet(f, 0));
        const Vec3 along = Vec3(random.normal(), random.normal(), random.normal()).cross(n).normalized();
        const Vec3 way = (n + along * random.uniform(0.0, 0.8)).normalized() * reach;
        ++tried;
        missed += !built.index->first_hit(aim + way, aim - way).has_value();
      }
    }
  EXPECT_GT(tried, 100000u);
  EXPECT_EQ(missed, 0u);
}

/// A path in small steps across the surface, its joints on the surface itself as often as not: some step must
/// meet it.
TEST(SegmentIndex, ChainsOfSegmentsMeetTheSurface) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const test::Indexed built = test::indexed(test::height_mesh(40, 50.0, test::sinusoid));
  std::size_t missed = 0;
  constexpr int kChains = 20000;
  for (int i = 0; i < kChains; ++i) {
    const auto f = static_cast<std::uint32_t>(random.below(built.mesh->facets().size()));
    const Facet& facet = built.mesh->facet(f);
    const Vec3 joint = i % 2 == 0 ? facet.corner[0] : Vec3((facet.corner[0] + facet.corner[1]) / 2);
    if (joint.head<2>().cwiseAbs().maxCoeff() > 45.0) continue;
    const Vec3 above = joint + Vec3(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1.0);
    const Vec3 below = joint - Vec3(random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), 1.0);
    missed += !built.index->first_hit(above, joint) && !built.index->first_hit(joint, below);
  }
  EXPECT_EQ(missed, 0u);
}

TEST(SegmentIndex, WithinAndNearestAgreeWithBruteForce) {
  RecordProperty("seed", std::to_string(kSeed));
  Random random(kSeed);
  const test::Indexed built = test::indexed(test::height_mesh(20, 50.0, test::sinusoid));
  for (int i = 0; i < 300; ++i) {
    const Vec3 p{random.uniform(-40, 40), random.uniform(-40, 40), random.uniform(-30, 30)};
    const double least = test::least_distance_sq(*built.mesh, p);
    const std::uint32_t near = built.index->nearest(p, 200.0);
    ASSERT_NE(near, kNoFacet);
    EXPECT_NEAR(closest_on_facet(built.mesh->facet(near), p).distance_sq, least, 1e-9 * least);
    EXPECT_TRUE(built.index->within(p, std::sqrt(least) * 1.001 + 1e-9));
    EXPECT_FALSE(built.index->within(p, std::sqrt(least) * 0.999));
  }
}

TEST(Crossings, TwoCrossingSheetsAreFoundAndAFoldedOneHasNone) {
  const test::Indexed crossing = test::indexed(test::crossing_sheets(8));
  const Crossings found = Crossings::find(*crossing.mesh, *crossing.index, 1);
  EXPECT_TRUE(found.any());
  for (std::uint32_t f = 0; f < crossing.mesh->facets().size(); ++f)
    for (const std::uint32_t g : found.of(f)) EXPECT_NE(f < 128, g < 128);
  const test::Indexed single = test::indexed(test::height_mesh(30, 50.0, test::sinusoid));
  EXPECT_FALSE(Crossings::find(*single.mesh, *single.index, 2).any());
}

}  // namespace
}  // namespace palpate::baselines
