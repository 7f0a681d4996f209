// Rows of numbers: XYZ, CSV, TXT, ASC, PTS. The first rows decide separator, names and number of columns for
// the whole file.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>

#include <palpate/result.h>
#include "toolkit/core/csv_dialect.h"
#include "toolkit/io/decoding.h"

namespace palpate::io {
namespace {

// Beyond that a row is no point with properties. Keeps a row's cost bounded.
constexpr std::size_t kMaxColumns = 64;
constexpr std::size_t kMinColumns = 3;
// Reserved up front per byte of an uncompressed file: "0 0 0" and the end of the line.
constexpr std::uint64_t kMinRowBytes = 6;

struct Columns {
  CsvDialect form;
  std::size_t count = 0;
  std::array<std::size_t, 3> axis{0, 1, 2};     // the columns of x, y, z
  std::vector<std::string> names;               // empty where the file gives none
  std::vector<std::size_t> property_of_column;  // kNone where a column is not kept
  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
};

bool is_comment(std::string_view row) {
  return row.front() == '#' || row.starts_with("//") || row.front() == '%' || row.front() == '!';
}

// A name in lower case without quotes: whole, and its word without the unit in brackets or behind _.
struct Name {
  std::string whole, word, unit;
};

Name name_of(std::string_view field) {
  field = trimmed(field);
  constexpr std::size_t kQuotes = 2;
  if (field.size() >= kQuotes && (field.front() == '"' || field.front() == '\'') &&
      field.back() == field.front())
    field = trimmed(field.substr(1, field.size() - kQuotes));
  Name name{lower_case(field), lower_case(field), {}};
  std::size_t at = name.word.find_first_of("([");
  if (at == std::string::npos) at = name.word.rfind('_');
  if (at == std::string::npos || at == 0) return name;
  std::string_view unit = std::string_view(name.word).substr(at + 1);
  if (!unit.empty() && (unit.back() == ')' || unit.back() == ']')) unit.remove_suffix(1);
  if (name.word[at] == '_' && !parse_unit(unit)) return name;
  name.unit = trimmed(unit);
  name.word = trimmed(std::string_view(name.word).substr(0, at));
  return name;
}

// The names of coordinates: those of files, and those of surveyors. The first row that is complete counts.
constexpr std::array<std::array<std::string_view, 3>, 6> kAxes{{{"x", "y", "z"},
                                                                {"easting", "northing", "height"},
                                                                {"easting", "northing", "elevation"},
                                                                {"easting", "northing", "z"},
                                                                {"east", "north", "height"},
                                                                {"rechtswert", "hochwert", "höhe"}}};
// The same words as parts of longer ones.
constexpr std::array<std::string_view, 4> kAround{"coord", "point", "pos", "position"};

std::string bare_axis(std::string word) {
  for (const std::string_view part : kAround)
    for (const char* const mark : {"_", ".", " "}) {
      const std::string before = std::string(part) + mark, behind = mark + std::string(part);
      if (word.starts_with(before)) return word.substr(before.size());
      if (word.ends_with(behind)) return word.substr(0, word.size() - behind.size());
    }
  return word;
}

// The columns of x, y and z; false where they are not named.
bool take_names(Columns& columns, std::optional<Unit>& unit) {
  std::vector<Name> names;
  for (const std::string& name : columns.names) {
    names.push_back(name_of(name));
    names.back().word = bare_axis(std::move(names.back().word));
  }
  for (const auto& axes : kAxes) {
    std::array<std::size_t, 3> found{};
    for (std::size_t a = 0; a < found.size(); ++a)
      found[a] = static_cast<std::size_t>(
          std::find_if(names.begin(), names.end(), [&](const Name& name) { return name.word == axes[a]; }) -
          names.begin());
    if (*std::max_element(found.begin(), found.end()) == names.size()) continue;
    columns.axis = found;
    const std::string& first = names[found[0]].unit;
    if (!first.empty() && first == names[found[1]].unit && first == names[found[2]].unit)
      if (const Result<Unit> stated = parse_unit(first)) unit = *stated;
    return true;
  }
  return false;
}

class XyzReader {
 public:
  explicit XyzReader(const ReaderInput& input) : input_(input), in_(input.bytes) {}

  Result<DecodedFile> read() {
    decoded_.format = "columns of text";
    std::string_view row;
    if (!next_row(row)) return in_.error_or(no_points());
    PALPATE_TRY(begin(row));
    ReadMonitor watch(input_, in_, decoded_);
    // begin() leaves `row` at the first row of numbers.
    if (!row.empty()) {
      do {
        PALPATE_TRY(add(row));
        if (!watch.row()) return watch.error();
      } while (next_row(row));
    }
    if (in_.error()) return *in_.error();
    if (decoded_.points.empty()) return no_points();
    if (promised_ && *promised_ < decoded_.points.size())
      decoded_.warnings.push_back(
          fmt::format("The first line promises {} points, the file holds {} more; they were read too.",
                      *promised_, decoded_.points.size() - *promised_));
    if (promised_ && *promised_ > decoded_.points.size())
      return Error{fmt::format("the first line promises {} points, the file holds {}", *promised_,
                               decoded_.points.size()),
                   "the file is cut off: fetch it again",
                   {},
                   in_.line_number()};
    return std::move(decoded_);
  }

 private:
  static Error no_points() { return Error{"the file holds no points", "give rows of x y z"}; }
  Error bad_row(std::string what, std::string remedy = kCheckLine) const {
    return Error{std::move(what), std::move(remedy), {}, in_.line_number()};
  }

  Error not_a_number(std::string_view field) const {
    return bad_row(fmt::format("{} is not a number", shown(field)), number_remedy(field, kCheckLine));
  }

