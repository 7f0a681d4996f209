#include "toolkit/render/wide_mouth.h"

#include <fmt/format.h>

#include "toolkit/geometry/mouth.h"

namespace palpate::render {

std::optional<std::string> wide_mouth_warning(double least_enclosed) {
  const double mouth = 1.0 - least_enclosed;
  if (!(mouth > geometry::kWideMouthShare)) return std::nullopt;
  return fmt::format(
      "A piece encloses a volume but for a mouth of {:.0f} % of its surface: it is felt from the side on "
      "which a "
      "replay begins alone, and a probe that goes in by the mouth feels nothing. If the inner side is to be "
      "felt too, as of a vase, say sides=both.",
      100.0 * mouth);
}

}  // namespace palpate::render
