#include "toolkit/search/partition.h"

namespace palpate::search {

Vec3 widened(const Vec3f& stored) noexcept {
  return stored.cast<double>();
}

}  // namespace palpate::search
