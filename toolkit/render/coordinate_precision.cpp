#include "toolkit/render/coordinate_precision.h"

#include <fmt/format.h>

#include <cmath>

#include "toolkit/core/tolerances.h"

namespace palpate::render {

namespace {
/// Extent divided by the rounding of a coordinate.
constexpr double kExtentPerRounding = 0x1p25;
}  // namespace

double coordinate_rounding_mm(const cloud::Cloud& cloud) {
  return cloud.box_mm().extent_mm().maxCoeff() * kUnitRoundoffFloat * 0.5;
}

bool float_precision_suffices(const cloud::Cloud& cloud, double spacing_mm) {
  return !(spacing_mm > 0.0) || coordinate_rounding_mm(cloud) <= kMaxRoundingShare * spacing_mm;
}

Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm) {
  const double rounding_mm = coordinate_rounding_mm(cloud);
  const double share = spacing_mm > 0.0 ? rounding_mm / spacing_mm : 0.0;
  std::string reason =
      fmt::format("they round to {:.2g} mm, {:.2g} of the median spacing", rounding_mm, share);
  if (!float_precision_suffices(cloud, spacing_mm))
    reason += fmt::format(
        ": TOO COARSE, more than a hundredth; cut the cloud into models of a part of its extent, {:.0f} "
        "along "
        "its longest side",
        std::ceil(share / kMaxRoundingShare));
  else if (spacing_mm > 0.0)
    reason +=
        fmt::format(": its extent is 2^{:.0f} spacings, and floats hold up to 2^{:.0f}",
                    std::log2(share * kExtentPerRounding), std::log2(kMaxRoundingShare * kExtentPerRounding));
  return {"coordinates", "float, relative to the middle of the box", std::move(reason)};
}

}  // namespace palpate::render
