#include <gtest/gtest.h>

#include <palpate/paths.h>
#include <palpate/replay.h>
#include "baselines/reference/facet_tree.h"
#include "baselines/reference/mesh_reference.h"
#include "tests/baselines/indexed.h"
#include "tests/baselines/stand.h"

namespace palpate::baselines {
namespace {

constexpr std::uint64_t kSeed = 99;

trace::ProbePath path_over(double depth, std::size_t frames) {
  trace::ProbePath path;
  path.name = "test";
  for (std::size_t i = 0; i < frames; ++i) {
    const double t = static_cast<double>(i) * 1e-3;
    const double x = 30 * std::sin(0.5 * t), y = 30 * std::sin(0.8 * t + 0.4);
    path.t_s.push_back(t);
    path.hip_mm.push_back(
        {x, y, test::sinusoid(x, y) + (depth + 0.4) / 2 * std::cos(7 * t) - (depth - 0.4) / 2});
  }
  return path;
}

TEST(FacetTree, ClosestAndCrossingAgreeWithBruteForce) {
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  auto mesh = SurfaceMesh::build(test::height_mesh(20, 50.0, test::sinusoid), 1);
  ASSERT_TRUE(mesh.ok());
  const FacetTree tree(*mesh);
  for (int i = 0; i < 500; ++i) {
    const Vec3 p{random.uniform(-60, 60), random.uniform(-60, 60), random.uniform(-60, 60)};
    const double least = test::least_distance_sq(*mesh, p);
    EXPECT_EQ(tree.closest(p).point.distance_sq, least);
    const Vec3 q{random.uniform(-45, 45), random.uniform(-45, 45), -60};
    EXPECT_NE(tree.first_crossing({q.x(), q.y(), 60}, q).facet, kNoFacet);
  }
}

TEST(MeshTruth, SignedDistanceOfABoxEverywhere) {
  RecordProperty("seed", static_cast<int>(kSeed));
  Random random(kSeed);
  const geometry::RigidTransform pose{Eigen::Quaterniond(0.3, 0.2, 0.9, -0.1).normalized(), Vec3(7, -8, 9)};
  auto truth = MeshTruth::build(test::box_mesh(1, 2, 3), pose);
  ASSERT_TRUE(truth.ok());
  for (int i = 0; i < 5000; ++i) {
    const Vec3 p{random.uniform(-3, 3), random.uniform(-4, 4), random.uniform(-5, 5)};
    const Vec3 d = p.cwiseAbs() - Vec3(1, 2, 3);
    const double expected = d.maxCoeff() < 0 ? d.maxCoeff() : d.cwiseMax(0.0).norm();
    ASSERT_NEAR((*truth)->signed_distance_mm(pose * p), expected, 1e-9);
  }
}

TEST(MeshReference, AgreesWithTheClosestPointAndWithTheRenderer) {
  const geometry::TriangleMesh mesh = test::height_mesh(250, 50.0, test::sinusoid);
  const trace::ProbePath path = path_over(1.0, 6000);
  auto truth = MeshTruth::build(mesh, {});
  ASSERT_TRUE(truth.ok());
  auto reference = mesh_reference(**truth, path, 0.5, 0.0, no_progress());
  ASSERT_TRUE(reference.ok()) << reference.error().message();
  ASSERT_EQ(reference->frames.size(), path.size());
  EXPECT_NE(reference->exactness.find("in 0 another part"), std::string::npos) << reference->exactness;

  const test::Probe probe = test::prepare(test::model_of(mesh), "mesh-godobject:mesh=original");
  auto trace = trace::replay(*probe.renderer, path);
  ASSERT_TRUE(trace.ok());
  std::size_t contact = 0, differ = 0;
  double worst = 0.0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const render::Frame& mine = trace->frames[i];
    const render::Frame& true_frame = reference->frames[i].frame;
    contact += mine.contact;
    differ += mine.contact != true_frame.contact;
    if (mine.contact && true_frame.contact)
      worst = std::max(worst, (mine.force_n - true_frame.force_n).norm());
  }
  EXPECT_GT(contact, 2000u);
  EXPECT_LE(differ, 2u);     // the float margin at entries
  EXPECT_LT(worst, 0.0275);  // under a hill two neighbouring facets can both hold a local minimum
}

TEST(MeshReference, AgreesWithTheFormulaOnASphere) {
  const auto model = test::generated("sphere:points=20000");
  paths::PathTarget target;
  target.surface = model.surface.get();
  target.box_mm = model.surface->box_mm();
  const auto path = paths::make_path(parse_named_options("weave:frames=1500").value(), target).value();
  const auto truth = MeshTruth::build(*model.original_mesh, {}).value();
  const auto reference = mesh_reference(*truth, path, 0.5, 0, no_progress()).value();
  std::size_t contacts = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    // Chords lie below the sphere by at most s^2 / (4 R), far below this.
    EXPECT_NEAR(reference.frames[i].signed_distance_mm, model.surface->signed_distance_mm(path.hip_mm[i]),
                0.05);
    contacts += reference.frames[i].frame.contact;
  }
  EXPECT_GT(contacts, 700u);
}

}  // namespace
}  // namespace palpate::baselines
