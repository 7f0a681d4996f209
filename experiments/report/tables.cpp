#include "experiments/report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace palpate::experiments {
namespace {

constexpr std::size_t kGroup = 3;
constexpr double kSecondMs = 1000.0;
constexpr double kMinuteMs = 60000.0;

/// Display width: UTF-8 continuation bytes take no column.
std::size_t width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::string padded(const std::string& text, std::size_t to, bool right) {
  const std::string blanks(to > width(text) ? to - width(text) : 0, ' ');
  return right ? blanks + text : text + blanks;
}

/// Thousands separated before the decimal point.
std::string grouped(std::string digits) {
  const std::size_t first = digits.empty() || digits.front() != '-' ? 0 : 1;
  const std::size_t point = std::min(digits.find('.'), digits.size());
  for (std::size_t at = point; at > first + kGroup; at -= kGroup) digits.insert(at - kGroup, ",");
  return digits;
}

using Result_ = metrics::RendererResult;
using Get = std::function<std::optional<double>(const Result_&)>;
enum class Better { kLower, kHigher, kNeither };

/// How a row's numbers are written.
enum class Show { kNumbers, kCounts, kTimes };

/// Which of `values` is the best of a row; nothing where nobody is: no rival, or all equal.
std::optional<double> best_of(const std::vector<std::optional<double>>& values,
                              const metrics::ResultDocument& document, Better better) {
  std::optional<double> best;
  std::size_t rivals = 0, equal = 0;
  for (std::size_t i = 0; better != Better::kNeither && i < values.size(); ++i) {
    const auto& v = values[i];
    if (!v || !competes(document.renderers[i])) continue;
    ++rivals;
    if (best && *v == *best) ++equal;
    if (best && (better == Better::kLower ? *v >= *best : *v <= *best)) continue;
    best = v;
    equal = 1;
  }
  return equal < rivals ? best : std::nullopt;
}

void add_row(Table& table, const metrics::ResultDocument& document, std::string name, const Get& get,
             Better better, Show show) {
  std::vector<std::optional<double>> values;
  for (const Result_& r : document.renderers) values.push_back(get(r));
  if (std::none_of(values.begin(), values.end(), [](const auto& v) { return v.has_value(); })) return;
  const std::optional<double> best = best_of(values, document, better);
  std::vector<std::string> texts;
  if (show == Show::kTimes) {
    AlignedTimes times = aligned_times(values);
    name += ", " + times.unit;
    texts = std::move(times.texts);
  } else if (show == Show::kNumbers) {
    texts = aligned_numbers(values);
  } else {
    for (const auto& v : values)
      texts.push_back(v ? count_text(static_cast<std::uint64_t>(*v)) : std::string("–"));
  }
  std::vector<Cell> row = {{std::move(name), false, false}};
  for (std::size_t i = 0; i < values.size(); ++i)
    row.push_back({std::move(texts[i]),
                   best && values[i] && *values[i] == *best && competes(document.renderers[i]), false});
  table.rows.push_back(std::move(row));
}

Get frame(std::optional<double> trace::FrameStatistics::*member) {
  return [member](const Result_& r) { return r.frame ? (*r.frame).*member : std::nullopt; };
}
Get accuracy(std::optional<double> metrics::Accuracy::*member) {
  return [member](const Result_& r) { return r.accuracy ? (*r.accuracy).*member : std::nullopt; };
}
Get accuracy_count(std::uint64_t metrics::Accuracy::*member) {
  return [member](const Result_& r) -> std::optional<double> {
    if (!r.accuracy) return std::nullopt;
    return static_cast<double>((*r.accuracy).*member);
  };
}

void add_costs(Table& t, const metrics::ResultDocument& d) {
  t.rows.push_back({{"Preparation", false, false}});
  add_row(
      t, d, "preparation",
      [](const Result_& r) -> std::optional<double> {
        return r.prepare ? std::optional<double>(r.prepare->total_ms) : std::nullopt;
      },
      Better::kLower, Show::kTimes);
  add_row(
      t, d, "memory, bytes a point",
      [](const Result_& r) -> std::optional<double> {
        if (!r.prepare || !r.model || r.model->points == 0) return std::nullopt;
        return static_cast<double>(r.prepare->bytes) / static_cast<double>(r.model->points);
      },
      Better::kLower, Show::kNumbers);
  t.rows.push_back({{"Frame in contact, back to back", false, false}});
  add_row(t, d, "mean, µs", frame(&trace::FrameStatistics::mean_us), Better::kLower, Show::kNumbers);
  add_row(t, d, "median, µs", frame(&trace::FrameStatistics::p50_us), Better::kLower, Show::kNumbers);
  add_row(t, d, "99 %, µs", frame(&trace::FrameStatistics::p99_us), Better::kLower, Show::kNumbers);
  add_row(t, d, "99.9 %, µs", frame(&trace::FrameStatistics::p999_us), Better::kLower, Show::kNumbers);
  add_row(t, d, "longest, µs", frame(&trace::FrameStatistics::max_us), Better::kLower, Show::kNumbers);
  add_row(
      t, d, "missed 1 ms deadlines",
      [](const Result_& r) -> std::optional<double> {
        return r.frame ? std::optional<double>(static_cast<double>(r.frame->deadline_misses_1khz))
                       : std::nullopt;
      },
      Better::kLower, Show::kCounts);
  add_row(
      t, d, "frames at the work bound",
      [](const Result_& r) -> std::optional<double> {
        return r.frame ? std::optional<double>(static_cast<double>(r.frame->bound_hits)) : std::nullopt;
      },
      Better::kLower, Show::kCounts);
  add_row(
      t, d, "paced at 1 kHz, median, µs",
      [](const Result_& r) { return r.paced ? r.paced->frame.p50_us : std::nullopt; }, Better::kLower,
      Show::kNumbers);
  add_row(
      t, d, "paced, caches evicted, median, µs",
      [](const Result_& r) { return r.paced_evicted ? r.paced_evicted->frame.p50_us : std::nullopt; },
      Better::kLower, Show::kNumbers);
}

void add_scores(Table& t, const metrics::ResultDocument& d) {
  using A = metrics::Accuracy;
  t.rows.push_back({{"Against the ground truth", false, false}});
  add_row(t, d, "force error, RMS, N", accuracy(&A::force_rms_n), Better::kLower, Show::kNumbers);
  add_row(t, d, "force error, RMS, %", accuracy(&A::force_rms_percent), Better::kLower, Show::kNumbers);
  add_row(t, d, "force error, largest, N", accuracy(&A::force_max_n), Better::kLower, Show::kNumbers);
  add_row(t, d, "frames within 7 % of the force, %", accuracy(&A::within_7_percent), Better::kHigher,
          Show::kNumbers);
  add_row(t, d, "force direction, 99 %, degrees", accuracy(&A::direction_p99_deg), Better::kLower,
          Show::kNumbers);
  add_row(t, d, "largest excess jump, N", accuracy(&A::excess_jump_max_n), Better::kLower, Show::kNumbers);
  add_row(t, d, "excess jumps", accuracy_count(&A::excess_jumps), Better::kLower, Show::kCounts);
  add_row(t, d, "missed contact, frames", accuracy_count(&A::missed_contact_frames), Better::kLower,
          Show::kCounts);
  add_row(t, d, "false contact, frames", accuracy_count(&A::false_contact_frames), Better::kLower,
          Show::kCounts);
  add_row(t, d, "longest stick, frames", accuracy_count(&A::longest_stick_frames), Better::kLower,
          Show::kCounts);
  add_row(
      t, d, "pop-throughs",
      [](const Result_& r) -> std::optional<double> {
        if (!r.accuracy || !r.accuracy->pop_throughs) return std::nullopt;
        return static_cast<double>(*r.accuracy->pop_throughs);
      },
      Better::kLower, Show::kCounts);
  add_row(t, d, "god object error, RMS, mm", accuracy(&A::god_object_rms_mm), Better::kLower, Show::kNumbers);
  add_row(t, d, "god object error, largest, mm", accuracy(&A::god_object_max_mm), Better::kLower,
          Show::kNumbers);
  add_row(t, d, "onset error, mm", accuracy(&A::onset_error_mm), Better::kLower, Show::kNumbers);
  add_row(t, d, "release error, mm", accuracy(&A::release_error_mm), Better::kLower, Show::kNumbers);
  add_row(
      t, d, "energy generated, %",
      [](const Result_& r) { return r.energy ? r.energy->generated_percent : std::nullopt; }, Better::kLower,
      Show::kNumbers);
}

}  // namespace

