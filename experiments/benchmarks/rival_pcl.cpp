#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_types.h>

#include "experiments/benchmarks/rivals.h"

namespace palpate::benchmarks {

std::uint64_t knn_pcl(const cloud::Cloud& cloud) {
  pcl::PointCloud<pcl::PointXYZ>::Ptr points(new pcl::PointCloud<pcl::PointXYZ>);
  points->reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i)
    points->emplace_back(cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]);
  pcl::KdTreeFLANN<pcl::PointXYZ> tree;
  tree.setInputCloud(points);
  std::uint64_t sum = 0;
  pcl::Indices index;
  std::vector<float> distance;
  for (const pcl::PointXYZ& point : *points) {
    tree.nearestKSearch(point, 9, index, distance);
    for (const auto i : index) sum += static_cast<std::uint64_t>(i);
  }
  return sum;
}

}  // namespace palpate::benchmarks
