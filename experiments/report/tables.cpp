#include "experiments/report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace palpate::experiments {
namespace {

using Result_ = metrics::RendererResult;
using Value = std::optional<double>;
using Get = std::function<Value(const Result_&)>;
enum class Better { kLower, kHigher, kNeither };

/// How a row's numbers are written.
enum class Show { kNumbers, kCounts, kTimes };

constexpr double kNsPerUs = 1e3, kPercent = 100.0;
constexpr double kDegPerRad = 57.295779513082320877;  // 180 / pi

/// Which of `values` is the best of a row; nothing where nobody is.
std::optional<std::size_t> best_of(const std::vector<Value>& values, const metrics::ResultDocument& document,
                                   Better better) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; better != Better::kNeither && i < values.size(); ++i) {
    if (!values[i] || !competes(document.renderers[i])) continue;
    if (!best || (better == Better::kLower ? *values[i] < *values[*best] : *values[i] > *values[*best]))
      best = i;
  }
  return best;
}

/// Rows of a name and a value of every renderer.
class Scores {
 public:
  Scores(Table& table, const metrics::ResultDocument& document) : table_(table), document_(document) {}

  void heading(std::string text) { table_.rows.push_back({{std::move(text), false, false}}); }

  /// `rounding`: of each renderer's value, what rounding alone makes; empty: none.
  void add(std::string name, const Get& get, Better better, Show show, const Get& rounding = {}) {
    std::vector<Value> values;
    for (const Result_& r : document_.renderers) {
      Value value = get(r);
      if (value && !std::isfinite(*value)) value.reset();
      if (value && rounding) {
        const double least = rounding(r).value_or(0.0);
        settled_any_ = settled_any_ || (*value != 0.0 && settled(*value, least) == 0.0);
        value = settled(*value, least);
      }
      values.push_back(value);
    }
    if (std::none_of(values.begin(), values.end(), [](const Value& v) { return v.has_value(); })) return;
    std::vector<std::string> texts;
    if (show == Show::kTimes) {
      AlignedTimes times = aligned_times(values);
      name += ", " + times.unit;
      texts = std::move(times.texts);
    } else if (show == Show::kNumbers) {
      texts = aligned_numbers(values);
    } else {
      for (const Value& v : values)
        texts.push_back(v ? count_text(static_cast<std::uint64_t>(*v)) : kNoNumber);
    }
    // What reads the same is as good; where all are, nobody is marked.
    const std::optional<std::size_t> best = best_of(values, document_, better);
    const auto is_best = [&](std::size_t i) {
      return best && values[i] && competes(document_.renderers[i]) && texts[i] == texts[*best];
    };
    std::size_t rivals = 0, equal = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      rivals += values[i] && competes(document_.renderers[i]) ? 1u : 0u;
      equal += is_best(i) ? 1u : 0u;
    }
    std::vector<Cell> row = {{std::move(name), false, false}};
    for (std::size_t i = 0; i < values.size(); ++i)
      row.push_back({texts[i], equal < rivals && is_best(i), false});
    table_.rows.push_back(std::move(row));
  }
  void lower(std::string name, const Get& get, const Get& rounding = {}) {
    add(std::move(name), get, Better::kLower, Show::kNumbers, rounding);
  }
  void fewer(std::string name, const Get& get) { add(std::move(name), get, Better::kLower, Show::kCounts); }
  /// Something was more than 0 and no more than rounding.
  [[nodiscard]] bool settled_any() const { return settled_any_; }

 private:
  Table& table_;
  const metrics::ResultDocument& document_;
  bool settled_any_ = false;
};