std::vector<std::string> aligned_numbers(const std::vector<std::optional<double>>& values) {
  constexpr int kDigits = 3;      // of the smallest
  constexpr int kMostDigits = 5;  // of the largest: more would claim what no measurement holds
  constexpr double kTen = 10.0;
  double low = 0.0, high = 0.0;
  for (const auto& v : values) {
    if (!v || *v == 0.0 || !std::isfinite(*v)) continue;
    const double a = std::abs(*v);
    low = low == 0.0 ? a : std::min(low, a);
    high = std::max(high, a);
  }
  int decimals = 0;
  if (high > 0.0) {
    const int before_point = std::max(0, static_cast<int>(std::floor(std::log10(high))) + 1);
    decimals = std::max(0, kDigits - 1 - static_cast<int>(std::floor(std::log10(low))));
    // A single number, or several small ones, keep their three digits however small they are.
    const int needed = std::max(0, kDigits - 1 - static_cast<int>(std::floor(std::log10(high))));
    decimals = std::min(decimals, std::max(kMostDigits - before_point, needed));
    decimals = std::max(decimals, 0);
  }
  const double least = 0.5 * std::pow(kTen, -decimals);
  std::vector<std::string> texts;
  for (const auto& v : values) {
    if (!v || !std::isfinite(*v))
      texts.emplace_back("–");
    else if (*v == 0.0)
      texts.emplace_back("0");
    else if (std::abs(*v) < least)
      texts.push_back(fmt::format("{}{:.{}f}", *v < 0.0 ? ">-" : "<", std::pow(kTen, -decimals), decimals));
    else
      texts.push_back(grouped(fmt::format("{:.{}f}", *v, decimals)));
  }
  return texts;
}

