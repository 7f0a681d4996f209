#include "toolkit/surface/oriented_points.h"

#include "toolkit/core/parallel.h"
#include "toolkit/surface/smallest_eigenvector.h"

namespace palpate::surface {
namespace {

/// False if the point and its neighbours determine no plane.
bool plane_normal(std::span<const OrientedPoint> points, const search::Neighbours& around, std::size_t i,
                  Vec3& normal) noexcept {
  const Vec3 point = points[i].at();
  // Sums relative to the point, which is fitted too.
  double count = 1.0;
  Vec3 sum = Vec3::Zero();
  SymmetricMatrix3 squares;
  for (const std::uint32_t other : around) {
    if (other == i) continue;
    const Vec3 d = points[other].at() - point;
    sum += d;
    squares.add(d);
    count += 1.0;
  }
  return smallest_eigenvector(squares.without(sum, 1.0 / count), normal);
}

}  // namespace

std::vector<OrientedPoint> surface_points(const cloud::Cloud& cloud) {
  std::vector<OrientedPoint> points(cloud.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], kNoNormal};
  return points;
}

std::vector<Vec3> normals_of(std::span<const OrientedPoint> points) {
  std::vector<Vec3> normals(points.size(), Vec3::Zero());
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].normal != kNoNormal) normals[i] = decode_normal(points[i].normal);
  return normals;
}

void fit_planes(std::span<OrientedPoint> points, std::span<const search::Neighbours> neighbours,
                int threads) {
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Vec3 normal;
      points[i].normal = plane_normal(points, neighbours[i], i, normal) ? encode_normal(normal) : kNoNormal;
    }
  });
}

}  // namespace palpate::surface