Get frame(Value trace::FrameStatistics::*member) {
  return [member](const Result_& r) { return r.frame ? (*r.frame).*member : std::nullopt; };
}
Get frame_count(std::uint64_t trace::FrameStatistics::*member) {
  return [member](const Result_& r) -> Value {
    if (!r.frame) return std::nullopt;
    return static_cast<double>((*r.frame).*member);
  };
}
Get accuracy(Value metrics::Accuracy::*member) {
  return [member](const Result_& r) { return r.accuracy ? (*r.accuracy).*member : std::nullopt; };
}
template <class Count>  // std::uint64_t, or an optional one
Get accuracy_count(Count metrics::Accuracy::*member) {
  return [member](const Result_& r) -> Value {
    const std::optional<std::uint64_t> n =
        r.accuracy ? (*r.accuracy).*member : std::optional<std::uint64_t>();
    return n ? Value(static_cast<double>(*n)) : std::nullopt;
  };
}

Value rounding_energy_percent(const Result_& r) {
  if (!r.energy || !(r.energy->max_stored_mj > 0.0)) return std::nullopt;
  return kPercent * r.energy->rounding_mj / r.energy->max_stored_mj;
}

void add_costs(Scores& t, const metrics::ResultDocument& d) {
  using F = trace::FrameStatistics;
  t.heading("Preparation");
  t.add(
      "preparation", [](const Result_& r) { return r.prepare ? Value(r.prepare->total_ms) : std::nullopt; },
      Better::kLower, Show::kTimes);
  t.lower("memory, bytes a point", [](const Result_& r) -> Value {
    if (!r.prepare || !r.model || r.model->points == 0) return std::nullopt;
    return static_cast<double>(r.prepare->bytes) / static_cast<double>(r.model->points);
  });
  t.heading("Frames");
  const std::string all = frames_text(d);
  t.add("frames in contact" + (all.empty() ? "" : ", " + all), frame_count(&F::contact_frames),
        Better::kNeither, Show::kCounts);
  if (all.empty()) t.add("frames in all", frame_count(&F::frames), Better::kNeither, Show::kCounts);
  t.lower("mean without the clock, µs", frame(&F::mean_us));
  t.fewer("frames at the work bound", frame_count(&F::bound_hits));
  t.lower("paced at 1 kHz, median, µs",
          [](const Result_& r) { return r.paced ? r.paced->frame.p50_us : std::nullopt; });
  t.lower("paced, caches evicted, median, µs",
          [](const Result_& r) { return r.paced_evicted ? r.paced_evicted->frame.p50_us : std::nullopt; });
  t.heading("Frames one by one, the clock in each");
  t.lower("mean, µs", frame(&F::mean_clocked_us));
  t.lower("median, µs", frame(&F::p50_us));
  t.lower("99 %, µs", frame(&F::p99_us));
  t.lower("99.9 %, µs", frame(&F::p999_us));
  t.lower("longest, µs", frame(&F::max_us));
  t.fewer("missed 1 ms deadlines", frame_count(&F::deadline_misses_1khz));
  t.add(
      "of it the clock, µs",
      [](const Result_& r) { return r.frame ? Value(r.frame->clock_overhead_ns / kNsPerUs) : std::nullopt; },
      Better::kNeither, Show::kNumbers);
}

void add_scores(Scores& t) {
  using A = metrics::Accuracy;
  const auto lower = [&](const char* name, Value A::*score) {
    t.lower(name, accuracy(score), [score](const Result_& r) { return Value(rounding_of(r, score)); });
  };
  t.heading("Force against the ground truth");
  lower("force error, RMS, N", &A::force_rms_n);
  lower("force error, RMS, %", &A::force_rms_percent);
  lower("force error, largest, N", &A::force_max_n);
  t.add("frames within 7 % of the force, %", accuracy(&A::within_7_percent), Better::kHigher, Show::kNumbers);
  lower("force direction, 99 %, degrees", &A::direction_p99_deg);
  lower("largest excess jump, N", &A::excess_jump_max_n);
  t.fewer("excess jumps", accuracy_count(&A::excess_jumps));
  t.heading("Contact against the ground truth");
  t.fewer("missed contact, frames", accuracy_count(&A::missed_contact_frames));
  t.fewer("false contact, frames", accuracy_count(&A::false_contact_frames));
  t.fewer("longest stick, frames", accuracy_count(&A::longest_stick_frames));
  t.fewer("pop-throughs", accuracy_count(&A::pop_throughs));
  lower("onset error, mm", &A::onset_error_mm);
  lower("release error, mm", &A::release_error_mm);
  t.heading("God object and energy");
  lower("god object error, RMS, mm", &A::god_object_rms_mm);
  lower("god object error, largest, mm", &A::god_object_max_mm);
  t.lower(
      "energy generated, %",
      [](const Result_& r) { return r.energy ? r.energy->generated_percent : std::nullopt; },
      rounding_energy_percent);
}

