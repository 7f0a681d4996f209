// E57 files (ASTM E2807) as points: all scans of a file one behind the other, each turned and moved by its
// pose, in metres as the standard asks. Records that the scanner marks as invalid are left out.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/e57_binary.h"
#include "toolkit/io/e57_scans.h"
#include "toolkit/io/point_stream.h"

namespace palpate::io {

/// A property of a record beside its position, and the field that marks it as missing.
struct E57Property {
  std::string_view name;     ///< as the cloud names it
  std::string_view field;    ///< as E57 names it
  std::string_view invalid;  ///< a field that is not 0 where there is no value
};
inline constexpr std::array<E57Property, 4> kE57Properties{{
    {"intensity", "intensity", "isIntensityInvalid"},
    {"red", "colorRed", "isColorInvalid"},
    {"green", "colorGreen", "isColorInvalid"},
    {"blue", "colorBlue", "isColorInvalid"},
}};

/// Some records at a time. The file is kept alive by the caller.
class E57Reader {
 public:
  /// Reads the XML and checks every scan, of which each needs positions: cartesian, else spherical.
  [[nodiscard]] static Result<E57Reader> open(const RandomAccess& file, bool with_properties);

  [[nodiscard]] const std::vector<E57Scan>& scans() const noexcept { return *scans_; }
  [[nodiscard]] std::uint64_t records() const noexcept { return records_; }
  /// Records that next() has left out so far because they are marked as invalid.
  [[nodiscard]] std::uint64_t left_out() const noexcept { return left_out_; }
  /// Whether any scan has the property kE57Properties[p].
  [[nodiscard]] bool has(std::size_t p) const noexcept { return has_[p]; }

  /// The next positions, in metres in the file's axes, and where asked the properties of each, NaN where
  /// missing: values()[p][i] of points()[i]. False at the end; true may come with no points.
  [[nodiscard]] Result<bool> next();
  [[nodiscard]] std::span<const Vec3> points() const noexcept { return points_; }
  [[nodiscard]] const std::array<std::vector<float>, kE57Properties.size()>& values() const noexcept {
    return values_;
  }
  [[nodiscard]] Status rewind();

 private:
  explicit E57Reader(E57Pages pages, bool with_properties)
      : pages_(std::make_unique<E57Pages>(std::move(pages))), with_properties_(with_properties) {}
  Status open_scan(std::size_t scan);
  std::optional<std::size_t> want(std::string_view field);
  void place(const E57Scan& scan, std::size_t count);

  std::unique_ptr<E57Pages> pages_;  // both at places that stay when this object moves
  std::unique_ptr<std::vector<E57Scan>> scans_;
  bool with_properties_;
  std::array<bool, kE57Properties.size()> has_{};
  std::uint64_t records_ = 0, left_out_ = 0;

  std::size_t scan_ = 0;  // the present one
  std::optional<E57Records> present_;
  std::vector<std::size_t> wanted_;  // fields of the present scan, by column
  std::vector<std::vector<double>> columns_;
  std::array<std::size_t, 3> position_{};  // columns of x, y, z, or of range, azimuth, elevation
  bool spherical_ = false;
  std::optional<std::size_t> invalid_;  // the column that marks positions
  std::array<std::optional<std::size_t>, kE57Properties.size()> property_{}, property_invalid_{};
  std::vector<Vec3> points_;
  std::array<std::vector<float>, kE57Properties.size()> values_;
};

/// Points in pieces. The header's points are the records, of which invalid ones are left out. `name` is for
/// messages.
[[nodiscard]] Result<std::unique_ptr<PointStream>> e57_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name);

/// The whole file with its properties. Needs the file's bytes in memory, which may have come compressed.
[[nodiscard]] Result<DecodedFile> read_e57(const ReaderInput& input);

}  // namespace palpate::io