AlignedTimes aligned_times(const std::vector<std::optional<double>>& ms) {
  double longest = 0.0;
  for (const auto& v : ms) longest = std::max(longest, v.value_or(0.0));
  const bool in_seconds = longest >= kSecondMs;
  std::vector<std::optional<double>> values = ms;
  for (auto& v : values)
    if (v && in_seconds) *v /= kSecondMs;
  return {in_seconds ? "s" : "ms", aligned_numbers(values)};
}

const std::vector<std::string>& contact_words() {
  static const std::vector<std::string> words = {
      "Missed: a frame without force though the HIP is deeper inside than one local resolution (the distance "
      "to the eighth neighbour there).",
      "False: a frame with a force though the HIP is farther outside than one local resolution.",
      "Stick: the longest unbroken run of false frames, the hand held by a surface that it has left."};
  return words;
}

std::string count_text(std::uint64_t value) {
  return grouped(fmt::format("{}", value));
}

std::string short_number(double v) {
  constexpr double kThree = 100.0, kTwo = 10.0, kSmall = 1e-3, kGrouped = 1000.0;
  const double a = std::abs(v);
  if (v == 0.0) return "0";
  if (a >= kGrouped) return (v < 0 ? "-" : "") + count_text(static_cast<std::uint64_t>(std::llround(a)));
  if (a >= kThree) return fmt::format("{:.0f}", v);
  if (a >= kTwo) return fmt::format("{:.1f}", v);
  if (a >= 1.0) return fmt::format("{:.2f}", v);
  if (a >= kSmall) return fmt::format("{:.{}f}", v, 2 - static_cast<int>(std::floor(std::log10(a))));
  return fmt::format("{:.1e}", v);
}
std::string short_number(const std::optional<double>& value) {
  return value ? short_number(*value) : "–";
}

