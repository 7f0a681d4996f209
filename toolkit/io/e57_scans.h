// Scans of an E57 file, from its XML (ASTM E2807). A scan has a number of records, their fields, their place
// in the file and the scanner's pose.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::io {

/// Encoding of a field's values in the file. Integers are packed into as many bits as their limits need.
enum class E57Type { kInteger, kScaledInteger, kSingle, kDouble, kText };

/// One entry of a scan's prototype, in the order of the bytestreams.
struct E57Field {
  std::string name;
  E57Type type = E57Type::kDouble;
  unsigned bits = 0;         ///< of one value; 0: every value is `minimum`, or text of any length
  std::int64_t minimum = 0;  ///< is added to the packed bits
  double scale = 1.0;        ///< of ScaledInteger: value = (minimum + bits) * scale + offset
  double offset = 0.0;
};

struct E57Scan {
  std::string name;                      ///< for messages: "scan 2 ('hall')"
  std::uint64_t records = 0;             ///< as promised; bounded by who reads them
  std::uint64_t section = 0;             ///< physical offset of the binary section
  std::vector<E57Field> fields;          ///< all, also those that nobody reads
  Mat3 rotation = Mat3::Identity();      ///< from the scanner's axes to the file's
  Vec3 translation = Vec3::Zero();       ///< of the scanner, in metres
  std::optional<geometry::Aabb> bounds;  ///< in the file's axes, where the scan states them

  /// The field of a name, or nothing.
  [[nodiscard]] std::optional<std::size_t> find(std::string_view field) const noexcept;
};

/// Longest XML that is read: pugixml needs up to some 16 bytes for one of hostile XML (a node for "<a/>").
inline constexpr std::uint64_t kMaxE57XmlBytes = std::uint64_t{1} << 26;

/// All scans of a file. Unknown parts that change the points are refused by name: other codecs, structures
/// within records, rotations that are none.
[[nodiscard]] Result<std::vector<E57Scan>> parse_e57_scans(std::string_view xml);

}  // namespace palpate::io
