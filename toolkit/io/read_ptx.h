// Text of terrestrial scanners, in metres by convention: PTX (each scan a grid with the scanner's pose) and
// PTS (a count, then rows of x y z, with intensity and colour where there are more columns).
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/point_stream.h"

namespace palpate::io {

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
