#include <palpate/trace.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <span>
#include <string_view>
#include <utility>

#include <palpate/options.h>
#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"
#include "toolkit/trace/csv_rows.h"
#include "toolkit/trace/timed_passes.h"

namespace palpate::trace {
namespace {

constexpr std::size_t kPathFields = 4;
constexpr std::size_t kTraceFields = 12;
constexpr std::size_t kReferenceFields = 17;
constexpr const char* kOtherColumns = ", or say where the numbers stand, as in FILE:t=0:x=1:y=2:z=3";

/// Most columns of a .traj line.
constexpr std::size_t kMaxColumns = 2048;

/// Reads the columns that `columns` names from a .traj line.
Status parse_traj_line(const LineReader& reader, CsvDialect& form, std::span<const std::string_view> fields,
                       std::span<const int> columns, std::span<double> values) {
  const char* const remedy = "check which columns hold what, counted from 0";
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (columns[i] < 0) continue;
    const auto column = static_cast<std::size_t>(columns[i]);
    if (column >= fields.size())
      return reader.error(fmt::format("the line has {} columns, too few", fields.size()), remedy);
    PALPATE_ASSIGN(values[i],
                   finite_number(reader, form, fields[column], fmt::format("column {}", column), remedy));
  }
  return Done{};
}

Status check_columns(const TrajColumns& c, const std::string& file) {
  const bool forces = c.fx >= 0 || c.fy >= 0 || c.fz >= 0;
  const bool all_forces = c.fx >= 0 && c.fy >= 0 && c.fz >= 0;
  if (c.x < 0 || c.y < 0 || c.z < 0 || (forces && !all_forces))
    return Error{"the columns of x, y, z (and, where there are forces, of all three) must be given",
                 "count columns from 0", file};
  if (c.t < 0 && !(c.sample_rate_hz > 0.0 && std::isfinite(c.sample_rate_hz)))
    return Error{"there is neither a time column nor a sample rate", "give one of them", file};
  const int columns[] = {c.t, c.x, c.y, c.z, c.fx, c.fy, c.fz};
  for (std::size_t i = 0; i < std::size(columns); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (columns[i] >= 0 && columns[i] == columns[j])
        return Error{fmt::format("column {} is named twice", columns[i]), "give every quantity its own",
                     file};
  return Done{};
}

/// True if the first line has the second reference's column.
Result<bool> is_compared(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(LineReader reader, LineReader::open(file, max_bytes));
  std::string_view line;
  if (!reader.next(line) && reader.failure()) return *reader.failure();
  return line == kComparedReferenceHeader;
}

}  // namespace

Result<ProbePath> read_path_csv(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(LineReader reader, LineReader::open(file, max_bytes));
  ProbePath path;
  path.name = file;
  const Status read = read_rows(reader, kPathHeader, kOtherColumns, [&](std::span<const double> v) -> Status {
    PALPATE_TRY(check_time(reader, path, v[0]));
    PALPATE_TRY(reader.fits(path, kPathFields * sizeof(double)));
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
                 "write the trace beside the path it was made with", file};
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

namespace {

/// A row's time, HIP, force, contact and god object, of which a row has `fields` in all.
Status read_frame_row(const LineReader& reader, std::size_t fields, std::span<const double> v,
                      ProbePath& path, render::Frame& frame) {
  PALPATE_TRY(check_time(reader, path, v[0]));
  PALPATE_TRY(reader.fits(path, fields * sizeof(double)));
  if (v[7] != 0.0 && v[7] != 1.0) return reader.error("contact is neither 0 nor 1", "write 0 or 1");
  path.t_s.push_back(v[0]);
  path.hip_mm.emplace_back(v[1], v[2], v[3]);
  frame.force_n = {v[4], v[5], v[6]};
  frame.contact = v[7] == 1.0;
  frame.god_object_mm = {v[8], v[9], v[10]};
  frame.model = frame.contact ? 0 : -1;
  return Done{};
}

}  // namespace

Result<PathAndTrace> read_trace_csv(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(LineReader reader, LineReader::open(file, max_bytes));
  // Larger values are no frame times, and doubles no longer count them exactly: 2^53.
  constexpr double kLargestNs = 9007199254740992.0;
  PathAndTrace both;
  both.path.name = file;
  const Status read = read_rows(reader, kTraceHeader, "", [&](std::span<const double> v) -> Status {
    render::Frame& frame = both.trace.frames.emplace_back();
    PALPATE_TRY(read_frame_row(reader, kTraceFields, v, both.path, frame));
    if (!(std::abs(v[11]) <= kLargestNs))
      return Status(reader.error("frame_ns is out of range", "write nanoseconds, 0 where not timed"));
    both.trace.frame_ns.push_back(static_cast<std::int64_t>(v[11]));
    return Status(Done{});
  });
  if (!read) return read.error();
  return both;
}

Status write_reference_csv(const ProbePath& path, const ReferenceTrace& reference, const std::string& file) {
  if (reference.frames.size() != path.size())
    return Error{
        fmt::format("the truth has {} frames for {} path rows", reference.frames.size(), path.size()),
        "write the truth beside the path it was made for", file};
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "{}\n", reference.compared ? kComparedReferenceHeader : kReferenceHeader);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const TruthFrame& truth = reference.frames[i];
    const Vec3 &hip = path.hip_mm[i], &force = truth.frame.force_n, &god = truth.frame.god_object_mm,
               &normal = truth.normal;
    fmt::format_to(out, "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", path.t_s[i], hip.x(), hip.y(),
                   hip.z(), force.x(), force.y(), force.z(), truth.frame.contact ? 1 : 0, god.x(), god.y(),
                   god.z(), normal.x(), normal.y(), normal.z(), truth.signed_distance_mm,
                   truth.local_resolution_mm);
    if (reference.compared) fmt::format_to(out, ",{}", truth.history_decides ? 1 : 0);
    text.push_back('\n');
  }
  return write_file(file, {text.data(), text.size()});
}

Result<PathAndReference> read_reference_csv(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(const bool compared, is_compared(file, max_bytes));
  PALPATE_ASSIGN(LineReader reader, LineReader::open(file, max_bytes));
  PathAndReference both;
  both.reference.compared = compared;
  const char* const header = compared ? kComparedReferenceHeader : kReferenceHeader;
  both.path.name = file;
  const Status read = read_rows(reader, header, "", [&](std::span<const double> v) -> Status {
    TruthFrame& truth = both.reference.frames.emplace_back();
    PALPATE_TRY(read_frame_row(reader, kReferenceFields, v, both.path, truth.frame));
    if (compared && v[16] != 0.0 && v[16] != 1.0)
      return Status(reader.error("history is neither 0 nor 1", "write 0 or 1"));
    truth.normal = {v[11], v[12], v[13]};
    truth.signed_distance_mm = v[14];
    truth.local_resolution_mm = v[15];
    truth.history_decides = compared && v[16] == 1.0;
    return Status(Done{});
  });
  if (!read) return read.error();
  return both;
}

Result<TrajRecording> read_traj(const std::string& file, const TrajColumns& columns,
                                std::uint64_t max_bytes) {
  PALPATE_TRY(check_columns(columns, file));
  PALPATE_ASSIGN(LineReader reader, LineReader::open(file, max_bytes));
  const std::array<int, 7> places = {columns.t,  columns.x,  columns.y, columns.z,
                                     columns.fx, columns.fy, columns.fz};
  TrajRecording recording;
  ProbePath& path = recording.path;
  path.name = file;
  std::string_view line;
  std::vector<std::string_view> fields(kMaxColumns);
  std::optional<CsvDialect> form;
  std::size_t names = 0;
  const auto cut = [&](const CsvDialect& by) {
    const std::size_t count = by.split(line, fields);
    for (std::size_t i = 0; i < count; ++i) fields[i] = trimmed(fields[i]);
    return std::span<const std::string_view>(fields).first(count);
  };
  while (reader.next(line)) {
    line = trimmed(line);
    if (line.empty() || line.front() == '#' || line.front() == '%') continue;
    if (!form) {
      if (const auto words = cut(CsvDialect::of_header(line)); names == 0 && is_header_row(words)) {
        names = words.size();
        continue;
      }
      PALPATE_ASSIGN(form, form_of(reader, line));
      if (const std::string readings = comma_readings(line);
          form->separator() == ',' && !readings.empty() && cut(*form).size() == 2 * names)
        return reader.error(fmt::format("twice as many columns as names: {}", readings),
                            "separate columns by semicolons, or write decimal points");
    }
    std::array<double, 7> v{};
    PALPATE_TRY(parse_traj_line(reader, *form, cut(*form), places, v));
    const double t_s = columns.t >= 0 ? v[0] * columns.s_per_unit
                                      : static_cast<double>(path.size()) / columns.sample_rate_hz;
    PALPATE_TRY(check_time(reader, path, t_s));
    PALPATE_TRY(reader.fits(path, (kPathFields + 3) * sizeof(double)));
    path.t_s.push_back(t_s);
    path.hip_mm.push_back(columns.mm_per_unit * Vec3(v[1], v[2], v[3]));
    if (columns.fx >= 0) recording.force_n.push_back(columns.n_per_unit * Vec3(v[4], v[5], v[6]));
  }
  if (reader.failure()) return *reader.failure();
  if (path.t_s.empty()) return reader.error("the file holds no line of numbers", "is this the right file?");
  return recording;
}

std::string trace_hash(const ForceTrace& trace) {
  FrameHash hash;
  for (const render::Frame& frame : trace.frames) hash.add(frame);
  return hash.hex();
}

std::string path_hash(const ProbePath& path) {
  Hash64 hash;
  for (std::size_t i = 0; i < path.size(); ++i) {
    hash.real(path.t_s[i]);
    for (int axis = 0; axis < 3; ++axis) hash.real(path.hip_mm[i][axis]);
  }
  return hash.hex();
}

}  // namespace palpate::trace
