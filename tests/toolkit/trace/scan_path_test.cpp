// Exploration of a real scan, where $PALPATE_DATA is set: never far from the points, in and out, from free
// space.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "toolkit/io/read_model.h"
#include "toolkit/trace/paths.h"

namespace palpate::trace {
namespace {

TEST(ScanPath, ExplorationOfTheBunny) {
  const char* folder = std::getenv("PALPATE_DATA");
  if (folder == nullptr) GTEST_SKIP() << "set PALPATE_DATA to a folder with the scans";
  const std::string file = (std::filesystem::path(folder) / "stanford/bun_zipper.ply.xz").string();
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no bunny there";
  io::Readers readers;
  io::add_standard_readers(readers);
  io::ReadOptions options;
  options.unit = io::Unit::kMetre;
  const auto model = readers.read(file, options);
  ASSERT_TRUE(model) << model.error().message();
  PathTarget target;
  target.cloud = &model->cloud;
  target.mesh = model->mesh.get();
  target.box_mm = model->cloud.box_mm();
  const auto path = make_path(*parse_named_options("exploration:frames=10000"), target);
  ASSERT_TRUE(path) << path.error().message();

  // The start is beyond every point along some direction; it suffices that it is 0.4 mm from the nearest.
  const auto nearest = [&](const Vec3& p) {
    double best = 1e300;
    std::size_t at = 0;
    for (std::size_t i = 0; i < model->cloud.size(); ++i) {
      const double d = (model->cloud.point_mm(i) - p).squaredNorm();
      if (d < best) {
        best = d;
        at = i;
      }
    }
    return std::pair(std::sqrt(best), at);
  };
  EXPECT_NEAR(nearest(path->hip_mm[0]).first, 0.4, 1e-4);
  // Outside and inside by the normals of the scan's own mesh.
  std::vector<Vec3> normals(model->cloud.size(), Vec3::Zero());
  for (const auto& t : model->mesh->triangles) {
    const Vec3& a = model->mesh->vertices_mm[t[0]];
    const Vec3 ab = model->mesh->vertices_mm[t[1]] - a, ac = model->mesh->vertices_mm[t[2]] - a;
    for (const std::uint32_t v : t) normals[v] += ab.cross(ac);
  }
  std::size_t inside = 0, outside = 0;
  geometry::Aabb visited;
  for (std::size_t k = 0; k < path->size(); k += 25) {
    const auto [distance, at] = nearest(path->hip_mm[k]);
    ASSERT_LT(distance, 3.5) << "frame " << k;
    ((path->hip_mm[k] - model->cloud.point_mm(at)).dot(normals[at]) < 0 ? inside : outside)++;
    visited.add(path->hip_mm[k]);
  }
  EXPECT_GT(inside, 150u);
  EXPECT_GT(outside, 50u);
  EXPECT_GT(visited.extent_mm().norm(), 30);
}

}  // namespace
}  // namespace palpate::trace