std::string duration_text(double ms) {
  if (ms >= kMinuteMs) return fmt::format("{} min", short_number(ms / kMinuteMs));
  return ms >= kSecondMs ? fmt::format("{} s", short_number(ms / kSecondMs))
                         : fmt::format("{} ms", short_number(ms));
}

std::string html_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

bool competes(const metrics::RendererResult& result) {
  return result.name != "analytic" && result.name != "brute-force";
}

std::string to_text(const Table& table) {
  std::vector<std::size_t> widths;
  for (const std::string& c : table.columns) widths.push_back(width(c));
  for (const auto& row : table.rows)
    for (std::size_t i = 0; row.size() > 1 && i < row.size(); ++i)
      widths[i] = std::max(widths[i], width(row[i].text) + (row[i].best ? 1 : 0));
  std::string text = table.title + "\n";
  const auto line = [&](const std::vector<std::string>& cells) {
    std::string out = " ";
    for (std::size_t i = 0; i < cells.size(); ++i) out += " " + padded(cells[i], widths[i], i > 0) + " ";
    while (!out.empty() && out.back() == ' ') out.pop_back();
    return out + "\n";
  };
  text += line(table.columns);
  for (const auto& row : table.rows) {
    if (row.size() == 1) {
      text += row[0].text + "\n";
      continue;
    }
    std::vector<std::string> cells;
    for (const Cell& cell : row) cells.push_back(cell.text + (cell.best ? "*" : ""));
    text += line(cells);
  }
  for (const std::string& note : table.notes) text += "  " + note + "\n";
  return text;
}

std::string to_html(const Table& table) {
  std::string html = "<div class=\"scroll\"><table>\n";
  if (!table.title.empty()) html += "<caption>" + html_escaped(table.title) + "</caption>\n";
  html += "<thead><tr>";
  for (const std::string& c : table.columns) html += "<th scope=\"col\">" + html_escaped(c) + "</th>";
  html += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) {
    if (row.size() == 1) {
      html += fmt::format("<tr class=\"group\"><th colspan=\"{}\">{}</th></tr>\n", table.columns.size(),
                          html_escaped(row[0].text));
      continue;
    }
    html += "<tr>";
    for (std::size_t i = 0; i < row.size(); ++i)
      html += i == 0 ? "<th scope=\"row\">" + html_escaped(row[i].text) + "</th>"
                     : fmt::format("<td{}>{}</td>",
                                   row[i].best  ? " class=\"best\""
                                   : row[i].bad ? " class=\"bad\""
                                                : "",
                                   html_escaped(row[i].text));
    html += "</tr>\n";
  }
  html += "</tbody></table></div>\n";
  if (!table.caption.empty()) html += "<p class=\"caption\">" + html_escaped(table.caption) + "</p>\n";
  if (!table.notes.empty()) {
    html += "<ul class=\"notes\">";
    for (const std::string& note : table.notes) html += "<li>" + html_escaped(note) + "</li>";
    html += "</ul>\n";
  }
  return html;
}

Table comparison_table(const metrics::ResultDocument& document) {
  Table table;
  table.title = "All scores";
  table.columns = {""};
  std::vector<Cell> status = {{"status", false, false}};
  for (const Result_& r : document.renderers) {
    table.columns.push_back(r.label);
    const bool ok = r.status == metrics::RunStatus::kOk;
    status.push_back({ok                                        ? "ok"
                      : r.status == metrics::RunStatus::kFailed ? "failed"
                                                                : "did not finish",
                      false, !ok});
    if (!ok) table.notes.push_back(r.label + ": " + r.reason);
  }
  table.rows.push_back(std::move(status));
  add_costs(table, document);
  add_scores(table, document);
  // Headings with nothing below them say nothing.
  for (std::size_t i = table.rows.size(); i-- > 0;)
    if (table.rows[i].size() == 1 && (i + 1 == table.rows.size() || table.rows[i + 1].size() == 1))
      table.rows.erase(table.rows.begin() + static_cast<std::ptrdiff_t>(i));
  return table;
}

}  // namespace palpate::experiments
