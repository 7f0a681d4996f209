#include "toolkit/surface/normals.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "toolkit/core/parallel.h"
#include "toolkit/core/tolerances.h"

namespace palpate::surface {
namespace {

constexpr std::size_t kPointsPerChunk = 8192;

/// Points lie on a line, as far as rounding can tell, when the middle eigenvalue is below this share of the
/// largest: coordinates are floats, so a true line's points stray by 2^-24 of their distance, the square of
/// it in eigenvalues; a thousand times that leaves room for the solver's own error.
constexpr double kLineShare = 1000.0 * kUnitRoundoffFloat * kUnitRoundoffFloat;

}  // namespace

NormalCode encode_normal(const Vec3& unit) noexcept {
  const double sum = std::abs(unit.x()) + std::abs(unit.y()) + std::abs(unit.z());
  double x = unit.x() / sum, y = unit.y() / sum;
  if (unit.z() < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const auto quantised = [](double v) {
    return static_cast<std::uint32_t>(std::clamp(std::floor((v + 1.0) * 32767.0 + 0.5), 0.0, 65534.0));
  };
  return quantised(x) | quantised(y) << 16;
}

std::vector<NormalCode> plane_normals(const cloud::Cloud& cloud, const neighbourhood::NeighbourTable& table,
                                      int threads) {
  std::vector<NormalCode> codes(cloud.size(), kNoNormal);
  parallel_chunks(cloud.size(), kPointsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Vec3 d[neighbourhood::kNeighbours];
      std::size_t count = 0;
      Vec3 mean = Vec3::Zero();
      const Vec3 p = cloud.local_mm(i);
      for (const std::uint32_t other : table.of[i]) {
        if (other == i) continue;
        d[count] = cloud.local_mm(other) - p;
        mean += d[count++];
      }
      if (count < 2) continue;
      mean /= static_cast<double>(count + 1);
      Mat3 covariance = mean * mean.transpose();  // the point itself, at the origin
      for (std::size_t k = 0; k < count; ++k) {
        const Vec3 e = d[k] - mean;
        covariance += e * e.transpose();
      }
      const double scale = covariance.diagonal().maxCoeff();
      if (!(scale > 0.0)) continue;
      Eigen::SelfAdjointEigenSolver<Mat3> solver;
      solver.computeDirect(covariance / scale);
      if (solver.eigenvalues()[1] <= kLineShare * solver.eigenvalues()[2]) continue;
      const Vec3 normal = solver.eigenvectors().col(0);
      if (is_finite(normal)) codes[i] = encode_normal(normal);
    }
  });
  return codes;
}

}  // namespace palpate::surface
