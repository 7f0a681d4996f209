// Scores as rows, and the table of all of them.
#include "experiments/report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using Result_ = metrics::RendererResult;
using Value = std::optional<double>;
using Get = ScoreGet;
using GetInterval = std::function<std::optional<Interval>(const Result_&)>;
using Ranks = std::function<bool(const Result_&)>;
enum class Better { kLower, kHigher, kNeither };

constexpr double kNsPerUs = 1e3, kPercent = 100.0;
constexpr double kDegPerRad = 57.295779513082320877;  // 180 / pi

/// Index of the best of `values` in a row; nothing where none is.
std::optional<std::size_t> best_of(const std::vector<Value>& values, const metrics::ResultDocument& document,
                                   Better better, const Ranks& ranks) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; better != Better::kNeither && i < values.size(); ++i) {
    if (!values[i] || !ranks(document.renderers[i])) continue;
    if (!best || (better == Better::kLower ? *values[i] < *values[*best] : *values[i] > *values[*best]))
      best = i;
  }
  return best;
}

/// Rows of a name and a value of every renderer.
class Scores {
 public:
  Scores(Table& table, const metrics::ResultDocument& document) : table_(table), document_(document) {}

  [[nodiscard]] bool any(const Get& get) const {
    return std::any_of(document_.renderers.begin(), document_.renderers.end(),
                       [&](const Result_& r) { return get(r).has_value(); });
  }
  void heading(std::string text) { table_.rows.push_back({plain(std::move(text))}); }

  /// `rounding`: of each renderer's value, what rounding alone makes; empty: none. `interval`: of each value;
  /// whom it does not tell from the best is as good, and it stands in a row below. `ranks`: who may be best.
  void add(std::string name, const Get& get, Better better, Show show, const Get& rounding = {},
           const GetInterval& interval = {}, const Ranks& ranks = competes) {
    std::vector<Value> values;
    for (const Result_& r : document_.renderers) {
      Value value = get(r);
      if (value && !std::isfinite(*value)) value.reset();
      if (value && rounding) {
        const double least = rounding(r).value_or(0.0);
        settled_any_ = settled_any_ || (*value != 0.0 && zero_if_rounding(*value, least) == 0.0);
        value = zero_if_rounding(*value, least);
      }
      values.push_back(value);
    }
    if (std::none_of(values.begin(), values.end(), [](const Value& v) { return v.has_value(); })) return;
    std::vector<Cell> row = score_row(std::move(name), values, show);
    // Values that read the same are as good; where all are, none is marked.
    const std::optional<std::size_t> best = best_of(values, document_, better, ranks);
    const auto is_best = [&](std::size_t i) {
      if (!best || !values[i] || !ranks(document_.renderers[i])) return false;
      return row[i + 1].text == row[*best + 1].text ||
             (interval && overlap(interval(document_.renderers[i]), interval(document_.renderers[*best])));
    };
    std::size_t rivals = 0, equal = 0;
    for (std::size_t i = 0; i < values.size(); ++i) {
      rivals += values[i] && ranks(document_.renderers[i]) ? 1u : 0u;
      equal += is_best(i) ? 1u : 0u;
    }
    for (std::size_t i = 0; i < values.size() && equal < rivals; ++i) row[i + 1].best = is_best(i);
    table_.rows.push_back(std::move(row));
    if (!interval) return;
    std::vector<Cell> below = {plain("its interval, 95 %")};
    bool any = false;
    for (const Result_& r : document_.renderers) {
      below.push_back(plain(interval_text(interval(r))));
      any = any || below.back().text != kMissingNumber;
    }
    if (any) table_.rows.push_back(std::move(below));
    intervals_ = intervals_ || any;
  }
  void lower(std::string name, const Get& get, const Get& rounding = {}) {
    add(std::move(name), get, Better::kLower, Show::kNumbers, rounding);
  }
  void fewer(std::string name, const Get& get) { add(std::move(name), get, Better::kLower, Show::kCounts); }
  /// Something was more than 0 and no more than rounding.
  [[nodiscard]] bool settled_any() const { return settled_any_; }
  /// Intervals stand in the table.
  [[nodiscard]] bool intervals() const { return intervals_; }

 private:
  Table& table_;
  const metrics::ResultDocument& document_;
  bool settled_any_ = false;
  bool intervals_ = false;
};

using Set = std::optional<trace::FrameStatistics> Result_::*;