/// "0: no more than rounding, up to 1.5×10⁻⁶ N here".
std::string zero_note(const metrics::ResultDocument& document) {
  double n = 0.0, mm = 0.0;
  for (const Result_& r : document.renderers) {
    if (!r.accuracy) continue;
    n = std::max(n, r.accuracy->rounding_n);
    mm = std::max(mm, r.accuracy->rounding_mm);
  }
  return "0 also where it is no more than the rounding of stored points and arithmetic" +
         (mm > 0.0 ? fmt::format(": {} mm, {} N.", short_number(mm), short_number(n)) : ".");
}

}  // namespace

const std::vector<std::string>& contact_words() {
  static const std::vector<std::string> kWords = {
      "Missed: a frame without force though the HIP is deeper inside than one local resolution (the distance "
      "to the eighth neighbour there).",
      "False: a frame with a force though the HIP is farther outside than one local resolution.",
      "Stick: the longest unbroken run of false frames, the hand held by a surface that it has left."};
  return kWords;
}

bool competes(const metrics::RendererResult& result) {
  return result.role != render::Role::kReference && result.role != render::Role::kOracle;
}

double rounding_of(const metrics::RendererResult& r, std::optional<double> metrics::Accuracy::*score) {
  using A = metrics::Accuracy;
  if (!r.accuracy) return 0.0;
  const A& a = *r.accuracy;
  const auto is_one_of = [&](std::initializer_list<Value A::*> scores) {
    return std::find(scores.begin(), scores.end(), score) != scores.end();
  };
  if (is_one_of({&A::force_rms_n, &A::force_normal_rms_n, &A::force_tangential_rms_n, &A::force_max_n}))
    return a.rounding_n;
  // The difference of two forces may be wrong by the rounding of both.
  if (is_one_of({&A::excess_jump_max_n, &A::path_dependence_n})) return 2.0 * a.rounding_n;
  // A share of the true force, by the ratio of the two scores.
  if (score == &A::force_rms_percent)
    return a.force_rms_n.value_or(0.0) > 0.0
               ? a.rounding_n * (a.force_rms_percent.value_or(0.0) / *a.force_rms_n)
               : 0.0;
  // Directions are compared of forces that are at least the floor.
  if (is_one_of({&A::direction_mean_deg, &A::direction_p99_deg, &A::direction_max_deg}))
    return a.floor_n > 0.0 ? kDegPerRad * a.rounding_n / a.floor_n : 0.0;
  if (is_one_of({&A::god_object_rms_mm, &A::god_object_max_mm, &A::god_object_surface_rms_mm,
                 &A::god_object_surface_max_mm, &A::onset_error_mm, &A::release_error_mm}))
    return a.rounding_mm;
  return 0.0;
}

std::optional<double> settled_score(const metrics::RendererResult& r,
                                    std::optional<double> metrics::Accuracy::*score) {
  if (!r.accuracy || !((*r.accuracy).*score)) return std::nullopt;
  return settled(*((*r.accuracy).*score), rounding_of(r, score));
}

std::string frames_text(const metrics::ResultDocument& document) {
  std::optional<std::uint64_t> frames;
  for (const Result_& r : document.renderers) {
    if (!r.frame) continue;
    if (frames && *frames != r.frame->frames) return {};
    frames = r.frame->frames;
  }
  return frames ? "of " + count_text(*frames) : "";
}

