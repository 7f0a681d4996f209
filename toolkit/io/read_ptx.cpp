#include "toolkit/io/read_ptx.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/messages.h"

namespace palpate::io {

// ---- rows

namespace {

constexpr std::size_t kColoursOfRow = 3;
constexpr std::size_t kFullRow = kAxesOfRow + kScanValues.size();
// Keeps a row's cost bounded; writers add normals at most.
constexpr std::size_t kMaxScanColumns = 32;

using MakeScanRows = std::function<std::unique_ptr<ScanRows>(ByteSource&)>;

// Points in pieces; `make` is called again to rewind. Errors name the file.
class ScanRowsStream final : public PointStream {
 public:
  ScanRowsStream(std::unique_ptr<RandomAccess> file, std::string name, MakeScanRows make)
      : file_(std::move(file)), name_(std::move(name)), make_(std::move(make)) {}

  const StreamHeader& header() const noexcept override { return header_; }
  Result<std::size_t> read(std::span<Vec3> out) override {
    std::size_t written = 0;
    while (written < out.size() && !ended_) {
      Result<bool> more = rows_->next();
      if (!more) return std::move(more).error().in_file(name_);
      ended_ = !*more;
      if (!ended_) out[written++] = rows_->point();
    }
    return written;
  }
  Status rewind() override {
    source_ = std::make_unique<AccessSource>(*file_);
    rows_ = make_(*source_);
    ended_ = false;
    Status begun = rows_->begin();
    if (!begun) return std::move(begun).error().in_file(name_);
    header_.format = rows_->format();
    header_.points = rows_->promised();
    header_.conventional_unit = Unit::kMetre;
    return begun;
  }

