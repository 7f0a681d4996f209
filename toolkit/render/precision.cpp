#include "toolkit/render/precision.h"

#include <fmt/format.h>

#include <cmath>

#include "toolkit/core/tolerances.h"

namespace palpate::render {

namespace {
/// The extent over what a coordinate rounds to.
constexpr double kExtentPerRounding = 0x1p25;
}  // namespace

double coordinate_rounding_mm(const cloud::Cloud& cloud) {
  return cloud.box_mm().extent_mm().maxCoeff() * kUnitRoundoffFloat * 0.5;
}

bool floats_fit(const cloud::Cloud& cloud, double spacing_mm) {
  return !(spacing_mm > 0.0) || coordinate_rounding_mm(cloud) <= kFloatShare * spacing_mm;
}

Decision coordinates_decision(const cloud::Cloud& cloud, double spacing_mm) {
  const double rounding_mm = coordinate_rounding_mm(cloud);
  const double share = spacing_mm > 0.0 ? rounding_mm / spacing_mm : 0.0;
  std::string reason =
      fmt::format("they round to {:.2g} mm, {:.2g} of the median spacing", rounding_mm, share);
  if (!floats_fit(cloud, spacing_mm))
    reason += fmt::format(
        ": TOO COARSE, more than a hundredth; cut the cloud into models of a part of its extent, {:.0f} "
        "along "
        "its longest side",
        std::ceil(share / kFloatShare));
  else if (spacing_mm > 0.0)
    reason += fmt::format(": its extent is 2^{:.0f} spacings, and floats hold up to 2^{:.0f}",
                          std::log2(share * kExtentPerRounding), std::log2(kFloatShare * kExtentPerRounding));
  return {"coordinates", "float, relative to the middle of the box", std::move(reason)};
}

}  // namespace palpate::render
