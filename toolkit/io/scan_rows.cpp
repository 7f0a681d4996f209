#include "toolkit/io/read_ptx.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/messages.h"

namespace palpate::io {
namespace {

constexpr std::size_t kColoursOfRow = 3;
constexpr std::size_t kFullRow = kAxesOfRow + kScanValues.size();
// Keeps a row's cost bounded; writers add normals at most.
constexpr std::size_t kMaxScanColumns = 32;

// Bytes at any place, from front to back.
class AccessSource final : public ByteSource {
 public:
  explicit AccessSource(const RandomAccess& file) : file_(file) {}
  Result<std::size_t> read(std::span<std::byte> out) override {
    const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), file_.size() - at_));
    PALPATE_TRY(file_.read_at(at_, out.first(n)));
    at_ += n;
    return n;
  }
  std::optional<std::uint64_t> remaining() const override { return file_.size() - at_; }
  double fraction() const override {
    return file_.size() > 0 ? static_cast<double>(at_) / static_cast<double>(file_.size()) : 1.0;
  }

 private:
  const RandomAccess& file_;
  std::uint64_t at_ = 0;
};

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

Result<std::unique_ptr<PointStream>> stream_scan_rows(std::unique_ptr<RandomAccess> file,
                                                      const std::string& name, MakeScanRows make) {
  auto stream = std::make_unique<ScanRowsStream>(std::move(file), name, std::move(make));
  PALPATE_TRY(stream->rewind());
  return std::unique_ptr<PointStream>(std::move(stream));
}

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

std::optional<std::uint64_t> lone_count(std::string_view line) {
  const std::optional<std::int64_t> value = parse_whole(next_token(line));
  if (!value || *value < 0 || !next_token(line).empty()) return std::nullopt;
  return static_cast<std::uint64_t>(*value);
}

std::optional<std::string_view> next_whole_line(std::string_view& front) {
  while (true) {
    const std::size_t end = front.find_first_of("\r\n");
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view line = trimmed(front.substr(0, end));
    front.remove_prefix(end + 1);
    if (!line.empty()) return line;
  }
}

}  // namespace palpate::io
