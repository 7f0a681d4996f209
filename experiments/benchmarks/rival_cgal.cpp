#include <CGAL/Orthogonal_k_neighbor_search.h>
#include <CGAL/Search_traits_3.h>
#include <CGAL/Search_traits_adapter.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/property_map.h>

#include <utility>
#include <vector>

#include "experiments/benchmarks/rivals.h"

namespace palpate::benchmarks {

std::uint64_t knn_cgal(const cloud::Cloud& cloud) {
  using Kernel = CGAL::Simple_cartesian<double>;
  using Indexed = std::pair<Kernel::Point_3, std::uint32_t>;
  using Traits = CGAL::Search_traits_adapter<Indexed, CGAL::First_of_pair_property_map<Indexed>,
                                             CGAL::Search_traits_3<Kernel>>;
  using Search = CGAL::Orthogonal_k_neighbor_search<Traits>;
  std::vector<Indexed> points;
  points.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Vec3 p = cloud.local_mm(i);
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), static_cast<std::uint32_t>(i));
  }
  Search::Tree tree(points.begin(), points.end());
  tree.build();
  std::uint64_t sum = 0;
  for (const Indexed& point : points) {
    const Search search(tree, point.first, 9);
    for (const auto& found : search) sum += found.first.second;
  }
  return sum;
}

}  // namespace palpate::benchmarks