  // The next row that is neither empty nor a comment.
  bool next_row(std::string_view& row) {
    while (in_.next_line(row)) {
      row = trimmed(row);
      if (row.empty()) continue;
      if (!is_comment(row)) return true;
      if (columns_.count == 0) comment_ = row;
    }
    return false;
  }

  // Cuts a row into fields_. A mark at the end of a row stands before an empty last field, or for nothing:
  // the first row decides.
  std::size_t split(std::string_view row) {
    std::size_t count = columns_.form.split(row, fields_);
    if (columns_.form.separator() == ' ') return count;
    for (std::size_t c = 0; c < count; ++c) fields_[c] = trimmed(fields_[c]);
    if (count > 0 && count != columns_.count && fields_[count - 1].empty()) --count;
    return count;
  }
  Result<std::size_t> split_first(std::string_view row) {
    Result<CsvDialect> form = CsvDialect::of(row);
    if (!form) return bad_row(form.error().what, form.error().remedy);
    columns_.form = std::move(*form);
    return split(row);
  }
  std::optional<double> number(std::string_view field) {
    const std::optional<std::string_view> pointed = columns_.form.with_decimal_point(field);
    return pointed ? parse_real(*pointed) : std::nullopt;
  }

  // The names that a line of words gives; a unit in brackets belongs to the word before.
  std::vector<std::string> names_in(std::string_view words) {
    columns_.form = CsvDialect::of_header(words);
    std::vector<std::string> names;
    const std::size_t count = split(words);
    for (std::size_t c = 0; c < count; ++c) {
      const bool unit = !names.empty() && (fields_[c].starts_with('(') || fields_[c].starts_with('['));
      if (unit)
        names.back() += " " + std::string(fields_[c]);
      else
        names.emplace_back(fields_[c]);
    }
    return names;
  }

  // Looks at the first rows: a lone count, names in a row or in the comment above, the first numbers.
  Status begin(std::string_view& row) {
    columns_.form = CsvDialect::of_header(row);
    std::size_t count = split(row);
    if (count == 1) {
      if (const std::optional<std::int64_t> number = parse_whole(fields_[0]); number && *number >= 0) {
        promised_ = static_cast<std::uint64_t>(*number);
        if (!next_row(row)) {
          row = {};
          return Done{};
        }
        columns_.form = CsvDialect::of_header(row);
        count = split(row);
      }
    }
    std::vector<std::string> names;
    const bool header = count >= kMinColumns && count <= kMaxColumns &&
                        is_header_row(std::span<const std::string_view>(fields_).first(count));
    if (header) {
      names = names_in(row);
      if (!next_row(row)) {
        row = {};
        return in_.error_or(no_points());
      }
    } else if (!comment_.empty()) {
      names = names_in(trimmed(
          std::string_view(comment_).substr(std::min(comment_.find_first_not_of("#/%!"), comment_.size()))));
    }
    // The names may have other separators than the numbers.
    PALPATE_ASSIGN(count, split_first(row));
    if (header && count != names.size()) {
      const std::string readings = count == 2 * names.size() ? comma_readings(row) : std::string();
      return bad_row(fmt::format("this row has {} columns, the header line names {}{}{}", count, names.size(),
                                 readings.empty() ? "" : ": ", readings));
    }
    if (count == names.size()) columns_.names = names;
    const bool named = !columns_.names.empty() && take_names(columns_, decoded_.unit);
    if (!named && !header) columns_.names.clear();
    for (std::string& name : columns_.names) name = name_of(name).whole;
    decoded_.format += fmt::format("; x, y, z are columns {}, {}, {}", columns_.axis[0] + 1,
                                   columns_.axis[1] + 1, columns_.axis[2] + 1);
    if (!named && count >= kMinColumns)
      decoded_.format += fmt::format(" of {}; the first row is {}", count, shown(row));
    if (header && !named && count >= kMinColumns)
      decoded_.warnings.push_back(
          fmt::format("The header line does not name x, y and z; the first three columns were taken ({}, {}, "
                      "{}).",
                      columns_.names[0], columns_.names[1], columns_.names[2]));
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
      if (!fields_[c].empty() && !number(fields_[c])) {
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
      decoded_.points.reserve(reserve_count(*promised_, kMinRowBytes, in_.remaining()));
    }
    return Done{};
  }

  Status add(std::string_view row) {
    const std::size_t count = split(row);
    if (count != columns_.count)
      return bad_row(fmt::format("this row has {} columns, the first has {}", count, columns_.count));
    Vec3 point;
    for (std::size_t a = 0; a < columns_.axis.size(); ++a) {
      const std::string_view field = fields_[columns_.axis[a]];
      const std::optional<double> value = number(field);
      if (!value) return not_a_number(field);
      point[static_cast<Eigen::Index>(a)] = *value;
    }
    for (std::size_t c = 0; c < count; ++c) {
      const std::size_t property = columns_.property_of_column[c];
      if (property == Columns::kNone) continue;
      // An empty field is a missing value.
      const std::optional<double> value =
          fields_[c].empty() ? std::optional<double>(std::numeric_limits<double>::quiet_NaN())
                             : number(fields_[c]);
      if (!value) return not_a_number(fields_[c]);
      decoded_.properties[property].values.push_back(to_float(*value));
    }
    decoded_.points.push_back(point);
    return Done{};
  }

  const ReaderInput& input_;
  BufferedInput in_;
  Columns columns_;
  std::string comment_;  // the last one above the first row
  DecodedFile decoded_;
  std::optional<std::uint64_t> promised_;
  std::array<std::string_view, kMaxColumns + 1> fields_{};
};

}  // namespace

Result<DecodedFile> read_xyz(const ReaderInput& input) {
  return XyzReader(input).read();
}

}  // namespace palpate::io
