#include "toolkit/partition/partition.h"

namespace palpate::partition {

Vec3 widened(const Vec3f& stored) noexcept {
  return stored.cast<double>();
}

}  // namespace palpate::partition