GetInterval frame_interval(Set set, std::optional<Interval> trace::FrameStatistics::*member) {
  return [set, member](const Result_& r) { return r.*set ? (*(r.*set)).*member : std::nullopt; };
}
Get frame_count(Set set, std::uint64_t trace::FrameStatistics::*member) {
  return [set, member](const Result_& r) -> Value {
    if (!(r.*set)) return std::nullopt;
    const std::uint64_t n = (*(r.*set)).*member;
    // Earlier documents do not say how often, or in how many episodes.
    const bool unsaid =
        n == 0 && (member == &trace::FrameStatistics::passes || member == &trace::FrameStatistics::episodes);
    return unsaid ? std::nullopt : Value(static_cast<double>(n));
  };
}
Value rounding_energy_percent(const Result_& r) {
  if (!r.energy || !(r.energy->max_stored_mj > 0.0)) return std::nullopt;
  return kPercent * r.energy->rounding_mj / r.energy->max_stored_mj;
}

/// Every document of today has the truth's frames; in earlier ones each renderer had its own.
std::string contact_words_of(const metrics::ResultDocument& d) {
  for (const Result_& r : d.renderers)
    if (r.timing && r.timing->contact_of == "truth") return "Frames of the truth's contact";
  for (const Result_& r : d.renderers)
    if (r.timing && r.timing->contact_of == "majority") return "Frames that most renderers call contact";
  return "Frames in contact, each renderer's own";
}

void add_frames_of(Scores& t, Set set) {
  using F = trace::FrameStatistics;
  t.add("mean without the clock, µs", frame_score(set, &F::mean_us), Better::kLower, Show::kNumbers, {},
        frame_interval(set, &F::mean_interval_us));
  t.lower("mean, µs", frame_score(set, &F::mean_clocked_us));
  t.lower("median, µs", frame_score(set, &F::p50_us));
  t.lower("99 %, µs", frame_score(set, &F::p99_us));
  t.add("99.9 %, µs", frame_score(set, &F::p999_us), Better::kLower, Show::kNumbers, {},
        frame_interval(set, &F::p999_interval_us));
  t.lower("longest, µs", frame_score(set, &F::max_us));
}

void add_costs(Scores& t, const metrics::ResultDocument& d) {
  using F = trace::FrameStatistics;
  t.heading("Preparation");
  t.add("preparation", prepare_ms, Better::kLower, Show::kTimes, {}, {},
        [](const Result_& r) { return competes(r) && !prepared_from_cache(r); });
  t.add(
      "processor time of it",
      [](const Result_& r) { return r.prepare_clock ? Value(r.prepare_clock->cpu_ms) : std::nullopt; },
      Better::kNeither, Show::kTimes);
  t.lower("memory, bytes a point", bytes_a_point);
  t.heading(contact_words_of(d));
  const std::string all = frames_text(d);
  t.add("frames in contact" + (all.empty() ? "" : ", " + all), frame_count(&Result_::frame, &F::timed_frames),
        Better::kNeither, Show::kCounts);
  t.add("frames that it calls contact", frame_count(&Result_::frame, &F::contact_frames), Better::kNeither,
        Show::kCounts);
  if (all.empty())
    t.add("frames in all", frame_count(&Result_::frame, &F::frames), Better::kNeither, Show::kCounts);
  add_frames_of(t, &Result_::frame);
  t.add("processor time, mean, µs", frame_score(&Result_::frame, &F::cpu_mean_us), Better::kNeither,
        Show::kNumbers);
  t.lower("paced at 1 kHz, median, µs",
          [](const Result_& r) { return r.paced ? r.paced->frame.p50_us : std::nullopt; });
  t.lower("paced, caches evicted, median, µs",
          [](const Result_& r) { return r.paced_evicted ? r.paced_evicted->frame.p50_us : std::nullopt; });
  t.heading("Free frames");
  add_frames_of(t, &Result_::frame_free);
  t.heading("All frames");
  add_frames_of(t, &Result_::frame_all);
  t.add("longest single reading, µs", frame_score(&Result_::frame_all, &F::worst_us), Better::kNeither,
        Show::kNumbers);
  t.fewer("frames at the work bound", frame_count(&Result_::frame_all, &F::bound_hits));
  t.fewer("missed 1 ms deadlines", frame_count(&Result_::frame_all, &F::deadline_misses_1khz));
  t.fewer("missed 0.2 ms deadlines (5 kHz)", frame_count(&Result_::frame_all, &F::deadline_misses_5khz));
  t.fewer("missed 0.1 ms deadlines (10 kHz)", frame_count(&Result_::frame_all, &F::deadline_misses_10khz));
  t.heading("Timing");
  t.add("passes of each kind", frame_count(&Result_::frame_all, &F::passes), Better::kNeither, Show::kCounts);
  t.add("episodes of contact", frame_count(&Result_::frame, &F::episodes), Better::kNeither, Show::kCounts);
  t.add(
      "the clock in frames one by one, µs",
      [](const Result_& r) { return r.frame ? Value(r.frame->clock_overhead_ns / kNsPerUs) : std::nullopt; },
      Better::kNeither, Show::kNumbers);
}

