#include "toolkit/surface/octahedral_normal.h"

#include <algorithm>

namespace palpate::surface {

NormalCode encode_normal(const Vec3& unit) noexcept {
  const double sum = std::abs(unit.x()) + std::abs(unit.y()) + std::abs(unit.z());
  double x = unit.x() / sum, y = unit.y() / sum;
  if (unit.z() < 0.0) {
    const double folded_x = std::copysign(1.0 - std::abs(y), x);
    y = std::copysign(1.0 - std::abs(x), y);
    x = folded_x;
  }
  const auto quantised = [](double v, double steps) {
    return static_cast<std::uint32_t>(std::clamp(std::floor((v + 1.0) * (0.5 * steps) + 0.5), 0.0, steps));
  };
  return quantised(x, kNormalStepsX) | quantised(y, kNormalStepsY) << 16;
}

NormalCode opposite(NormalCode code) noexcept {
  if (code == kNoNormal) return code;
  return encode_normal(-decode_normal(code)) | (code & kOneSided);
}

}  // namespace palpate::surface
