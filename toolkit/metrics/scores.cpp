#include "toolkit/metrics/scores.h"

#include <fmt/format.h>

#include <iterator>

#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/trace/csv_rows.h"

namespace palpate::metrics {
namespace {

/// The column groups of a file.
struct Columns {
  bool forces = false, surface = false, events = false, friction = false;

  [[nodiscard]] std::string header() const {
    return std::string("t_s,missed,false") +
           (forces ? ",force_error_n,excess_jump_n,god_object_error_mm" : "") +
           (surface ? ",god_object_distance_mm" : "") + (friction ? ",friction_ratio" : "") +
           (events ? ",pop_throughs" : "");
  }
};

/// All possible combinations: events and friction only with a surface. The last has everything.
constexpr Columns kPossible[] = {{false, false, false, false}, {true, false, false, false},
                                 {false, true, false, false},  {true, true, false, false},
                                 {false, true, true, false},   {false, true, false, true},
                                 {true, true, false, true},    {false, true, true, true},
                                 {true, true, true, false},    {true, true, true, true}};

Columns columns_of(const AccuracyFrames& frames) {
  return {!frames.force_error_n.empty(), frames.surface.has_value(),
          frames.surface && !frames.surface->pop_throughs.empty(),
          frames.surface && !frames.surface->friction_ratio.empty()};
}

/// The columns of the file's first line; all of them if it names none, for the message.
Result<Columns> columns_in(const std::string& file, std::uint64_t max_bytes) {
  PALPATE_ASSIGN(trace::LineReader reader, trace::LineReader::open(file, max_bytes));
  std::string_view line;
  if (!reader.next(line) && reader.failure()) return *reader.failure();
  for (const Columns& columns : kPossible)
    if (line == columns.header()) return columns;
  return kPossible[std::size(kPossible) - 2];  // without friction, which is rare
}

bool is_flag(double value) {
  return value == 0.0 || value == 1.0;
}

/// Two events may fall on one frame.
bool is_count(double value) {
  return is_flag(value) || value == 2.0;
}

void take_row(const Columns& columns, std::span<const double> v, AccuracyFrames& frames) {
  std::size_t next = 1;
  frames.missed_contact.push_back(static_cast<std::uint8_t>(v[next++]));
  frames.false_contact.push_back(static_cast<std::uint8_t>(v[next++]));
  if (columns.forces) {
    frames.force_error_n.push_back(static_cast<float>(v[next++]));
    frames.excess_jump_n.push_back(static_cast<float>(v[next++]));
    frames.god_object_error_mm.push_back(static_cast<float>(v[next++]));
  }
  if (columns.surface) frames.surface->god_object_distance_mm.push_back(v[next++]);
  if (columns.friction) frames.surface->friction_ratio.push_back(v[next++]);
  if (columns.events) frames.surface->pop_throughs.push_back(static_cast<std::uint8_t>(v[next++]));
}

}  // namespace

Status write_scores_csv(const trace::ProbePath& path, const AccuracyFrames& frames, const std::string& file) {
  const Columns columns = columns_of(frames);
  const std::size_t n = path.size();
  const auto fits = [n](const auto& column) { return column.size() == n; };
  if (!fits(frames.missed_contact) || !fits(frames.false_contact) ||
      (columns.forces &&
       !(fits(frames.force_error_n) && fits(frames.excess_jump_n) && fits(frames.god_object_error_mm))) ||
      (columns.surface && !fits(frames.surface->god_object_distance_mm)) ||
      (columns.friction && !fits(frames.surface->friction_ratio)) ||
      (columns.events && !fits(frames.surface->pop_throughs)))
    return Error{fmt::format("the scores are not of the {} rows of the path", n),
                 "write scores beside the path they were made with", file};
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "{}\n", columns.header());
  for (std::size_t i = 0; i < n; ++i) {
    fmt::format_to(out, "{},{},{}", path.t_s[i], frames.missed_contact[i], frames.false_contact[i]);
    if (columns.forces)
      fmt::format_to(out, ",{},{},{}", frames.force_error_n[i], frames.excess_jump_n[i],
                     frames.god_object_error_mm[i]);
    if (columns.surface) fmt::format_to(out, ",{}", frames.surface->god_object_distance_mm[i]);
    if (columns.friction) fmt::format_to(out, ",{}", frames.surface->friction_ratio[i]);
    if (columns.events) fmt::format_to(out, ",{}", frames.surface->pop_throughs[i]);
    text.push_back('\n');
  }
  return write_file(file, {text.data(), text.size()});
}

Result<AccuracyFrames> read_scores_csv(const trace::ProbePath& path, const std::string& file,
                                       std::uint64_t max_bytes) {
  PALPATE_ASSIGN(const Columns columns, columns_in(file, max_bytes));
  PALPATE_ASSIGN(trace::LineReader reader, trace::LineReader::open(file, max_bytes));
  AccuracyFrames frames;
  if (columns.surface) frames.surface.emplace();
  std::size_t row = 0;
  const Status read =
      trace::read_rows(reader, columns.header(), "", [&](std::span<const double> v) -> Status {
        if (row >= path.size() || v[0] != path.t_s[row])
          return reader.error("the row is of another time than the path's", "score the study again");
        ++row;
        if (!is_flag(v[1]) || !is_flag(v[2]))
          return reader.error("missed or false is neither 0 nor 1", "write 0 or 1");
        if (columns.events && !is_count(v.back()))
          return reader.error("pop_throughs is none of 0, 1, 2", "write 0 where there is no event");
        take_row(columns, v, frames);
        return Done{};
      });
  if (!read) return read.error();
  if (row != path.size())
    return reader.error(fmt::format("{} rows for {} rows of the path", row, path.size()),
                        "score the study again");
  return frames;
}

}  // namespace palpate::metrics
