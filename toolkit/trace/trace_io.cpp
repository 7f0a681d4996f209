#include "toolkit/trace/trace_io.h"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <memory>
#include <span>
#include <string_view>

#include "toolkit/core/atomic_file.h"
#include "toolkit/core/options.h"

namespace palpate::trace {
namespace {

// Longest line read: twelve numbers need at most some 300 characters; the rest is room for comments of .traj
// files.
constexpr std::size_t kLongestLine = 4096;
constexpr std::size_t kPathFields = 4;
constexpr std::size_t kTraceFields = 12;

struct CloseFile {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

/// Reads a text file line by line in a fixed buffer.
class LineReader {
 public:
  [[nodiscard]] static Result<LineReader> open(const std::string& file) {
    std::FILE* opened = std::fopen(file.c_str(), "rb");
    if (opened == nullptr)
      return Error{fmt::format("cannot open the file: {}", std::strerror(errno)), "check the path", file, 0};
    return LineReader(file, opened);
  }
  /// The next line without its end, or false at the end of the file; a failure is told by status().
  bool next(std::string_view& line) {
    if (std::fgets(buffer_->data(), static_cast<int>(buffer_->size()), file_.get()) == nullptr) {
      if (std::ferror(file_.get()) != 0)
        failure_ = error("cannot read on", "check the disk, or that it is a file");
      return false;
    }
    ++line_;
    std::size_t size = std::strlen(buffer_->data());
    if (size + 1 == buffer_->size() && (*buffer_)[size - 1] != '\n') {
      failure_ = error(fmt::format("the line is longer than {} characters", kLongestLine),
                       "is this the right file?");
      return false;
    }
    if (size > 0 && (*buffer_)[size - 1] == '\n') --size;
    if (size > 0 && (*buffer_)[size - 1] == '\r') --size;
    line = {buffer_->data(), size};
    return true;
  }
  [[nodiscard]] Error error(std::string what, std::string remedy) const {
    return Error{std::move(what), std::move(remedy), name_, line_};
  }
  [[nodiscard]] const Error* failure() const { return failure_.what.empty() ? nullptr : &failure_; }
  [[nodiscard]] std::int64_t line() const { return line_; }