 private:
  std::unique_ptr<RandomAccess> file_;
  std::string name_;
  MakeScanRows make_;
  std::unique_ptr<AccessSource> source_;
  std::unique_ptr<ScanRows> rows_;
  StreamHeader header_;
  bool ended_ = false;
};

}  // namespace

bool ScanRows::next_line(std::string_view& line) {
  while (in_.next_line(line)) {
    line = trimmed(line);
    if (!line.empty()) return true;
  }
  return false;
}

Error ScanRows::at_line(std::string what, std::string remedy) const {
  return in_.error_or({std::move(what), std::move(remedy)});
}

Status ScanRows::take_row(std::string_view row) {
  std::array<double, kMaxScanColumns> numbers{};
  std::size_t count = 0;
  for (std::string_view token = next_token(row); !token.empty(); token = next_token(row)) {
    if (count == numbers.size())
      return at_line(fmt::format("a row has more than {} columns", kMaxScanColumns));
    const std::optional<double> number = parse_real(token);
    if (!number)
      return at_line(fmt::format("{} is not a number", shown(token)), number_remedy(token, kCheckLine));
    numbers[count++] = *number;
  }
  if (columns_ == 0) columns_ = count;
  if (count < kAxesOfRow)
    return at_line(fmt::format("a row needs at least {} columns, this one has {}", kAxesOfRow, count));
  if (count != columns_)
    return at_line(fmt::format("this row has {} columns, the first has {}", count, columns_));
  point_ = Vec3(numbers[0], numbers[1], numbers[2]);
  values_.fill(std::numeric_limits<float>::quiet_NaN());
  const bool colours_alone = count == kAxesOfRow + kColoursOfRow;
  for (std::size_t c = kAxesOfRow; c < std::min(count, kFullRow); ++c) {
    const std::size_t value = c - kAxesOfRow + (colours_alone ? 1 : 0);
    // Five columns are intensity and one that nobody names.
    if (value == 0 || colours_alone || count >= kFullRow) values_[value] = to_float(numbers[c]);
  }
  const bool named = count <= kAxesOfRow + 1 || colours_alone || count == kFullRow;
  if (!named) unnamed_columns_ = std::max(unnamed_columns_, count);
  return Done{};
}

void ScanRows::warn_of_columns(DecodedFile& decoded) const {
  if (unnamed_columns_ > 0)
    decoded.warnings.push_back(fmt::format(
        "Rows have {} columns; what is neither x y z, intensity nor colour (columns 4 and 5 to 7) was passed "
        "over.",
        unnamed_columns_));
}

namespace {

Result<std::unique_ptr<PointStream>> stream_scan_rows(std::unique_ptr<RandomAccess> file,
                                                      const std::string& name, MakeScanRows make) {
  auto stream = std::make_unique<ScanRowsStream>(std::move(file), name, std::move(make));
  PALPATE_TRY(stream->rewind());
  return std::unique_ptr<PointStream>(std::move(stream));
}

// The rest of `rows`, which has begun.
Result<DecodedFile> decode_scan_rows(const ReaderInput& input, ScanRows& rows) {
  DecodedFile decoded;
  decoded.format = rows.format();
  decoded.conventional_unit = Unit::kMetre;
  decoded.points.reserve(reserve_count(rows.promised(), kMinScanRowBytes, rows.input().remaining()));
  for (const char* name : kScanValues) decoded.properties.push_back({name, {}});
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  ReadMonitor watch(input, rows.input(), decoded);
  while (true) {
    PALPATE_ASSIGN(const bool more, rows.next());
    if (!more) break;
    if (decoded.points.size() == kMaxPoints)
      return over_memory_limit("the file's points", input.options.max_bytes);
    for (std::size_t v = 0; v < kScanValues.size(); ++v) {
      std::vector<float>& values = decoded.properties[v].values;  // empty until a row has one
      const float value = rows.values()[v];
      if (std::isnan(value) && values.empty()) continue;
      values.resize(decoded.points.size(), kNone);
      values.push_back(value);
    }
    decoded.points.push_back(rows.point());
    if (const std::optional<std::uint32_t> position = rows.position())
      decoded.position_of.push_back(*position);
    if (!watch.row()) return watch.error();
  }
  std::erase_if(decoded.properties, [](const cloud::Property& property) { return property.values.empty(); });
  rows.finish(decoded);
  return decoded;
}

// A line with one whole number that is not negative.
std::optional<std::uint64_t> lone_count(std::string_view line) {
  const std::optional<std::int64_t> value = parse_whole(next_token(line));
  if (!value || *value < 0 || !next_token(line).empty()) return std::nullopt;
  return static_cast<std::uint64_t>(*value);
}

// Cuts the next line that is not blank off a text's front; nothing where the front may end within it.
std::optional<std::string_view> next_whole_line(std::string_view& front) {
  while (true) {
    const std::size_t end = front.find_first_of("\r\n");
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view line = trimmed(front.substr(0, end));
    front.remove_prefix(end + 1);
    if (!line.empty()) return line;
  }
}

// ---- PTX and PTS

// Numbers of one line, exactly N.
template <std::size_t N>
std::optional<std::array<double, N>> finite_numbers(std::string_view line) {
  std::array<double, N> numbers{};
  for (double& number : numbers) {
    const std::optional<double> value = parse_real(next_token(line));
    if (!value || !std::isfinite(*value)) return std::nullopt;
    number = *value;
  }
  if (!next_token(line).empty()) return std::nullopt;
  return numbers;
}

// The scanner's position and its three axes; the matrix behind them says the same for the points.
constexpr std::size_t kPoseLines = 4, kMatrixLines = 4;

class PtxRows final : public ScanRows {
 public:
  using ScanRows::ScanRows;

  Status begin() override {
    std::string_view line;
    if (!next_line(line)) return at_line("the file holds no points", "give a PTX file with a scan");
    PALPATE_TRY(begin_scan(line));
    promised_ = left_;
    return Done{};
  }

  Result<bool> next() override {
    std::string_view line;
    while (true) {
      if (!next_line(line)) {
        if (in_.error() || left_ > 0)
          return at_line(fmt::format("the file ends after {} of the {} promised points of scan {}", taken_,
                                     taken_ + left_, scans_),
                         kFetchScan);
        return false;
      }
      if (left_ == 0) {
        PALPATE_TRY(begin_scan(line));
        continue;
      }
      PALPATE_TRY(take_row(line));
      --left_;
      ++taken_;
      // No scanner measures a point within itself: these are directions without return.
      if (point_ == Vec3::Zero()) {
        ++holes_;
        continue;
      }
      point_ = linear_ * point_ + translation_;
      return true;
    }
  }

  std::optional<std::uint32_t> position() const override {
    if (scans_ != 1) return std::nullopt;
    return static_cast<std::uint32_t>(taken_ - 1);
  }

