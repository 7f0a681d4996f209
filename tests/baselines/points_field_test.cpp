// `vgraph` and `vector-field` against brute force and formulas.
#include <algorithm>

#include "baselines/points/voxel_field.h"
#include "baselines/reconstruct/mesh_tidy.h"
#include "tests/baselines/stand.h"
#include "toolkit/voronoi/voronoi.h"

namespace palpate::test {
namespace {

TEST(VGraph, GreedyWalksOnItsGraphEndAtTheNearestPoint) {
  Random random(3);
  std::vector<Vec3> points;
  for (int i = 0; i < 800; ++i)
    points.push_back({random.uniform(-5, 5), random.uniform(-5, 5), random.uniform(-1, 1)});
  points.push_back(points[7]);  // two at one place
  const auto links = voronoi::natural_links(points).value();
  ASSERT_EQ(links.begin.size(), points.size() + 1);
  for (std::uint32_t i = 0; i < points.size(); ++i)
    for (const std::uint32_t other : links.of(i)) {
      const auto back = links.of(other);
      ASSERT_NE(std::find(back.begin(), back.end(), i), back.end()) << "links go both ways";
    }
  for (int k = 0; k < 1000; ++k) {
    const Vec3 h(random.uniform(-7, 7), random.uniform(-7, 7), random.uniform(-3, 3));
    std::uint32_t at = static_cast<std::uint32_t>(random.uniform(0.0, 800.0));
    if (links.of(at).empty()) continue;  // the other of the two
    const auto distance = [&](std::uint32_t i) { return (points[i] - h).norm(); };
    for (std::uint32_t from = at + 1; from != at;) {
      from = at;
      for (const std::uint32_t other : links.of(from))
        if (distance(other) < distance(at)) at = other;
    }
    double best = HUGE_VAL;
    for (const Vec3& p : points) best = std::min(best, (p - h).norm());
    ASSERT_DOUBLE_EQ(distance(at), best) << k;
  }
}

TEST(VGraph, FlatMeshIsExactFromBothSides) {
  const render::ModelInput model = model_of(flat_mesh(20, 10.0));
  for (const char* options :
       {"vgraph:mesh=original", "vgraph:mesh=original:graph=mesh", "vgraph:mesh=original:triangles=ring"}) {
    const Probe rival = prepare(model, options);
    for (const double side : {1.0, -1.0}) {
      rival.renderer->restart({0.3, 0.4, side});
      EXPECT_FALSE(rival.to({0.3, 0.4, 0.1 * side}).contact);
      const render::Frame frame = rival.glide({0.3, 0.4, 0.1 * side}, {2.3, -1.4, -1.0 * side}, 0.05);
      ASSERT_TRUE(frame.contact) << options;
      EXPECT_NEAR((frame.force_n - Vec3(0, 0, kStiffness * side)).norm(), 0.0, 1e-9);
      EXPECT_FALSE(rival.to({2.3, -1.4, 0.5 * side}).contact);
    }
  }
}

TEST(VGraph, ConstrainsAsZillesAndSalisburyDo) {
  // A groove holds by two planes: the god object runs along its bottom.
  const Probe groove = prepare(model_of(height_mesh(20, 10.0, [](double x, double) { return std::abs(x); })),
                               "vgraph:mesh=original");
  const render::Frame frame = groove.press({0.2, 0.1, 3}, {0.1, 2.3, -1}, 0.05);
  ASSERT_TRUE(frame.contact);
  EXPECT_NEAR((frame.god_object_mm - Vec3(0, 2.3, 0)).norm(), 0.0, 1e-9);
}

TEST(VGraph, MissesWhatTheNearestVertexDoesNotShare) {
  // One long triangle: its middle is far from its corners, and a vertex of another sheet is nearer. As
  // printed the HIP passes.
  TriangleMesh mesh;
  mesh.vertices_mm = {{-10, -10, 0}, {10, -10, 0}, {0, 15, 0}, {0, 0, -3}, {1, 0, -3}, {0, 1, -3}};
  mesh.triangles = {{0, 1, 2}, {3, 4, 5}};
  const Probe rival = prepare(model_of(mesh), "vgraph:mesh=original");
  EXPECT_FALSE(rival.press({3, 0, 2}, {3, 0, -1}, 0.05).contact);
  EXPECT_TRUE(rival.press({-9, -9, 2}, {-9, -9, -1}, 0.05).contact);
}

TEST(FixedOrder, IsTheSameForAnyOrderAndOrientation) {
  TriangleMesh mesh = height_mesh(4, 2.0, [](double x, double) { return x; });
  // A second piece.
  const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.insert(mesh.vertices_mm.end(), {{9, 0, 0}, {9, 1, 0}, {9, 0, 1}});
  mesh.triangles.push_back({first, first + 1, first + 2});
  TriangleMesh a = mesh, b = mesh;
  std::reverse(b.triangles.begin(), b.triangles.end());
  for (auto& t : b.triangles) {
    std::rotate(t.begin(), t.begin() + 1, t.end());
    if (t[0] < first) std::swap(t[0], t[1]);  // the first piece turned over, the second not
  }
  baselines::fix_order(a);
  baselines::fix_order(b);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.triangles.size(), mesh.triangles.size());
  // Still oriented: no edge runs the same way twice.
  std::vector<std::pair<std::uint32_t, std::uint32_t>> edges;
  for (const auto& t : a.triangles)
    for (std::size_t i = 0; i < 3; ++i) edges.emplace_back(t[i], t[(i + 1) % 3]);
  std::sort(edges.begin(), edges.end());
  EXPECT_EQ(std::adjacent_find(edges.begin(), edges.end()), edges.end());
}

TEST(VoxelField, IsTrilinearAndExactOnPlanes) {
  const Vec3 n = Vec3(0.2, -0.3, 1.0).normalized();
  const auto points =
      height_points(41, 0.5, [&](double x, double y) { return -(n.x() * x + n.y() * y) / n.z(); });
  geometry::Aabb box;
  for (const Vec3& p : points) box.add(p);
  baselines::VoxelFieldOptions options;
  options.voxel_mm = 0.7;
  options.depth_mm = 5.0;
  const auto sample = [&](const Vec3& at, double, std::uint32_t&) {
    const double height = n.dot(at);
    const Vec3f pull = (-height * n).cast<float>();
    return baselines::FieldSample{pull.x(), pull.y(), pull.z(), static_cast<float>(height)};
  };
  const auto one = baselines::VoxelField::build([&](std::size_t i) { return points[i]; }, points.size(), box,
                                                options, sample, 1)
                       .value();
  const auto all = baselines::VoxelField::build([&](std::size_t i) { return points[i]; }, points.size(), box,
                                                options, sample, 0)
                       .value();
  EXPECT_EQ(one.bricks(), all.bricks());
  Random random(6);
  std::size_t known = 0;
  for (int i = 0; i < 5000; ++i) {
    const Vec3 at(random.uniform(-9, 9), random.uniform(-9, 9), random.uniform(-12, 12));
    const auto value = one.at(at);
    ASSERT_EQ(value.known, all.at(at).known);
    const double height = n.dot(at);
    if (height < 0.0 && height > -options.depth_mm) {
      ASSERT_TRUE(value.known) << at.transpose();
    }
    if (!value.known) continue;
    ++known;
    ASSERT_NEAR(value.distance, height, 1e-5);
    ASSERT_NEAR((value.to_surface + height * n).norm(), 0.0, 1e-5);
  }
  EXPECT_GT(known, 1000u);
  EXPECT_FALSE(one.at({1e300, 0, 0}).known);
  EXPECT_FALSE(one.at({-1e300, 1e9, 0}).known);
}

TEST(VectorField, IsWithinItsInterpolationErrorOnASphere) {
  const auto made = generated("sphere:extent_mm=20:points=40000:mesh=false");
  const Probe rival = prepare(model_of(made.cloud), "vector-field:voxel_mm=0.4:depth=8");
  Random random(5);
  // Curvature: a nearest plane is off by (spacing / sqrt 2)^2 / 2 R, trilinear sums by voxel^2 / 8 R per
  // axis.
  const double spacing = 0.2, bound = spacing * spacing / (4 * 10.0) + 3 * 0.4 * 0.4 / (8 * 7.0);
  for (int i = 0; i < 5000; ++i) {
    const Vec3 way = Vec3(random.normal(), random.normal(), random.normal()).normalized();
    const double depth = random.uniform(0.05, 2.9);
    const render::Frame frame = rival.to((10.0 - depth) * way);
    ASSERT_TRUE(frame.contact) << depth;
    ASSERT_NEAR(frame.force_n.norm() / kStiffness, depth, 3.0 * bound) << depth;
    ASSERT_FALSE(rival.to((10.0 + depth + bound) * way).contact);
  }
  EXPECT_FALSE(rival.to({0, 0, 0}).contact) << "deeper than the field there is no force";
}

TEST(VectorField, PathIndependenceCostsThinThings) {
  // A plate 1 mm thick, pushed to 0.7: by position alone the other face is nearer, and throws the HIP out
  // there.
  const auto made = generated("slab:extent_mm=20:thickness_mm=1:points=40000:mesh=false");
  const Probe field = prepare(model_of(made.cloud), "vector-field:voxel=1");
  EXPECT_GT(field.to({0.1, 0.2, 0.3}).force_n.z(), 0.05);
  EXPECT_LT(field.to({0.1, 0.2, -0.2}).force_n.z(), -0.05);
}

TEST(VectorField, OpenSurfacesHaveTheSideTheyAreGiven) {
  const render::ModelInput model = model_of(flat_points(41, 0.25));
  const Probe up = prepare(model, "vector-field"), down = prepare(model, "vector-field:flip=true");
  EXPECT_NEAR(up.to({0, 0, -0.5}).force_n.z(), kStiffness * 0.5, 1e-5);
  EXPECT_FALSE(up.to({0, 0, 0.5}).contact);
  EXPECT_NEAR(down.to({0, 0, 0.5}).force_n.z(), -kStiffness * 0.5, 1e-5);
  EXPECT_FALSE(down.to({0, 0, -0.5}).contact);
  EXPECT_FALSE(up.to({8, 0, -0.5}).contact) << "beyond the border is no inside";
}

TEST(VectorField, MemoryIsLimitedWithARemedy) {
  render::SceneInput scene = scene_of(model_of(flat_points(101, 0.25)));
  const Error refused = refusal("vector-field:voxel=0.2:memory_mb=10", scene);
  EXPECT_NE(refused.what.find("10 MB"), std::string::npos) << refused.what;
  EXPECT_NE(refused.remedy.find("voxel"), std::string::npos);
  const Probe fits = prepare(scene.models[0], "vector-field:memory_mb=10");
  EXPECT_LT(fits.report.bytes, 10'000'000u);
  // An extent that no directory could hold.
  scene.models[0] = model_of(cloud_of({{0, 0, 0}, {1e-3, 0, 0}, {0, 1e-3, 0}, {1e9, 1e9, 1e9}}));
  EXPECT_FALSE(rival("vector-field:voxel_mm=0.001")->prepare(scene, {}).ok());
}

}  // namespace
}  // namespace palpate::test
