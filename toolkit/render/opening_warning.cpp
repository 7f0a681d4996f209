#include "toolkit/render/opening_warning.h"

#include <fmt/format.h>

#include "toolkit/geometry/winding_number.h"

namespace palpate::render {

std::optional<std::string> wide_mouth_warning(double min_enclosed) {
  const double mouth = 1.0 - min_enclosed;
  if (!(mouth > geometry::kWideOpeningFraction)) return std::nullopt;
  return fmt::format(
      "A piece encloses a volume but for a mouth of {:.0f} % of its surface: it is felt from the side on "
      "which a "
      "replay begins alone, and a probe that goes in by the mouth feels nothing. If the inner side is to be "
      "felt too, as of a vase, say sides=both.",
      100.0 * mouth);
}

}  // namespace palpate::render
