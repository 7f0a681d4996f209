#include "toolkit/surface/planes.h"

#include "toolkit/core/parallel.h"
#include "toolkit/surface/fan.h"
#include "toolkit/surface/least_direction.h"

namespace palpate::surface {
namespace {

/// A plane turned by more than 45 degrees from the facets around its point is not theirs.
constexpr double kFoldedCosine = 0.7071;

/// False where the point and its neighbours give no plane.
bool plane_normal(std::span<const SurfacePoint> points, const neighbourhood::Neighbours& around,
                  std::size_t i, Vec3& normal) noexcept {
  const Vec3 point = points[i].at();
  // Sums about the point itself, which is one of those fitted.
  double count = 1.0;
  Vec3 sum = Vec3::Zero();
  Symmetric squares;
  for (const std::uint32_t other : around) {
    if (other == i) continue;
    const Vec3 d = points[other].at() - point;
    sum += d;
    squares.add(d);
    count += 1.0;
  }
  return least_direction(squares.without(sum, 1.0 / count), normal);
}

}  // namespace

std::vector<SurfacePoint> surface_points(const cloud::Cloud& cloud) {
  std::vector<SurfacePoint> points(cloud.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i], kNoNormal};
  return points;
}

std::vector<Vec3> normals_of(std::span<const SurfacePoint> points) {
  std::vector<Vec3> normals(points.size(), Vec3::Zero());
  for (std::size_t i = 0; i < points.size(); ++i)
    if (points[i].normal != kNoNormal) normals[i] = decode_normal(points[i].normal);
  return normals;
}

void fit_planes(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                int threads) {
  parallel_chunks(points.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Vec3 normal;
      points[i].normal = plane_normal(points, neighbours[i], i, normal) ? encode_normal(normal) : kNoNormal;
    }
  });
}

void refit_plane(std::span<SurfacePoint> points, std::span<const neighbourhood::Neighbours> neighbours,
                 std::uint32_t place) noexcept {
  const NormalCode before = points[place].normal;
  const NormalCode side = is_one_sided(before) ? kOneSided : NormalCode{0};
  Vec3 normal;
  const bool fitted = plane_normal(points, neighbours[place], place, normal);
  if (before == kNoNormal) {
    if (fitted) points[place].normal = encode_normal(normal);
    return;
  }
  const Vec3 was = decode_normal(before);
  if (fitted && was.dot(normal) < 0.0) normal = -normal;
  // The facets around the point tell its direction where a stretched surface has no plane any more: at the
  // tip of a dent that is deeper than wide the points lie along the dent, and least squares stand square to
  // it.
  const Vec3 p = points[place].at();
  const Fan fan = fan_of(was, [&](std::size_t k) { return Vec3(points[neighbours[place][k]].at() - p); });
  const Vec3 area = fan.area();
  const bool around = fan.closed() && area.dot(was) > 0.0;
  const Vec3 expected = around ? Vec3(area.normalized()) : was;
  if (!fitted || normal.dot(expected) < kFoldedCosine) normal = expected;
  points[place].normal = encode_normal(normal) | side;
}

}  // namespace palpate::surface
