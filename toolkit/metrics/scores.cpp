#include "toolkit/metrics/scores.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/trace/csv_rows.h"

namespace palpate::metrics {

// ---- moments that feel plainly wrong (caught, lost, kicked), counted over all frames, and pop-throughs

namespace {

/// The local resolution is the distance to the eighth neighbour, about 1.5 spacings.
constexpr double kSpacingsPerResolution = kCaughtSpacings / 1.5;
/// A kick: a step of force larger by this than any true step within kMinArtefactS before or after.
constexpr double kKickN = 0.5;

/// Stretches of at least kMinArtefactS in which `wrong` holds.
template <class Wrong>
Moments stretches(const ScoreInput& in, const Wrong& wrong) {
  Moments out;
  double longest_s = 0.0;
  const std::size_t n = in.frames.size();
  for (std::size_t begin = 0; begin < n;) {
    if (!wrong(begin)) {
      ++begin;
      continue;
    }
    std::size_t end = begin + 1;
    while (end < n && wrong(end)) ++end;
    const double lasts_s = in.path.t_s[end - 1] - in.path.t_s[begin];
    if (lasts_s >= kMinArtefactS) {
      ++out.episodes;
      out.frames += end - begin;
      if (lasts_s > longest_s) out.longest_at = begin;
      longest_s = std::max(longest_s, lasts_s);
    }
    begin = end;
  }
  return out;
}

void count_kicks(const ScoreInput& in, ContactArtefacts& out) {
  std::size_t first = 1, last = 0;  // of the true steps within kMinArtefactS
  double quiet_until_s = -HUGE_VAL;
  const std::vector<double>& t = in.path.t_s;
  for (std::size_t i = 1; i < in.frames.size(); ++i) {
    const double step = (in.rendered(i) - in.rendered(i - 1)).norm();
    const bool counts = step > kKickN && t[i] >= quiet_until_s;
    if (!counts && !(step > out.kick_max_n)) continue;
    while (t[first] < t[i] - kMinArtefactS) ++first;
    last = std::max(last, i);
    while (last + 1 < t.size() && t[last + 1] <= t[i] + kMinArtefactS) ++last;
    double most = 0.0;
    for (std::size_t k = first; k <= last; ++k)
      most = std::max(most, (in.wanted(k) - in.wanted(k - 1)).norm());
    if (step - most > out.kick_max_n) {
      out.kick_max_n = step - most;
      out.kick_max_at = i;
    }
    if (!counts || !(step - most > kKickN)) continue;
    ++out.kicks;
    quiet_until_s = t[i] + kMinArtefactS;  // the way back is the same kick
  }
}

}  // namespace

ContactArtefacts find_artefacts(const trace::ProbePath& path, const std::vector<render::Frame>& frames,
                                const std::vector<trace::TruthFrame>& truth, double lost_mm) {
  const AccuracyOptions unread;
  const ScoreInput in{path, frames, truth, unread};
  ContactArtefacts out;
  out.caught = stretches(in, [&](std::size_t i) {
    if (!felt(in.rendered(i))) return false;
    const double most = std::max(kCaughtMm, kSpacingsPerResolution * in.truth[i].local_resolution_mm);
    return (in.frames[i].god_object_mm - in.truth[i].frame.god_object_mm).norm() > most;
  });
  out.lost = stretches(in, [&](std::size_t i) {
    return felt(in.wanted(i)) && !felt(in.rendered(i)) && in.truth[i].signed_distance_mm < -lost_mm;
  });
  count_kicks(in, out);
  return out;
}

void score_artefacts(const ScoreInput& in, Accuracy& a) {
  const ContactArtefacts wrong = find_artefacts(in.path, in.frames, in.truth);
  a.caught = wrong.caught.episodes;
  a.caught_frames = wrong.caught.frames;
  a.lost = wrong.lost.episodes;
  a.lost_frames = wrong.lost.frames;
  a.kicks = wrong.kicks;
  double felt_most = 0.0, true_most = 0.0;
  for (std::size_t i = 0; i < in.frames.size(); ++i) {
    felt_most = std::max(felt_most, in.rendered(i).norm());
    true_most = std::max(true_most, in.wanted(i).norm());
  }
  a.force_peak_n = felt_most;
  if (true_most > 0.0)
    a.force_peak_excess_percent = std::max(0.0, kToPercent * (felt_most / true_most - 1.0));
}

namespace {

// Most samples along a god-object step. They are half a local resolution apart, so that no deeper matter is
// skipped; longer steps are sampled more coarsely, and cross large matter.
constexpr int kMaxSamples = 64;
// Some hundred coordinate roundings: the error of a distance to a formula or mesh.
constexpr double kRoundingPerSize = 256.0 * kUnitRoundoff;

bool leads_through_matter(const Vec3& from_mm, const Vec3& to_mm, double resolution_mm,
                          const TruthSurface& truth) {
  const double length_mm = (to_mm - from_mm).norm();
  // A chord of length L is at most L / 2 deep.
  if (!(length_mm > 2.0 * resolution_mm)) return false;
  const double wanted = std::ceil(2.0 * length_mm / resolution_mm);  // resolution > 0 here
  const int samples = static_cast<int>(std::min(wanted, static_cast<double>(kMaxSamples)));
  for (int s = 1; s < samples; ++s) {
    const double t = static_cast<double>(s) / samples;
    if (truth.signed_distance_mm(from_mm + t * (to_mm - from_mm)) < -resolution_mm) return true;
  }
  return false;
}

}  // namespace

std::vector<std::uint8_t> find_pop_throughs(const trace::ProbePath& path, const trace::ForceTrace& trace,
                                            const trace::ReferenceTrace& reference,
                                            const TruthSurface& truth) {
  std::vector<std::uint8_t> events(trace.frames.size());
  bool was_inside = false, away_counted = false;
  double away_travel_mm = -1.0;  // HIP travel since g faces away; negative if it does not
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    const render::Frame& frame = trace.frames[i];
    const trace::TruthFrame& wanted = reference.frames[i];
    const double resolution_mm =
        wanted.local_resolution_mm + kRoundingPerSize * frame.god_object_mm.cwiseAbs().maxCoeff();
    const bool inside = frame.contact && truth.signed_distance_mm(frame.god_object_mm) < -resolution_mm;
    const bool through =
        i > 0 && frame.contact && trace.frames[i - 1].contact && !inside && !was_inside &&
        leads_through_matter(trace.frames[i - 1].god_object_mm, frame.god_object_mm, resolution_mm, truth) &&
        // A fast hand may take the true god object around a bump in a step, whose chord is not its way.
        !leads_through_matter(reference.frames[i - 1].frame.god_object_mm, wanted.frame.god_object_mm,
                              resolution_mm, truth);
    const bool away = frame.contact && wanted.frame.contact && !inside &&
                      truth.closest(frame.god_object_mm).normal.dot(wanted.normal) < 0.0;
    if ((inside && !was_inside) || through) ++events[i];
    if (!away) {
      away_travel_mm = -1.0;
      away_counted = false;
    } else {
      away_travel_mm =
          away_travel_mm < 0.0 ? 0.0 : away_travel_mm + (path.hip_mm[i] - path.hip_mm[i - 1]).norm();
      if (through || was_inside) away_counted = true;  // already counted
      if (!away_counted && away_travel_mm > resolution_mm) {
        away_counted = true;
        ++events[i];
      }
    }
    was_inside = inside;
  }
  return events;
}