 private:
  LineReader(std::string name, std::FILE* file)
      : name_(std::move(name)),
        file_(file),
        buffer_(std::make_unique<std::array<char, kLongestLine + 2>>()) {}
  std::string name_;
  std::unique_ptr<std::FILE, CloseFile> file_;
  std::unique_ptr<std::array<char, kLongestLine + 2>> buffer_;
  std::int64_t line_ = 0;
  Error failure_{};
};

/// Fields between commas as numbers; exactly as many as `values` has.
Status parse_row(const LineReader& reader, std::string_view line, std::span<double> values) {
  std::size_t field = 0;
  while (true) {
    const std::size_t comma = line.find(',');
    if (field == values.size())
      return reader.error(fmt::format("the row has more than {} fields", values.size()),
                          "remove what follows");
    const std::string_view text = line.substr(0, comma);
    const Result<double> value = parse_number(text);
    if (!value || !std::isfinite(*value))
      return reader.error(fmt::format("field {} '{}' is not a finite number", field + 1, text),
                          "write numbers with a decimal point and no blanks");
    values[field++] = *value;
    if (comma == std::string_view::npos) break;
    line.remove_prefix(comma + 1);
  }
  if (field != values.size())
    return reader.error(fmt::format("the row has {} fields instead of {}", field, values.size()),
                        "complete the row");
  return Done{};
}

Status check_time(const LineReader& reader, const ProbePath& path, double t_s) {
  if (path.t_s.empty() || t_s > path.t_s.back()) return Done{};
  return reader.error(fmt::format("time goes from {} s to {} s", path.t_s.back(), t_s),
                      "sort the rows so that time strictly increases");
}

/// Checks the header, then hands every row to `row`.
template <std::size_t fields, class Row>
Status read_rows(LineReader& reader, std::string_view header, const Row& row) {
  std::string_view line;
  if (!reader.next(line))
    return reader.failure()
               ? *reader.failure()
               : reader.error("the file is empty", fmt::format("begin with the header {}", header));
  if (line != header)
    return reader.error("the header is not that of such a file",
                        fmt::format("the first line must be {}", header));
  std::array<double, fields> values{};
  while (reader.next(line)) {
    if (Status parsed = parse_row(reader, line, values); !parsed) return parsed;
    if (Status taken = row(values); !taken) return taken;
  }
  if (reader.failure()) return *reader.failure();
  if (reader.line() < 2)
    return reader.error("there is no row after the header", "record at least one position");
  return Done{};
}

bool separates(char c) {
  return c == ' ' || c == '\t' || c == ',' || c == ';';
}

/// The numbers of a .traj line that `columns` asks for, by column.
Status parse_traj_line(const LineReader& reader, std::string_view line, std::span<const int> columns,
                       std::span<double> values) {
  const auto wanted = [&](int column) {
    for (std::size_t i = 0; i < columns.size(); ++i)
      if (columns[i] == column) return static_cast<int>(i);
    return -1;
  };
  std::size_t found = 0, needed = 0;
  for (const int column : columns) needed += column >= 0;
  int column = 0;
  for (std::size_t at = 0; at < line.size(); ++column) {
    while (at < line.size() && separates(line[at])) ++at;
    if (at == line.size()) break;
    std::size_t end = at;
    while (end < line.size() && !separates(line[end])) ++end;
    if (const int place = wanted(column); place >= 0) {
      const std::string_view text = line.substr(at, end - at);
      const Result<double> value = parse_number(text);
      if (!value || !std::isfinite(*value))
        return reader.error(fmt::format("column {} '{}' is not a finite number", column, text),
                            "check which columns hold what, counted from 0");
      values[static_cast<std::size_t>(place)] = *value;
      ++found;
    }
    at = end;
  }
  if (found != needed)
    return reader.error(fmt::format("the line has {} columns, too few", column),
                        "check which columns hold what, counted from 0");
  return Done{};
}

Status check_columns(const TrajColumns& c, const std::string& file) {
  const bool forces = c.fx >= 0 || c.fy >= 0 || c.fz >= 0;
  const bool all_forces = c.fx >= 0 && c.fy >= 0 && c.fz >= 0;
  if (c.x < 0 || c.y < 0 || c.z < 0 || (forces && !all_forces))
    return Error{"the columns of x, y, z (and, where there are forces, of all three) must be given",
                 "count columns from 0", file, 0};
  if (c.t < 0 && !(c.sample_rate_hz > 0.0 && std::isfinite(c.sample_rate_hz)))
    return Error{"there is neither a time column nor a sample rate", "give one of them", file, 0};
  const int columns[] = {c.t, c.x, c.y, c.z, c.fx, c.fy, c.fz};
  for (std::size_t i = 0; i < std::size(columns); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (columns[i] >= 0 && columns[i] == columns[j])
        return Error{fmt::format("column {} is named twice", columns[i]), "give every quantity its own", file,
                     0};
  return Done{};
}

}  // namespace

Result<ProbePath> read_path_csv(const std::string& file) {
  Result<LineReader> reader = LineReader::open(file);
  if (!reader) return std::move(reader).error();
  ProbePath path;
  path.name = file;
  const Status read =
      read_rows<kPathFields>(*reader, kPathHeader, [&](const std::array<double, kPathFields>& v) {
        if (Status time = check_time(*reader, path, v[0]); !time) return time;
        path.t_s.push_back(v[0]);
        path.hip_mm.emplace_back(v[1], v[2], v[3]);
        return Status(Done{});
      });
  if (!read) return read.error();
  return path;
}

Status write_path_csv(const ProbePath& path, const std::string& file) {
  fmt::memory_buffer text;
  fmt::format_to(std::back_inserter(text), "{}\n", kPathHeader);
  for (std::size_t i = 0; i < path.size(); ++i)
    fmt::format_to(std::back_inserter(text), "{},{},{},{}\n", path.t_s[i], path.hip_mm[i].x(),
                   path.hip_mm[i].y(), path.hip_mm[i].z());
  return write_file(file, {text.data(), text.size()});
}

Status write_trace_csv(const ProbePath& path, const ForceTrace& trace, const std::string& file) {
  const bool timed = !trace.frame_ns.empty();
  if (trace.frames.size() != path.size() || (timed && trace.frame_ns.size() != path.size()))
    return Error{fmt::format("the trace has {} frames and {} times for {} path rows", trace.frames.size(),
                             trace.frame_ns.size(), path.size()),
                 "write the trace beside the path it was made with", file, 0};
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "{}\n", kTraceHeader);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const Vec3& hip = path.hip_mm[i];
    const render::Frame& frame = trace.frames[i];
    const Vec3 &force = frame.force_n, &god = frame.god_object_mm;
    fmt::format_to(out, "{},{},{},{},{},{},{},{},{},{},{},{}\n", path.t_s[i], hip.x(), hip.y(), hip.z(),
                   force.x(), force.y(), force.z(), frame.contact ? 1 : 0, god.x(), god.y(), god.z(),
                   timed ? trace.frame_ns[i] : 0);
  }
  return write_file(file, {text.data(), text.size()});
}

Result<PathAndTrace> read_trace_csv(const std::string& file) {
  Result<LineReader> reader = LineReader::open(file);
  if (!reader) return std::move(reader).error();
  // Nanoseconds beyond this are no frame times, and doubles no longer count them exactly: 2^53.
  constexpr double kLargestNs = 9007199254740992.0;
  PathAndTrace both;
  both.path.name = file;
  const Status read =
      read_rows<kTraceFields>(*reader, kTraceHeader, [&](const std::array<double, kTraceFields>& v) {
        if (Status time = check_time(*reader, both.path, v[0]); !time) return time;
        if (v[7] != 0.0 && v[7] != 1.0)
          return Status(reader->error("contact is neither 0 nor 1", "write 0 or 1"));
        if (!(std::abs(v[11]) <= kLargestNs))
          return Status(reader->error("frame_ns is out of range", "write nanoseconds, 0 where not timed"));
        both.path.t_s.push_back(v[0]);
        both.path.hip_mm.emplace_back(v[1], v[2], v[3]);
        render::Frame frame;
        frame.force_n = {v[4], v[5], v[6]};
        frame.contact = v[7] == 1.0;
        frame.god_object_mm = {v[8], v[9], v[10]};
        frame.model = frame.contact ? 0 : -1;
        both.trace.frames.push_back(frame);
        both.trace.frame_ns.push_back(static_cast<std::int64_t>(v[11]));
        return Status(Done{});
      });
  if (!read) return read.error();
  return both;
}

Result<TrajRecording> read_traj(const std::string& file, const TrajColumns& columns) {
  if (Status good = check_columns(columns, file); !good) return good.error();
  Result<LineReader> reader = LineReader::open(file);
  if (!reader) return std::move(reader).error();
  const std::array<int, 7> places = {columns.t,  columns.x,  columns.y, columns.z,
                                     columns.fx, columns.fy, columns.fz};
  TrajRecording recording;
  ProbePath& path = recording.path;
  path.name = file;
  std::string_view line;
  while (reader->next(line)) {
    while (!line.empty() && separates(line.front())) line.remove_prefix(1);
    if (line.empty() || line.front() == '#' || line.front() == '%') continue;
    std::array<double, 7> v{};
    if (Status parsed = parse_traj_line(*reader, line, places, v); !parsed) return parsed.error();
    const double t_s = columns.t >= 0 ? v[0] * columns.s_per_unit
                                      : static_cast<double>(path.size()) / columns.sample_rate_hz;
    if (Status time = check_time(*reader, path, t_s); !time) return time.error();
    path.t_s.push_back(t_s);
    path.hip_mm.push_back(columns.mm_per_unit * Vec3(v[1], v[2], v[3]));
    if (columns.fx >= 0) recording.force_n.push_back(columns.n_per_unit * Vec3(v[4], v[5], v[6]));
  }
  if (reader->failure()) return *reader->failure();
  if (path.t_s.empty()) return reader->error("the file holds no line of numbers", "is this the right file?");
  return recording;
}

}  // namespace palpate::trace
