#include "toolkit/partition/corner_test.h"

namespace palpate::partition {

template <int kAxes>
CornerTestCount count_corner_test(const SpaceTree<kAxes>& tree, const cloud::Cloud& cloud, double cutoff_mm,
                                  std::size_t stride) {
  CornerTestCount count;
  const std::span<const std::uint32_t> order = tree.order();
  for (std::size_t query = 0; query < order.size(); query += std::max<std::size_t>(stride, 1)) {
    const Vec3 at = cloud.local_mm(order[query]);
    const auto within = [&](std::size_t place) {
      return place != query && (cloud.local_mm(order[place]) - at).squaredNorm() <= cutoff_mm * cutoff_mm;
    };
    std::uint64_t exact = 0, corners = 0;
    visit_ranges(tree, at, at, Vec3::Constant(cutoff_mm), [&](PlaceRange range) {
      count.looked_at_exact += range.end - range.begin;
      for (std::size_t place = range.begin; place < range.end; ++place) exact += within(place);
      return true;
    });
    visit_corner_test(tree, at, cutoff_mm, [&](PlaceRange range) {
      count.looked_at_corners += range.end - range.begin;
      for (std::size_t place = range.begin; place < range.end; ++place) corners += within(place);
      return true;
    });
    count.within += exact;
    count.missed += exact - corners;
  }
  return count;
}

template CornerTestCount count_corner_test<2>(const SpaceTree<2>&, const cloud::Cloud&, double, std::size_t);
template CornerTestCount count_corner_test<3>(const SpaceTree<3>&, const cloud::Cloud&, double, std::size_t);

}  // namespace palpate::partition
