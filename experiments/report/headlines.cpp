#include <fmt/format.h>

#include <algorithm>
#include <functional>

#include "experiments/report/page.h"

namespace palpate::experiments {
namespace {

using metrics::RendererResult;
using Value = std::function<std::optional<double>(const RendererResult&)>;

const RendererResult* lowest(const metrics::ResultDocument& document, const Value& value) {
  const RendererResult* best = nullptr;
  for (const RendererResult& r : document.renderers)
    if (competes(r) && value(r) && (best == nullptr || *value(r) < *value(*best))) best = &r;
  return best;
}

/// ", 1.9 times as much" where that says something.
std::string times(double value, double best) {
  constexpr double kWorthSaying = 1.05;
  return best > 0.0 && value / best >= kWorthSaying
             ? fmt::format(", {} times as much", short_number(value / best))
             : "";
}

/// " (cloud 0.21 µs, mesh-godobject 0.40 µs, 1.9 times as much)" of all but `best`.
std::string others(const metrics::ResultDocument& document, const RendererResult* best, const Value& value,
                   const std::function<std::string(double)>& show) {
  std::string text;
  for (const RendererResult& r : document.renderers)
    if (&r != best && competes(r) && value(r))
      text += fmt::format("{}{} {}{}", text.empty() ? "" : "; ", r.label, show(*value(r)),
                          times(*value(r), *value(*best)));
  return text.empty() ? "" : " (" + text + ")";
}

std::optional<double> mean_us(const RendererResult& r) {
  return r.frame ? r.frame->mean_us : std::nullopt;
}
std::optional<double> prepare_ms(const RendererResult& r) {
  return r.prepare ? std::optional<double>(r.prepare->total_ms) : std::nullopt;
}
std::optional<double> force_rms(const RendererResult& r) {
  return r.accuracy ? r.accuracy->force_rms_n : std::nullopt;
}

std::string microseconds(double us) {
  return short_number(us) + " µs";
}
std::string newtons(double n) {
  return short_number(n) + " N";
}

/// What a renderer got wrong, or nothing.
std::string shortcomings(const RendererResult& r) {
  if (r.status != metrics::RunStatus::kOk)
    return fmt::format("{} {}: {}", r.label,
                       r.status == metrics::RunStatus::kFailed ? "failed" : "did not finish", r.reason);
  if (!r.accuracy) return {};
  std::vector<std::string> faults;
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) faults.push_back(fmt::format("{} {}", count_text(n), what));
  };
  add(r.accuracy->missed_contact_frames, "frames of missed contact");
  add(r.accuracy->false_contact_frames, "of false contact");
  if (r.accuracy->false_contact_frames > 0) add(r.accuracy->longest_stick_frames, "in the longest stick");
  add(r.accuracy->pop_throughs.value_or(0), "pop-throughs");
  if (faults.empty()) return {};
  std::string text;
  for (const std::string& fault : faults) text += (text.empty() ? "" : ", ") + fault;
  return fmt::format("{}: {}", r.label, text);
}

}  // namespace

std::vector<std::string> headlines_of(const metrics::ResultDocument& document, const std::string& title) {
  std::vector<std::string> lines;
  const std::string where = title.empty() ? "" : title + ": ";
  const bool rivals = std::count_if(document.renderers.begin(), document.renderers.end(), competes) > 1;
  if (const RendererResult* best = rivals ? lowest(document, mean_us) : nullptr)
    lines.push_back(fmt::format("{}the fastest frame in contact is {}'s, {} on average{}.", where,
                                best->label, microseconds(*mean_us(*best)),
                                others(document, best, mean_us, microseconds)));
  if (const RendererResult* best = rivals ? lowest(document, prepare_ms) : nullptr)
    lines.push_back(fmt::format("{}{} is ready first, after {}{}.", where, best->label,
                                duration_text(*prepare_ms(*best)),
                                others(document, best, prepare_ms, duration_text)));
  if (const RendererResult* best = rivals ? lowest(document, force_rms) : nullptr)
    lines.push_back(fmt::format("{}{} is closest to the ground truth, {} RMS force error{}.", where,
                                best->label, newtons(*force_rms(*best)),
                                others(document, best, force_rms, newtons)));
  std::string faults, clean;
  for (const RendererResult& r : document.renderers) {
    const std::string fault = shortcomings(r);
    if (!fault.empty()) faults += (faults.empty() ? "" : "; ") + fault;
    if (fault.empty() && r.accuracy && competes(r)) clean += (clean.empty() ? "" : ", ") + r.label;
  }
  if (!faults.empty())
    lines.push_back(fmt::format("{}fell short beyond one local resolution: {}.", where, faults));
  if (!clean.empty())
    lines.push_back(
        fmt::format("{}no missed, false or stuck contact beyond one local resolution: {}.", where, clean));
  return lines;
}

}  // namespace palpate::experiments