  void finish(DecodedFile& decoded) const override {
    warn_of_columns(decoded);
    if (holes_ > 0)
      decoded.warnings.push_back(fmt::format("{} directions of the scan have no return: holes.", holes_));
    const bool grid = scans_ == 1 && first_columns_ > 1 && first_rows_ > 1;
    if (grid && holes_ == 0) decoded.raster = cloud::ScanRaster{first_rows_, first_columns_};
    if (grid && holes_ > 0)
      decoded.position_columns = first_rows_;
    else
      release_memory(decoded.position_of);
  }
  std::string format() const override {
    return fmt::format("PTX, first scan {} x {}", first_columns_, first_rows_);
  }

 private:
  // The ten lines before a scan; `line` is the first.
  Status begin_scan(std::string_view line) {
    ++scans_;
    const std::string scan = fmt::format("scan {}", scans_);
    std::array<std::uint64_t, 2> counts{};
    for (std::size_t i = 0; i < counts.size(); ++i) {
      if (i > 0 && !next_line(line)) return cut_header(scan);
      const std::optional<std::uint64_t> count = lone_count(line);
      if (!count)
        return at_line(fmt::format("the number of {} of {} is expected here, not {}",
                                   i == 0 ? "columns" : "rows", scan, shown(line)),
                       scans_ == 1 ? "check that this is a PTX file"
                                   : "check the numbers of columns and rows of the scan before");
      counts[i] = *count;
    }
    for (std::size_t i = 0; i < kPoseLines; ++i) {
      if (!next_line(line)) return cut_header(scan);
      if (!finite_numbers<3>(line))
        return at_line(fmt::format("the pose of {} needs three numbers here, not {}", scan, shown(line)));
    }
    for (std::size_t i = 0; i < kMatrixLines; ++i) {
      if (!next_line(line)) return cut_header(scan);
      const auto row = finite_numbers<4>(line);
      if (!row)
        return at_line(fmt::format("the matrix of {} needs four numbers here, not {}", scan, shown(line)));
      // Points are rows, so the translation is the matrix's last row, and its last column is that of the unit
      // matrix. Writers give six digits.
      constexpr double kAffineSlack = 1e-5;
      const bool last = i + 1 == kMatrixLines;
      if (std::abs((*row)[3] - (last ? 1.0 : 0.0)) > kAffineSlack)
        return at_line(
            fmt::format("the matrix of {} is no motion: its last column has {:g}", scan, (*row)[3]),
            "export the file again with rigid poses");
      const Vec3 first_three((*row)[0], (*row)[1], (*row)[2]);
      if (last)
        translation_ = first_three;
      else
        linear_.col(static_cast<Eigen::Index>(i)) = first_three;
    }
    const auto [columns, rows] = counts;
    const std::uint64_t most =
        std::min(kMaxPoints,
                 in_.remaining().value_or(std::numeric_limits<std::uint64_t>::max()) / kMinScanRowBytes + 1);
    if (rows > 0 && columns > most / rows)
      return at_line(
          fmt::format("{} promises {} x {} points, which the file has no room for", scan, columns, rows),
          kFetchScan);
    left_ = columns * rows;
    taken_ = 0;
    begin_block();
    if (scans_ == 1) {
      first_columns_ = static_cast<std::uint32_t>(rows > 0 ? columns : 0);
      first_rows_ = static_cast<std::uint32_t>(columns > 0 ? rows : 0);
    }
    return Done{};
  }
  [[nodiscard]] Error cut_header(const std::string& scan) const {
    return at_line(fmt::format("the file ends within the ten lines before {}", scan), kFetchScan);
  }

  std::uint64_t scans_ = 0, holes_ = 0;
  std::uint64_t taken_ = 0, left_ = 0;  // of the present scan
  std::uint32_t first_columns_ = 0, first_rows_ = 0;
  Mat3 linear_ = Mat3::Identity();  // of columns, the transpose of what the file has
  Vec3 translation_ = Vec3::Zero();
};

class PtsRows final : public ScanRows {
 public:
  using ScanRows::ScanRows;

  // Leaves the first row of numbers for next().
  Status begin() override {
    std::string_view line;
    while (next_line(line)) {
      if (line.front() == '#' || line.starts_with("//")) continue;
      if (const std::optional<std::uint64_t> count = lone_count(line)) {
        begin_counted(*count);
        promised_ = std::min(*count, in_.remaining().value_or(*count) / kMinScanRowBytes + 1);
      } else {
        first_ = line;
      }
      return Done{};
    }
    return at_line("the file holds no points", "give a count and rows of x y z");
  }

