// Reads the text of terrestrial scanners: PTX and PTS.
//
// Lengths are metres by convention. PTX: each scan is a grid with the scanner's pose. PTS: a count, then rows
// of x y z, with intensity and colour where there are more columns. ScanRows is what both share; each adds
// what stands between the rows.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <palpate/result.h>
#include <palpate/vec.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/point_stream.h"

namespace palpate::io {

/// Names of the values that may stand behind x y z.
inline constexpr std::array<const char*, 4> kScanValues{"intensity", "red", "green", "blue"};
inline constexpr std::size_t kAxesOfRow = 3;
/// "0 0 0" and the end of the line: what a promised point takes at least.
inline constexpr std::uint64_t kMinScanRowBytes = 6;
inline constexpr const char* kFetchScan = "the file is cut off: fetch it again";

/// Points of a scanner's text from front to back, whatever the format. Errors have their line.
class ScanRows {
 public:
  explicit ScanRows(ByteSource& bytes) : in_(bytes) {}
  virtual ~ScanRows() = default;
  /// Reads what stands before the first point. Once, before the rest.
  [[nodiscard]] virtual Status begin() = 0;
  /// Goes to the next point; false at the end.
  [[nodiscard]] virtual Result<bool> next() = 0;
  /// Adds what is known at the end: warnings, the raster.
  virtual void finish(DecodedFile& decoded) const = 0;
  /// Where in the grid of a first scan the point stands.
  [[nodiscard]] virtual std::optional<std::uint32_t> position() const { return std::nullopt; }
  [[nodiscard]] virtual std::string format() const = 0;

  [[nodiscard]] const Vec3& point() const noexcept { return point_; }
  /// By kScanValues; NaN where the row has none.
  [[nodiscard]] const std::array<float, kScanValues.size()>& values() const noexcept { return values_; }
  /// Points that the first count promises, bounded by the file's size where that is known.
  [[nodiscard]] std::uint64_t promised() const noexcept { return promised_; }
  [[nodiscard]] const BufferedInput& input() const noexcept { return in_; }

 protected:
  /// The next line that is not blank, without blanks around it.
  bool next_line(std::string_view& line);
  [[nodiscard]] Error at_line(std::string what, std::string remedy = kCheckLine) const;
  /// Parses a row into point() and values(): intensity where there are four columns or seven, colour where
  /// six or seven. The first row of a block says how many columns the block has.
  Status take_row(std::string_view row);
  void begin_block() noexcept { columns_ = 0; }
  void warn_of_columns(DecodedFile& decoded) const;

  BufferedInput in_;
  std::uint64_t promised_ = 0;
  Vec3 point_ = Vec3::Zero();

 private:
  std::size_t columns_ = 0;  // of the present block, 0 before its first row
  std::size_t unnamed_columns_ = 0;
  std::array<float, kScanValues.size()> values_{};
};

/// Bytes from the front of a file that the two functions below need at most.
inline constexpr std::size_t kScanTextFrontBytes = 4096;
/// Whether a text begins with the ten lines that stand before each scan of a PTX file: two counts, then four
/// lines of three numbers and four of four.
[[nodiscard]] bool starts_as_ptx(std::string_view front);
/// Whether a text begins with a count alone in its line and a row of at least three numbers.
[[nodiscard]] bool starts_as_pts(std::string_view front);

/// Points in pieces, placed by their scan's matrix; "0 0 0" in the scanner's axes is a direction without
/// return and is left out. The header's points are those of the first scan: only reading tells of more.
[[nodiscard]] Result<std::unique_ptr<PointStream>> ptx_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name);
/// The header's points are the first count's: only reading tells of further blocks.
[[nodiscard]] Result<std::unique_ptr<PointStream>> pts_stream(std::unique_ptr<RandomAccess> file,
                                                              const std::string& name);

/// A file of one scan keeps its grid: a raster's rows are the columns of the PTX file, which lists its points
/// column by column.
[[nodiscard]] Result<DecodedFile> read_ptx(const ReaderInput& input);
/// A file that does not begin with a count, as some name their columns of text, is read by read_xyz().
[[nodiscard]] Result<DecodedFile> read_pts(const ReaderInput& input);

}  // namespace palpate::io
