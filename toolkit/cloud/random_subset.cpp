#include "toolkit/cloud/cloud_subset.h"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "toolkit/core/random.h"

namespace palpate::cloud {

Cloud random_subset(const Cloud& cloud, std::size_t count, std::uint64_t seed) {
  std::vector<std::uint32_t> kept(cloud.size());
  std::iota(kept.begin(), kept.end(), 0u);
  if (count < kept.size()) {
    Random random(seed);
    for (std::size_t i = 0; i < count; ++i) std::swap(kept[i], kept[i + random.below(kept.size() - i)]);
    kept.resize(count);
    std::sort(kept.begin(), kept.end());
  }
  Cloud some;
  some.origin_mm = cloud.origin_mm;
  for (const std::uint32_t i : kept) {
    some.x_mm.push_back(cloud.x_mm[i]);
    some.y_mm.push_back(cloud.y_mm[i]);
    some.z_mm.push_back(cloud.z_mm[i]);
  }
  return some;
}

}  // namespace palpate::cloud