void add_scores(Scores& t) {
  using A = metrics::Accuracy;
  const auto lower = [&](const char* name, Value A::*score) {
    t.lower(name, accuracy_score(score), [score](const Result_& r) { return Value(rounding_of(r, score)); });
  };
  const auto accuracy_interval = [](std::optional<Interval> A::*member) {
    return [member](const Result_& r) { return r.accuracy ? (*r.accuracy).*member : std::nullopt; };
  };
  t.heading("Errors that a hand feels");
  t.add("largest force, N", accuracy_score(&A::force_peak_n), Better::kNeither, Show::kNumbers);
  t.lower("above the truth's largest, %", accuracy_score(&A::force_peak_excess_percent));
  t.fewer("caught, times", accuracy_score(&A::caught));
  t.fewer("caught, frames", accuracy_score(&A::caught_frames));
  t.fewer("lost, times", accuracy_score(&A::lost));
  t.fewer("lost, frames", accuracy_score(&A::lost_frames));
  t.fewer("kicks", accuracy_score(&A::kicks));
  t.heading("Force against the ground truth");
  t.add("frames that no hand tells from the truth, %", accuracy_score(&A::indistinguishable_percent),
        Better::kHigher, Show::kNumbers, {}, accuracy_interval(&A::indistinguishable_interval));
  lower("force error, RMS, N", &A::force_rms_n);
  t.add(
      "force error, RMS, %", accuracy_score(&A::force_rms_percent), Better::kLower, Show::kNumbers,
      [](const Result_& r) { return Value(rounding_of(r, &A::force_rms_percent)); },
      accuracy_interval(&A::force_rms_percent_interval));
  lower("force error, median, %", &A::force_p50_percent);
  lower("force error, 95 %, %", &A::force_p95_percent);
  lower("force error, largest, N", &A::force_max_n);
  t.add("frames where history decides, % of contact", accuracy_score(&A::history_percent), Better::kNeither,
        Show::kNumbers);
  t.add("force error in these, RMS, N", accuracy_score(&A::history_force_rms_n), Better::kNeither,
        Show::kNumbers);
  t.add("force error with these, RMS, %", accuracy_score(&A::force_rms_whole_percent), Better::kNeither,
        Show::kNumbers);
  t.add("frames within 7 % of the force, %", accuracy_score(&A::within_7_percent), Better::kHigher,
        Show::kNumbers);
  lower("force direction, 99 %, degrees", &A::direction_p99_deg);
  lower("largest excess jump, N", &A::excess_jump_max_n);
  t.fewer("excess jumps", accuracy_score(&A::excess_jumps));
  lower("largest jump error, N", &A::jump_error_max_n);
  t.fewer("jump errors", accuracy_score(&A::jump_errors));
  t.lower("lag, ms", accuracy_score(&A::lag_ms));
  t.lower("ripple, times what touch notices", accuracy_score(&A::ripple_ratio));
  t.lower("relief, times what touch notices", accuracy_score(&A::relief_ratio));
  t.heading("Contact against the ground truth");
  t.add("contact that is felt, %", accuracy_score(&A::felt_percent), Better::kHigher, Show::kNumbers);
  t.fewer("missed contact, frames", accuracy_score(&A::missed_contact_frames));
  t.fewer("false contact, frames", accuracy_score(&A::false_contact_frames));
  t.fewer("missed beyond the device's 0.055 mm, frames", accuracy_score(&A::missed_device_frames));
  t.fewer("false beyond the device's 0.055 mm, frames", accuracy_score(&A::false_device_frames));
  t.fewer("missed beyond 0.1 mm, frames", accuracy_score(&A::missed_tenth_mm_frames));
  t.fewer("false beyond 0.1 mm, frames", accuracy_score(&A::false_tenth_mm_frames));
  t.fewer("longest stick, frames", accuracy_score(&A::longest_stick_frames));
  t.fewer("fall-throughs", accuracy_score(&A::fall_throughs));
  t.fewer("pop-throughs", accuracy_score(&A::pop_throughs));
  lower("onset error, mm", &A::onset_error_mm);
  lower("release error, mm", &A::release_error_mm);
  if (t.any(accuracy_score(&A::friction_cone_percent))) t.heading("Friction by Coulomb's law");
  t.lower("force outside the friction cone, % of contact", accuracy_score(&A::friction_cone_percent));
  t.lower("coefficient while it slips, off by, median, %", accuracy_score(&A::friction_slip_error_percent));
  t.add("stick and slip as the force says, %", accuracy_score(&A::stick_slip_percent), Better::kHigher,
        Show::kNumbers);
  t.lower("drift while it should stick, 95 %, mm/s", accuracy_score(&A::stick_drift_mm_s));
  t.heading("God object and energy");
  lower("god object error, RMS, mm", &A::god_object_rms_mm);
  lower("god object error, largest, mm", &A::god_object_max_mm);
  t.lower(
      "energy generated, %",
      [](const Result_& r) { return r.energy ? r.energy->generated_percent : std::nullopt; },
      rounding_energy_percent);
  t.lower(
      "energy made in the worst episode, %",
      [](const Result_& r) { return r.energy ? r.energy->drawdown_percent : std::nullopt; },
      rounding_energy_percent);
}

