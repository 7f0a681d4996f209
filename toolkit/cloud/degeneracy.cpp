
#include <fmt/format.h>

#include <Eigen/Geometry>

#include "toolkit/cloud/statistics.h"

namespace palpate::cloud {
namespace {

// Points nearer to a line than this share of its length are collinear; text files have five digits or more.
constexpr double kThinnest = 1e-5;

/// The point farthest from `from`.
Vec3 farthest_from(const Cloud& cloud, const Vec3& from) {
  Vec3 best = from;
  double best_sq = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double distance_sq = (cloud.local_mm(i) - from).squaredNorm();
    if (distance_sq <= best_sq) continue;
    best_sq = distance_sq;
    best = cloud.local_mm(i);
  }
  return best;
}

}  // namespace

std::optional<std::string> degeneracy_of(const Cloud& cloud) {
  if (cloud.empty()) return "it has no points";
  const Vec3 one_end = cloud.local_mm(0), other_end = farthest_from(cloud, one_end);
  const double length = (other_end - one_end).norm();
  if (length > 0.0) {
    const Vec3 along = (other_end - one_end) / length;
    for (std::size_t i = 0; i < cloud.size(); ++i)
      if ((cloud.local_mm(i) - one_end).cross(along).norm() > kThinnest * length) return std::nullopt;
  }
  const std::size_t places = cloud.size() - count_duplicates(cloud);
  const std::string where = places == 1                   ? std::string("in one place")
                            : places < kMinDistinctPoints ? fmt::format("in {} places", places)
                                                          : std::string("in one line");
  return cloud.size() == 1
             ? fmt::format("it has one point; a surface needs at least {} that are not in one line",
                           kMinDistinctPoints)
             : fmt::format("its {} points stand {}; a surface needs at least {} that are not in one line",
                           cloud.size(), where, kMinDistinctPoints);
}

}  // namespace palpate::cloud
