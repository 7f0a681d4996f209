// The unit of a LAS file's positions, from what it says of its coordinate system: GeoTIFF keys (OGC 19-008)
// or well-known text (OGC 01-009, 18-010).
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/read_model.h>

namespace palpate::io {

struct LasUnit {
  std::optional<Unit> unit;  ///< where the file names one that Palpate has
  std::optional<Unit>
      conventional_unit;  ///< otherwise metres, with a warning where that is not the true size
  std::vector<std::string> warnings;
};

/// `keys`: the record "LASF_Projection" 34735, `text`: 2112, each empty where it is not there. Text is taken
/// first where `prefers_text` (a bit of the header). Damaged records say nothing.
[[nodiscard]] LasUnit unit_of_las(std::span<const std::byte> keys, std::string_view text, bool prefers_text);

/// Metres of one unit of a projected or local system in well-known text, `vertical`: of its heights; nothing
/// where the text does not say it.
[[nodiscard]] std::optional<double> metres_of_text(std::string_view text, bool vertical);

}  // namespace palpate::io
