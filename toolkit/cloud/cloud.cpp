#include <palpate/cloud.h>

#include <fmt/format.h>

#include <bit>
#include <cmath>

#include "toolkit/cloud/statistics.h"
#include "toolkit/core/hash.h"

namespace palpate::cloud {

geometry::Aabb Cloud::box_mm() const noexcept {
  geometry::Aabb box;
  for (std::size_t i = 0; i < size(); ++i) box.add(local_mm(i));
  if (!box.empty()) {
    box.low_mm += origin_mm;
    box.high_mm += origin_mm;
  }
  return box;
}

std::size_t Cloud::bytes() const noexcept {
  std::size_t total = (x_mm.capacity() + y_mm.capacity() + z_mm.capacity()) * sizeof(float);
  for (const Property& property : properties) total += property.values.capacity() * sizeof(float);
  return total;
}

std::uint64_t content_hash(const Cloud& cloud) noexcept {
  ContentHash hash;
  for (int axis = 0; axis < 3; ++axis) hash.u64(std::bit_cast<std::uint64_t>(cloud.origin_mm[axis]));
  hash.values(cloud.x_mm);
  hash.values(cloud.y_mm);
  hash.values(cloud.z_mm);
  for (const Property& property : cloud.properties) {
    hash.text(property.name);
    hash.values(property.values);
  }
  if (cloud.raster) {
    hash.u64(std::uint64_t{cloud.raster->columns} << 32 | cloud.raster->rows);
    hash.u64(static_cast<std::uint64_t>(cloud.raster->order) << 2 |
             std::uint64_t{cloud.raster->columns_wrap} << 1 | std::uint64_t{cloud.raster->rows_wrap});
  }
  return hash.value();
}

Result<Cloud> build_cloud(std::span<const Vec3> points_mm, NonFinite non_finite, BuildReport* report) {
  // Places take 32 bits, of which surface pieces use one for their side.
  if (points_mm.size() > kMaxCloudPoints)
    return Error{fmt::format("{} points are more than the {} that one model may have", points_mm.size(),
                             kMaxCloudPoints),
                 "cut the cloud into several models, or thin it (palpate clean)"};
  BuildReport found;
  geometry::Aabb box;
  std::size_t first_bad = points_mm.size();
  for (std::size_t i = 0; i < points_mm.size(); ++i) {
    if (is_finite(points_mm[i])) {
      box.add(points_mm[i]);
    } else {
      if (found.non_finite++ == 0) first_bad = i;
    }
  }
  if (found.non_finite > 0 && non_finite == NonFinite::kRefuse)
    return Error{fmt::format("{} of {} points are not finite, the first is point {}", found.non_finite,
                             points_mm.size(), first_bad),
                 "drop them with --non-finite drop, or clean the file"};
  const std::size_t kept = points_mm.size() - found.non_finite;
  if (kept == 0) return Error{"the cloud has no points", "give a file with at least one finite point"};
  // Beyond this a float relative to the origin would overflow.
  if (!(box.extent_mm().maxCoeff() < static_cast<double>(std::numeric_limits<float>::max())))
    return Error{"the cloud's extent does not fit in single precision",
                 "remove the outliers or check the unit"};

  Cloud cloud;
  cloud.origin_mm = box.low_mm + 0.5 * box.extent_mm();
  cloud.x_mm.reserve(kept);
  cloud.y_mm.reserve(kept);
  cloud.z_mm.reserve(kept);
  for (const Vec3& p : points_mm) {
    if (!is_finite(p)) continue;
    const Vec3 local = p - cloud.origin_mm;
    cloud.x_mm.push_back(static_cast<float>(local.x()));
    cloud.y_mm.push_back(static_cast<float>(local.y()));
    cloud.z_mm.push_back(static_cast<float>(local.z()));
    const Vec3 error = cloud.point_mm(cloud.size() - 1) - p;
    found.max_rounding_mm = std::max(found.max_rounding_mm, error.cwiseAbs().maxCoeff());
  }
  if (report != nullptr) *report = found;
  return cloud;
}

}  // namespace palpate::cloud
