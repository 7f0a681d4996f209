// Rows of numbers: XYZ, CSV, TXT, ASC, PTS. What separates the columns, whether they have names and how many
// there are is decided by the first rows and then holds for the whole file.
#include <fmt/format.h>

#include <array>
#include <limits>

#include "toolkit/core/try.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/text.h"

namespace palpate::io {
namespace {

// Beyond that a row is no point with properties. Keeps a row's cost bounded.
constexpr std::size_t kMaxColumns = 64;
constexpr std::size_t kMinColumns = 3;
// Reserved up front per byte of an uncompressed file: "0 0 0" and the end of the line.
constexpr std::uint64_t kMinRowBytes = 6;

enum class Separator { kBlank, kComma, kSemicolon };

struct Columns {
  Separator separator = Separator::kBlank;
  std::size_t count = 0;
  std::array<std::size_t, 3> axis{0, 1, 2};     // the columns of x, y, z
  std::vector<std::string> names;               // empty where the file gives none
  std::vector<std::size_t> property_of_column;  // kNone where a column is not kept
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
};

Separator separator_of(std::string_view line) {
  if (line.find(';') != std::string_view::npos) return Separator::kSemicolon;
  if (line.find(',') != std::string_view::npos) return Separator::kComma;
  return Separator::kBlank;
}

// The fields of a row; at most kMaxColumns + 1, so that the caller sees that there are too many.
std::size_t split(std::string_view line, Separator separator,
                  std::array<std::string_view, kMaxColumns + 1>& fields) {
  std::size_t count = 0;
  if (separator == Separator::kBlank) {
    for (std::string_view token = next_token(line); !token.empty() && count < fields.size();
         token = next_token(line))
      fields[count++] = token;
    return count;
  }
  const char mark = separator == Separator::kComma ? ',' : ';';
  while (count < fields.size()) {
    const std::size_t at = line.find(mark);
    const std::string_view field = trimmed(line.substr(0, at));
    if (at == std::string_view::npos && field.empty()) break;  // a separator at the end of the line
    fields[count++] = field;
    if (at == std::string_view::npos) break;
    line.remove_prefix(at + 1);
  }
  return count;
}

bool is_comment(std::string_view row) {
  return row.front() == '#' || row.starts_with("//") || row.front() == '%' || row.front() == '!';
}

// The next row that is neither empty nor a comment.
bool next_row(Input& in, std::string_view& row) {
  while (in.next_line(row)) {
    row = trimmed(row);
    if (!row.empty() && !is_comment(row)) return true;
  }
  return false;
}

std::string unquoted(std::string_view field) {
  constexpr std::size_t kQuotes = 2;
  if (field.size() >= kQuotes && field.front() == '"' && field.back() == '"')
    field = field.substr(1, field.size() - kQuotes);
  return lower_case(trimmed(field));
}

// The names x, y, z, alone or with a unit (x_mm); the unit is the file's own statement.
void take_names(Columns& columns, DecodedFile& decoded) {
  constexpr std::string_view kAxes[] = {"x", "y", "z"};
  std::array<std::size_t, 3> found{Columns::kNone, Columns::kNone, Columns::kNone};
  std::array<std::string, 3> suffix;
  for (std::size_t c = 0; c < columns.names.size(); ++c) {
    const std::string& name = columns.names[c];
    for (std::size_t a = 0; a < found.size(); ++a) {
      const bool plain = name == kAxes[a];
      const bool with_unit = name.size() > 2 && name.starts_with(kAxes[a]) && name[1] == '_' &&
                             parse_unit(std::string_view(name).substr(2));
      if (found[a] != Columns::kNone || !(plain || with_unit)) continue;
      found[a] = c;
      if (with_unit) suffix[a] = name.substr(2);
    }
  }
  if (found[0] == Columns::kNone || found[1] == Columns::kNone || found[2] == Columns::kNone) {
    decoded.warnings.push_back(
        "The header line does not name x, y and z; the first three columns were taken.");
    return;
  }
  columns.axis = found;
  if (!suffix[0].empty() && suffix[0] == suffix[1] && suffix[0] == suffix[2]) {
    if (const Result<Unit> unit = parse_unit(suffix[0])) decoded.unit = *unit;
  }
}

class XyzReader {
 public:
  explicit XyzReader(const ReaderInput& input) : input_(input), in_(input.bytes) {}

  Result<DecodedFile> read() {
    decoded_.format = "columns of text";
    std::string_view row;
    if (!next_row(in_, row)) return in_.error_or(no_points());
    PALPATE_TRY(begin(row));
    Watch watch(input_, in_, decoded_);
    // begin() leaves `row` at the first row of numbers.
    if (!row.empty()) {
      do {
        PALPATE_TRY(add(row));
        if (!watch.row()) return watch.error();
      } while (next_row(in_, row));
    }
    if (in_.error()) return *in_.error();
    if (decoded_.points.empty()) return no_points();
    if (promised_ && *promised_ > decoded_.points.size())
      return Error{fmt::format("the first line promises {} points, the file holds {}", *promised_,
                               decoded_.points.size()),
                   "the file is cut off: fetch it again",
                   {},
                   in_.line_number()};
    return std::move(decoded_);
  }

