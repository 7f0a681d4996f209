// The jam test: held still anywhere on a dense mesh, a frictionless proxy comes to rest, and rests where the
// pull is one that the facets it touches can bear. Small meshes; the full one is mesh_jam's.
#include <gtest/gtest.h>

#include "baselines/reference/rest.h"
#include "tests/baselines/stand.h"

namespace palpate::baselines {
namespace {

using test::make;
using test::Probe;

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
