#include "toolkit/trace/csv_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/messages.h"

namespace palpate::trace {

namespace {

constexpr std::string_view kGzip = "\x1f\x8b", kXz =
                                                   "\xfd"
                                                   "7zXZ";  // first bytes of compressed files

}  // namespace

LineReader::LineReader(InputFile file, std::uint64_t max_bytes)
    : file_(std::move(file)),
      max_bytes_(max_bytes),
      buffer_(std::make_unique<std::array<char, kBufferBytes>>()) {}

Result<LineReader> LineReader::open(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(InputFile opened, InputFile::open(file));
  return LineReader(std::move(opened), max_bytes);
}

bool LineReader::next(std::string_view& line) {
  while (next_any(line))
    if (line.find_first_not_of(" \t") != std::string_view::npos) return true;
  return false;
}

Error LineReader::error(std::string what, std::string remedy) const {
  return Error{std::move(what), std::move(remedy), file_.path(), line_};
}

Status LineReader::fits(const ProbePath& path, std::size_t bytes_a_row) const {
  if (path.size() < max_bytes_ / bytes_a_row) return Done{};
  return over_memory_limit("what the file records", max_bytes_).in_file(file_.path(), line_);
}

bool LineReader::next_any(std::string_view& line) {
  std::size_t end = end_of_line();
  if (end == std::string_view::npos && !ended_) {
    refill();
    end = end_of_line();
  }
  if (failure() != nullptr || (ended_ && rest_.empty())) return false;
  ++line_;
  line = rest_.substr(0, end);
  rest_.remove_prefix(std::min(rest_.size(), line.size() + 1));
  if (line_ == 1 && !is_plain(line)) return false;
  if (line.size() > kLongestLine) {
    failure_ =
        error(fmt::format("the line is longer than {} characters", kLongestLine), "is this the right file?");
    return false;
  }
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line_ > 1 || without_mark(line);
}

/// Moves the rest to the front and reads more.
void LineReader::refill() {
  std::copy(rest_.begin(), rest_.end(), buffer_->begin());
  const Result<std::size_t> got =
      file_.read(std::as_writable_bytes(std::span(*buffer_).subspan(rest_.size())));
  if (!got) {
    failure_ = got.error();
    return;
  }
  ended_ = rest_.size() + *got < buffer_->size();
  rest_ = {buffer_->data(), rest_.size() + *got};
  if (line_ == 0 && ends_lines_with_cr(rest_)) line_end_ = '\r';
}

bool LineReader::is_plain(std::string_view first_line) {
  const bool plain = !first_line.starts_with(kGzip) && !first_line.starts_with(kXz);
  if (!plain) failure_ = Error{"the file is compressed", "unpack it first", file_.path()};
  return plain;
}

bool LineReader::without_mark(std::string_view& first_line) {
  const Result<std::size_t> mark = byte_order_mark(first_line);
  if (!mark)
    failure_ = error(mark.error().what, mark.error().remedy);
  else
    first_line.remove_prefix(*mark);
  return mark.ok();
}

Result<CsvDialect> form_of(const LineReader& reader, std::string_view row) {
  Result<CsvDialect> form = CsvDialect::of(row);
  if (!form) return reader.error(form.error().what, form.error().remedy);
  return form;
}

Result<double> finite_number(const LineReader& reader, CsvDialect& form, std::string_view text,
                             std::string_view place, std::string_view remedy) {
  const std::optional<std::string_view> pointed = form.with_decimal_point(text);
  const Result<double> value = parse_number(pointed.value_or(text));
  if (!value || !std::isfinite(*value))
    return reader.error(fmt::format("{} {} is not a finite number", place, shown(text)), std::string(remedy));
  return *value;
}

namespace {

/// Parses fields as finite numbers; exactly as many as `values` holds. `fields` has room for one more.
Status parse_row(const LineReader& reader, CsvDialect& form, std::string_view line, std::span<double> values,
                 std::span<std::string_view> fields) {
  const std::size_t count = form.split(line, fields);
  for (std::size_t i = 0; i < std::min(count, values.size()); ++i) {
    PALPATE_ASSIGN(values[i], finite_number(reader, form, fields[i], fmt::format("field {}", i + 1),
                                            "write numbers with a decimal point and no blanks"));
  }
  if (count > values.size()) {
    const std::string readings = comma_readings(line);
    return reader.error(
        fmt::format("the row has more than {} fields{}{}", values.size(), readings.empty() ? "" : ": ",
                    readings),
        readings.empty() ? "remove what follows" : "separate columns by semicolons, or write decimal points");
  }
  if (count != values.size())
    return reader.error(fmt::format("the row has {} fields instead of {}", count, values.size()),
                        "complete the row");
  return Done{};
}

/// The header with commas; spreadsheets with decimal commas write semicolons.
std::string with_commas(std::string_view header) {
  std::string text(header);
  if (CsvDialect::of_header(header).separator() == ';') std::replace(text.begin(), text.end(), ';', ',');
  return text;
}

}  // namespace

Status check_time(const LineReader& reader, const ProbePath& path, double t_s) {
  if (path.t_s.empty() || t_s > path.t_s.back()) return Done{};
  return reader.error(fmt::format("time goes from {} s to {} s", path.t_s.back(), t_s),
                      "sort the rows so that time strictly increases");
}

Status read_rows(LineReader& reader, std::string_view header, std::string_view or_else,
                 const std::function<Status(std::span<const double>)>& row) {
  std::string_view line;
  if (!reader.next(line))
    return reader.failure()
               ? *reader.failure()
               : reader.error("the file is empty", fmt::format("begin with the header {}", header));
  if (with_commas(line) != header)
    return reader.error("the header is not that of such a file",
                        fmt::format("the first line must be {}{}", header, or_else));
  std::vector<double> values(1 + static_cast<std::size_t>(std::count(header.begin(), header.end(), ',')));
  std::vector<std::string_view> fields(values.size() + 1);
  std::optional<CsvDialect> form;
  while (reader.next(line)) {
    if (!form) {
      PALPATE_ASSIGN(form, form_of(reader, line));
      if (form->separator() == ' ') form = CsvDialect::of_header(header);
    }
    PALPATE_TRY(parse_row(reader, *form, line, values, fields));
    PALPATE_TRY(row(values));
  }
  if (reader.failure()) return *reader.failure();
  if (!form) return reader.error("there is no row after the header", "record at least one position");
  return Done{};
}

}  // namespace palpate::trace