void add_stream(Scores& t) {
  using S = metrics::StreamScores;
  const auto number = [](std::optional<double> S::*score) {
    return [score](const Result_& r) { return r.stream ? (*r.stream).*score : std::nullopt; };
  };
  const auto count = [](std::uint64_t S::*score) {
    return [score](const Result_& r) {
      return r.stream ? Value(static_cast<double>((*r.stream).*score)) : std::nullopt;
    };
  };
  if (!t.any(count(&S::frames))) return;
  t.heading("Depth images");
  t.add("taken", count(&S::taken), Better::kNeither, Show::kCounts);
  t.add("skipped, the receiver being busy", count(&S::skipped), Better::kNeither, Show::kCounts);
  t.lower("until the window can be felt, 99 %, ms", number(&S::window_p99_ms));
  t.lower("until the whole image can be felt, 99 %, ms", number(&S::whole_p99_ms));
  t.lower("from light to the tick that feels it, 99 %, ms", number(&S::light_to_tick_p99_ms));
  t.add("swaps under contact", count(&S::swaps_in_contact), Better::kNeither, Show::kCounts);
  t.add("times that contact ended", count(&S::releases), Better::kNeither, Show::kCounts);
  t.lower("step of the force at a swap, largest, N", number(&S::swap_step_max_n));
  t.lower("the same, 99 %, N", number(&S::swap_step_p99_n));
  t.lower("change of the force that no hand made, N/ms", number(&S::rate_max_n_per_ms));
  t.add("frames without a new image", count(&S::stalled_frames), Better::kNeither, Show::kCounts);
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
         (mm > 0.0 ? fmt::format(": {} mm, {} N.", format_number(mm), format_number(n)) : ".");
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

ScoreGet frame_score(Set set, Value trace::FrameStatistics::*member) {
  return [set, member](const Result_& r) { return r.*set ? (*(r.*set)).*member : std::nullopt; };
}

std::optional<double> prepare_ms(const Result_& r) {
  return r.prepare ? Value(r.prepare->total_ms) : std::nullopt;
}

std::optional<double> bytes_a_point(const Result_& r) {
  if (!r.prepare || !r.model || r.model->points == 0) return std::nullopt;
  return static_cast<double>(r.prepare->bytes) / static_cast<double>(r.model->points);
}

std::vector<Cell> score_row(std::string name, const std::vector<Value>& values, Show show) {
  std::vector<std::string> texts;
  if (show == Show::kTimes) {
    AlignedTimes times = format_aligned_times(values);
    name += ", " + times.unit;
    texts = std::move(times.texts);
  } else if (show == Show::kNumbers) {
    texts = format_aligned(values);
  } else {
    for (const Value& v : values)
      texts.push_back(v ? format_count(static_cast<std::uint64_t>(*v)) : kMissingNumber);
  }
  texts.insert(texts.begin(), std::move(name));
  return plain_row(std::move(texts));
}

std::string interval_text(const std::optional<Interval>& interval) {
  if (!interval) return kMissingNumber;
  return fmt::format("{} to {}", format_number(interval->low), format_number(interval->high));
}

bool overlap(const std::optional<Interval>& a, const std::optional<Interval>& b) {
  return a && b && a->low <= b->high && b->low <= a->high;
}

bool prepared_from_cache(const metrics::RendererResult& r) {
  return r.prepare_clock && r.prepare_clock->from_cache;
}

std::string preparation_text(const metrics::RendererResult& r) {
  if (!r.prepare) return kMissingNumber;
  return format_duration(r.prepare->total_ms) + (prepared_from_cache(r) ? " (from the cache)" : "");
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
  if (is_one_of({&A::excess_jump_max_n, &A::jump_error_max_n, &A::path_dependence_n}))
    return 2.0 * a.rounding_n;
  // A share of the true force, by the ratio of the two scores.
  if (is_one_of({&A::force_rms_percent, &A::force_p50_percent, &A::force_p95_percent}))
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
  return zero_if_rounding(*((*r.accuracy).*score), rounding_of(r, score));
}

std::string frames_text(const metrics::ResultDocument& document) {
  std::optional<std::uint64_t> frames;
  for (const Result_& r : document.renderers) {
    if (!r.frame) continue;
    if (frames && *frames != r.frame->frames) return {};
    frames = r.frame->frames;
  }
  return frames ? "of " + format_count(*frames) : "";
}

Table comparison_table(const metrics::ResultDocument& document) {
  Table table;
  table.title = "All scores";
  table.turns = true;
  table.bad_means = "did not run to its end";
  table.columns = {""};
  std::vector<std::string> reasons;
  std::vector<Cell> status = {plain("status")};
  std::vector<std::string> outside;
  for (const Result_& r : document.renderers) {
    table.columns.push_back(r.label);
    if (!competes(r)) outside.push_back(r.label);
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
  add_stream(scores);
  // Headings with nothing below them say nothing.
  for (std::size_t i = table.rows.size(); i-- > 0;)
    if (table.rows[i].size() == 1 && (i + 1 == table.rows.size() || table.rows[i + 1].size() == 1))
      table.rows.erase(table.rows.begin() + static_cast<std::ptrdiff_t>(i));
  table.caption =
      "Times are back to back, of frames that are the same for every renderer. The mean without the clock is "
      "the median of the passes, the clock read at the ends of each stretch of contact; all other times are "
      "of each frame's median over the passes, with a clock pair in every frame.";
  table.notes = std::move(reasons);
  if (!outside.empty())
    table.notes.push_back("Shown to compare with, and not marked as best: " + joined(outside) + ".");
  if (scores.settled_any()) table.notes.push_back(zero_note(document));
  if (scores.intervals()) {
    table.best_means = "the best, and whom the intervals do not tell from it";
    table.notes.push_back(
        "Intervals: 95 %, bootstrap over episodes of contact and over passes. Where two overlap, there is no "
        "difference.");
  }
  std::vector<std::string> cached, few, disturbed;
  constexpr double kDisturbed = 1.1;  // wall over processor: a tenth is more than clocks and interrupts take
  for (const Result_& r : document.renderers) {
    if (r.frame_all && r.frame_all->mean_us && r.frame_all->cpu_mean_us &&
        *r.frame_all->mean_us > kDisturbed * *r.frame_all->cpu_mean_us)
      disturbed.push_back(r.label + " " + format_number(*r.frame_all->cpu_mean_us));
    if (prepared_from_cache(r)) cached.push_back(r.label);
    if (document.conditions && r.frame_all && r.frame_all->passes < document.conditions->rounds)
      few.push_back(fmt::format("{} {}", r.label, r.frame_all->passes));
  }
  const auto note = [&](const std::string& text, const std::vector<std::string>& whom) {
    if (!whom.empty()) table.notes.push_back(text + joined(whom) + ".");
  };
  note("From the cache, with the times of the day it was made, and so never the best: preparation of ",
       cached);
  note(
      "Other programs took the processor while these were timed; by the processor's own clock the mean of "
      "all frames is, in µs: ",
      disturbed);
  if (!few.empty())
    note(fmt::format("Fewer passes than {}, for they would have taken longer than {} s: ",
                     document.conditions->rounds, format_number(document.conditions->budget_s)),
         few);
  return table;
}

}  // namespace palpate::experiments