std::vector<Table> turned(const Table& table) {
  std::vector<Table> groups;
  for (const auto& row : table.rows) {
    const bool heading = row.size() == 1;
    // A lone row before the first heading (the status) goes with what follows.
    if (heading && groups.size() == 1 && groups[0].title.empty() && groups[0].columns.size() == 2) {
      groups[0].title = row[0].text;
    } else if (heading || groups.empty()) {
      Table& group = groups.emplace_back();
      group.title = heading ? row[0].text : "";
      group.columns = {table.columns.empty() || table.columns[0].empty() ? "" : table.columns[0]};
      for (std::size_t i = 1; i < table.columns.size(); ++i)
        group.rows.push_back({{table.columns[i], false, false}});
    }
    if (heading) continue;
    groups.back().columns.push_back(row[0].text);
    for (std::size_t i = 1; i < row.size(); ++i) groups.back().rows[i - 1].push_back(row[i]);
  }
  return groups;
}

Table part_of(const Table& table, std::size_t begin, std::size_t end) {
  const auto some = [&](const auto& row) {
    auto part = row;
    part.erase(part.begin() + static_cast<std::ptrdiff_t>(end), part.end());
    part.erase(part.begin() + 1, part.begin() + static_cast<std::ptrdiff_t>(begin));
    return part;
  };
  Table part;
  part.columns = some(table.columns);
  for (const auto& row : table.rows) part.rows.push_back(row.size() == 1 ? row : some(row));
  return part;
}

std::vector<std::string> legend_of(const Table& table, bool is_turned) {
  bool best = false, bad = false, none = false;
  for (const auto& row : table.rows)
    for (std::size_t i = 1; i < row.size(); ++i) {
      best = best || row[i].best;
      bad = bad || (row[i].bad && row[i].text != kNoNumber);
      none = none || row[i].text == kNoNumber;
    }
  std::vector<std::string> lines;
  if (best)
    lines.push_back("* " + (!table.best_means.empty() ? table.best_means
                            : is_turned               ? std::string("the best of its column")
                                                      : std::string("the best of its row")));
  if (bad) lines.push_back("! " + (table.bad_means.empty() ? "falls short" : table.bad_means));
  if (none)
    lines.push_back(std::string(kNoNumber) + " no value: not measured, or nothing to compare it with");
  return lines;
}

Table comparison_table(const metrics::ResultDocument& document) {
  Table table;
  table.title = "All scores";
  table.turns = true;
  table.bad_means = "did not run to its end";
  table.columns = {""};
  std::vector<std::string> reasons;
  std::vector<Cell> status = {{"status", false, false}};
  std::string outside;
  for (const Result_& r : document.renderers) {
    table.columns.push_back(r.label);
    if (!competes(r)) outside += (outside.empty() ? "" : ", ") + r.label;
    const bool ok = r.status == metrics::RunStatus::kOk;
    status.push_back({ok                                        ? "ok"
                      : r.status == metrics::RunStatus::kFailed ? "failed"
                                                                : "did not finish",
                      false, !ok});
    if (!ok) reasons.push_back(r.label + ": " + r.reason);
  }
  if (!reasons.empty()) table.rows.push_back(std::move(status));
  Scores scores(table, document);
  add_costs(scores, document);
  add_scores(scores);
  // Headings with nothing below them say nothing.
  for (std::size_t i = table.rows.size(); i-- > 0;)
    if (table.rows[i].size() == 1 && (i + 1 == table.rows.size() || table.rows[i + 1].size() == 1))
      table.rows.erase(table.rows.begin() + static_cast<std::ptrdiff_t>(i));
  table.caption =
      "Times are of frames in contact, back to back. The mean without the clock is of whole runs of frames, "
      "one clock pair around each run; the times one by one have a clock pair in every frame.";
  table.notes = std::move(reasons);
  if (!outside.empty())
    table.notes.push_back("Shown to compare with, and not marked as best: " + outside + ".");
  if (scores.settled_any()) table.notes.push_back(zero_note(document));
  return table;
}

}  // namespace palpate::experiments