 private:
  static Error no_points() { return Error{"the file holds no points", "give rows of x y z", {}, 0}; }
  Error bad_row(std::string what, std::string remedy = "check the file at this line") const {
    return Error{std::move(what), std::move(remedy), {}, in_.line_number()};
  }

  // Looks at the first rows: a lone count, names, the first numbers.
  Status begin(std::string_view& row) {
    columns_.separator = separator_of(row);
    std::size_t count = split(row, columns_.separator, fields_);
    if (count == 1) {
      if (const std::optional<std::int64_t> number = parse_whole(fields_[0]); number && *number >= 0) {
        promised_ = static_cast<std::uint64_t>(*number);
        if (!next_row(in_, row)) {
          row = {};
          return Done{};
        }
        columns_.separator = separator_of(row);
        count = split(row, columns_.separator, fields_);
      }
    }
    // A name starts with no digit, sign or point; "1,5" between semicolons is no name but a decimal comma.
    constexpr std::string_view kNumberStarts = "+-.0123456789";
    bool any_number = false;
    for (std::size_t c = 0; c < std::min(count, fields_.size()); ++c)
      any_number = any_number || parse_real(fields_[c]) ||
                   (!fields_[c].empty() && kNumberStarts.find(fields_[c].front()) != std::string_view::npos);
    if (!any_number && count >= kMinColumns && count <= kMaxColumns) {
      for (std::size_t c = 0; c < count; ++c) columns_.names.push_back(unquoted(fields_[c]));
      take_names(columns_, decoded_);
      if (!next_row(in_, row)) {
        row = {};
        return in_.error_or(no_points());
      }
      // The names may have other separators than the numbers.
      columns_.separator = separator_of(row);
      count = split(row, columns_.separator, fields_);
      if (count != columns_.names.size())
        return bad_row(
            fmt::format("this row has {} columns, the header line names {}", count, columns_.names.size()));
    }
    return set_columns(count);
  }

  Status set_columns(std::size_t count) {
    if (count < kMinColumns)
      return bad_row(fmt::format("a row needs at least {} columns, this one has {}", kMinColumns, count));
    if (count > kMaxColumns) return bad_row(fmt::format("a row has more than {} columns", kMaxColumns));
    columns_.count = count;
    columns_.property_of_column.assign(count, Columns::kNone);
    for (std::size_t c = 0; c < count; ++c) {
      if (c == columns_.axis[0] || c == columns_.axis[1] || c == columns_.axis[2]) continue;
      const std::string name = columns_.names.empty() ? fmt::format("column{}", c + 1) : columns_.names[c];
      if (!fields_[c].empty() && !parse_real(fields_[c])) {
        decoded_.warnings.push_back(
            fmt::format("The column '{}' does not hold numbers and was left out.", name));
        continue;
      }
      columns_.property_of_column[c] = decoded_.properties.size();
      decoded_.properties.push_back({name, {}});
    }
    if (promised_) {
      if (Status fits = check_memory(*promised_, sizeof(Vec3) + decoded_.properties.size() * sizeof(float),
                                     "points", input_.options);
          !fits)
        return fits;
      decoded_.points.reserve(reservation(*promised_, kMinRowBytes, in_.remaining()));
    }
    return Done{};
  }

  Status add(std::string_view row) {
    std::size_t count = split(row, columns_.separator, fields_);
    // A separator at the end of a row stands before an empty last field, or for nothing: the first row
    // decides.
    if (count + 1 == columns_.count && columns_.separator != Separator::kBlank &&
        (row.back() == ',' || row.back() == ';'))
      fields_[count++] = {};
    if (count != columns_.count)
      return bad_row(fmt::format("this row has {} columns, the first has {}", count, columns_.count));
    Vec3 point;
    for (std::size_t a = 0; a < columns_.axis.size(); ++a) {
      const std::string_view field = fields_[columns_.axis[a]];
      const std::optional<double> value = parse_real(field);
      if (!value)
        return bad_row(fmt::format("{} is not a number", quoted(field)),
                       field.find(',') != std::string_view::npos ? "write decimal points, not decimal commas"
                                                                 : "check the file at this line");
      point[static_cast<Eigen::Index>(a)] = *value;
    }
    for (std::size_t c = 0; c < count; ++c) {
      const std::size_t property = columns_.property_of_column[c];
      if (property == Columns::kNone) continue;
      // An empty field is a missing value.
      const std::optional<double> value =
          fields_[c].empty() ? std::optional<double>(std::numeric_limits<double>::quiet_NaN())
                             : parse_real(fields_[c]);
      if (!value) return bad_row(fmt::format("{} is not a number", quoted(fields_[c])));
      decoded_.properties[property].values.push_back(to_float(*value));
    }
    decoded_.points.push_back(point);
    return Done{};
  }

  const ReaderInput& input_;
  Input in_;
  Columns columns_;
  DecodedFile decoded_;
  std::optional<std::uint64_t> promised_;
  std::array<std::string_view, kMaxColumns + 1> fields_{};
};

}  // namespace

Result<DecodedFile> read_xyz(const ReaderInput& input) {
  return XyzReader(input).read();
}

}  // namespace palpate::io
