// The cloud point nearest to any place, for scores. Not for frames: no bound on the work.
#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "toolkit/cloud/cloud.h"

namespace palpate::metrics {

/// A hash of cubic cells over the cloud, about two points to an occupied cell of a surface. Keeps a reference
/// to the cloud. Safe to query from several threads.
class NearestPoint {
 public:
  /// The cloud must not be empty. O(n).
  explicit NearestPoint(const cloud::Cloud& cloud);
  /// Index of the nearest point, ties by index. Near the cloud O(points nearby); far away O(n). p must be
  /// finite.
  [[nodiscard]] std::size_t find(const Vec3& p_mm) const;

 private:
  struct Range {
    std::uint32_t begin = 0, end = 0;
  };
  using Cell = Eigen::Matrix<std::int64_t, 3, 1>;
  [[nodiscard]] Cell cell_of(const Vec3& local_mm) const;
  [[nodiscard]] static std::uint64_t key_of(const Cell& cell);
  struct Best {
    double distance_sq_mm2;
    std::size_t index;
  };
  void look(const Cell& cell, const Vec3& local_mm, Best& best) const;

  const cloud::Cloud& cloud_;
  double cell_mm_ = 1.0;
  std::vector<std::uint32_t> order_;  // point indices by cell
  std::unordered_map<std::uint64_t, Range> cells_;
};

}  // namespace palpate::metrics