// ---- streams of depth images

namespace {

constexpr double kStreamMsPerS = 1e3;

void raise(std::optional<double>& most, double value) {
  most = std::max(most.value_or(0.0), value);
}

}  // namespace

StreamScores score_stream(const trace::ProbePath& path, const trace::ForceTrace& trace,
                          std::span<const StreamDelivery> deliveries, double stiffness_n_per_mm) {
  using stream::FrameFate;
  StreamScores scores;
  std::vector<double> window, whole, light, steps;
  std::size_t next = 0;
  for (std::size_t i = 0; i < path.size(); ++i) {
    bool swapped = false;
    for (; next < deliveries.size() && deliveries[next].due_s <= path.t_s[i]; ++next) {
      const StreamDelivery& one = deliveries[next];
      ++scores.frames;
      scores.repeated += one.report.fate == FrameFate::kRepeated ? 1u : 0u;
      scores.late += one.report.fate == FrameFate::kLate ? 1u : 0u;
      scores.truncated += one.report.fate == FrameFate::kTruncated ? 1u : 0u;
      scores.failed += one.report.fate == FrameFate::kFailed ? 1u : 0u;
      if (one.report.fate != FrameFate::kTaken) continue;
      ++scores.taken;
      swapped = true;
      window.push_back(one.report.window_ms);
      whole.push_back(one.report.whole_ms);
      light.push_back((path.t_s[i] - one.captured_s) * kStreamMsPerS);
    }
    if (swapped && scores.swaps_s.size() < kMostSwapTimes) scores.swaps_s.push_back(path.t_s[i]);
    if (i == 0 || (!trace.frames[i].contact && !trace.frames[i - 1].contact)) continue;
    scores.releases += trace.frames[i].contact ? 0u : 1u;
    const double excess_n =
        std::max(0.0, (trace.frames[i].force_n - trace.frames[i - 1].force_n).norm() -
                          stiffness_n_per_mm * (path.hip_mm[i] - path.hip_mm[i - 1]).norm());
    raise(scores.rate_max_n_per_ms, excess_n / ((path.t_s[i] - path.t_s[i - 1]) * kStreamMsPerS));
    if (!swapped) continue;
    ++scores.swaps_in_contact;
    steps.push_back(excess_n);
  }
  median_and_tail(std::move(window), scores.window_p50_ms, scores.window_p99_ms);
  median_and_tail(std::move(whole), scores.whole_p50_ms, scores.whole_p99_ms);
  median_and_tail(std::move(light), scores.light_to_tick_p50_ms, scores.light_to_tick_p99_ms);
  if (!steps.empty()) {
    scores.swap_step_max_n = *std::max_element(steps.begin(), steps.end());
    std::optional<double> median;
    median_and_tail(std::move(steps), median, scores.swap_step_p99_n);
  }
  return scores;
}

// ---- CSV

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
