#include "toolkit/cloud/cloud_subset.h"

namespace palpate::cloud {

std::vector<float> taken(const std::vector<float>& values, std::span<const std::uint32_t> of) {
  std::vector<float> some;
  if (values.empty()) return some;
  some.reserve(of.size());
  for (const std::uint32_t i : of) some.push_back(values[i]);
  return some;
}

Cloud subset_of(const Cloud& cloud, std::span<const std::uint32_t> of) {
  Cloud part;
  part.origin_mm = cloud.origin_mm;
  part.x_mm = taken(cloud.x_mm, of);
  part.y_mm = taken(cloud.y_mm, of);
  part.z_mm = taken(cloud.z_mm, of);
  for (const Property& property : cloud.properties)
    part.properties.push_back({property.name, taken(property.values, of)});
  return part;
}

}  // namespace palpate::cloud