  Result<bool> next() override {
    std::string_view line;
    while (true) {
      if (first_.empty() && !next_line(line)) {
        if (in_.error()) return *in_.error();
        PALPATE_TRY(check_block());
        return false;
      }
      if (!first_.empty()) {
        PALPATE_TRY(take_row(std::exchange(first_, {})));
      } else if (const std::optional<std::uint64_t> count = lone_count(line)) {
        PALPATE_TRY(check_block());
        begin_counted(*count);
        continue;
      } else {
        PALPATE_TRY(take_row(line));
      }
      ++taken_;
      ++total_;
      return true;
    }
  }

  void finish(DecodedFile& decoded) const override {
    warn_of_columns(decoded);
    if (blocks_ > 0 && total_ > total_promised_)
      decoded.warnings.push_back(
          fmt::format("The file's own count promises {} points, the file holds {} more; they were read too.",
                      total_promised_, total_ - total_promised_));
  }
  std::string format() const override { return "PTS"; }

  // All counts so far, as they stand.
  [[nodiscard]] std::uint64_t counted() const noexcept { return total_promised_; }

 private:
  void begin_counted(std::uint64_t count) noexcept {
    ++blocks_;
    block_ = count;
    // Counts of 63 bits: the sum of a file's blocks stays an upper bound where it would pass the end.
    total_promised_ = count > std::numeric_limits<std::uint64_t>::max() - total_promised_
                          ? std::numeric_limits<std::uint64_t>::max()
                          : total_promised_ + count;
    taken_ = 0;
    begin_block();
  }
  Status check_block() const {
    if (taken_ >= block_) return Done{};
    return at_line(
        fmt::format("block {} promises {} points, the file holds {} of them", blocks_, block_, taken_),
        kFetchScan);
  }

  std::string first_;  // a row where a count was looked for
  std::uint64_t blocks_ = 0, block_ = 0, taken_ = 0;
  std::uint64_t total_ = 0, total_promised_ = 0;
};

template <class Rows>
std::unique_ptr<ScanRows> make_rows(ByteSource& bytes) {
  return std::make_unique<Rows>(bytes);
}

}  // namespace

bool starts_as_ptx(std::string_view front) {
  constexpr std::size_t kHeaderLines = 2 + kPoseLines + kMatrixLines;
  for (std::size_t i = 0; i < kHeaderLines; ++i) {
    const std::optional<std::string_view> line = next_whole_line(front);
    if (!line) return false;
    const bool right = i < 2                ? lone_count(*line).has_value()
                       : i < 2 + kPoseLines ? finite_numbers<3>(*line).has_value()
                                            : finite_numbers<4>(*line).has_value();
    if (!right) return false;
  }
  return true;
}

bool starts_as_pts(std::string_view front) {
  const std::optional<std::string_view> count = next_whole_line(front);
  if (!count || !lone_count(*count)) return false;
  front.remove_prefix(std::min(front.find_first_not_of(" \t\r\n"), front.size()));
  std::string_view row = trimmed(front.substr(0, front.find_first_of("\r\n")));
  for (std::size_t axis = 0; axis < kAxesOfRow; ++axis)
    if (!parse_real(next_token(row))) return false;
  return true;
}

Result<std::unique_ptr<PointStream>> ptx_stream(std::unique_ptr<RandomAccess> file, const std::string& name) {
  return stream_scan_rows(std::move(file), name, make_rows<PtxRows>);
}
Result<std::unique_ptr<PointStream>> pts_stream(std::unique_ptr<RandomAccess> file, const std::string& name) {
  return stream_scan_rows(std::move(file), name, make_rows<PtsRows>);
}

Result<DecodedFile> read_ptx(const ReaderInput& input) {
  PtxRows rows(input.bytes);
  PALPATE_TRY(rows.begin());
  return decode_scan_rows(input, rows);
}

Result<DecodedFile> read_pts(const ReaderInput& input) {
  // In memory, because two readers look at the front.
  PALPATE_ASSIGN(const std::vector<std::byte> bytes, read_all(input.bytes, input.options.max_bytes));
  MemorySource source(bytes);
  const ReaderInput again{source, input.name, input.options, input.progress};
  const std::string_view front(reinterpret_cast<const char*>(bytes.data()),
                               std::min(bytes.size(), kScanTextFrontBytes));
  if (!starts_as_pts(front)) return read_xyz(again);
  PtsRows rows(source);
  PALPATE_TRY(rows.begin());
  PALPATE_TRY(check_memory(rows.counted(), sizeof(Vec3), "points", input.options));
  return decode_scan_rows(again, rows);
}

}  // namespace palpate::io
