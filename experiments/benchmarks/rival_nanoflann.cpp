#include <nanoflann.hpp>

#include "experiments/benchmarks/rivals.h"

namespace palpate::benchmarks {
namespace {

struct Points {
  const cloud::Cloud& cloud;
  std::size_t kdtree_get_point_count() const { return cloud.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return axis == 0 ? cloud.x_mm[i] : axis == 1 ? cloud.y_mm[i] : cloud.z_mm[i];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

}  // namespace

std::uint64_t knn_nanoflann(const cloud::Cloud& cloud) {
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Points>, Points, 3,
                                                   std::uint32_t>;
  const Points points{cloud};
  const Tree tree(3, points);
  std::uint64_t sum = 0;
  std::uint32_t index[9];
  float distance[9];
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const float p[3] = {cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]};
    const std::size_t found = tree.knnSearch(p, 9, index, distance);
    for (std::size_t k = 0; k < found; ++k) sum += index[k];
  }
  return sum;
}

}  // namespace palpate::benchmarks
