#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "experiments/report/page.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

using metrics::RendererResult;
using HeadlineValue = std::function<std::optional<double>(const RendererResult&)>;
using HeadlineShow = std::function<std::string(double)>;

/// "a", "a and b", "a, b and c".
std::string listed(const std::vector<std::string>& items) {
  if (items.size() < 2) return joined(items, "");
  return joined({items.begin(), items.end() - 1}, ", ") + " and " + items.back();
}

using HeadlineInterval = std::function<std::optional<Interval>(const RendererResult&)>;

/// "cloud 0.21 µs, mesh-godobject 0.40 µs (1.9 times)", the lowest first; of many the first ones and the
/// last. Whose interval overlaps that of the first is no worse: "(no difference)".
std::string ranked(const metrics::ResultDocument& document, const HeadlineValue& value,
                   const HeadlineShow& show, const HeadlineInterval& interval = {}) {
  constexpr std::size_t kMany = 7, kFirst = 5;
  std::vector<const RendererResult*> order;
  for (const RendererResult& r : document.renderers)
    if (competes(r) && value(r) && std::isfinite(*value(r))) order.push_back(&r);
  std::stable_sort(order.begin(), order.end(),
                   [&](const RendererResult* a, const RendererResult* b) { return *value(*a) < *value(*b); });
  std::vector<std::string> items;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool last_of_many = order.size() > kMany && i + 1 == order.size();
    if (order.size() > kMany && i >= kFirst && !last_of_many) continue;
    const double own = *value(*order[i]), best = *value(*order.front());
    const bool same = i > 0 && interval && overlap(interval(*order[i]), interval(*order.front()));
    const std::string times = i == 0 ? "" : same ? "no difference" : ratio_text(own, best);
    items.push_back(fmt::format("{}{} {}{}",
                                last_of_many ? fmt::format("{} more up to ", order.size() - kFirst) : "",
                                order[i]->label, show(own), times.empty() ? "" : " (" + times + ")"));
  }
  return joined(items, ", ");
}

std::optional<double> mean_us(const RendererResult& r) {
  return r.frame ? r.frame->mean_us : std::nullopt;
}
std::optional<double> all_us(const RendererResult& r) {
  return r.frame_all ? r.frame_all->mean_us : std::nullopt;
}
std::optional<double> prepare_ms(const RendererResult& r) {
  // What came from a cache was measured on another day, perhaps on another machine.
  return r.prepare && !prepared_from_cache(r) ? std::optional<double>(r.prepare->total_ms) : std::nullopt;
}
std::optional<double> force_rms(const RendererResult& r) {
  return settled_score(r, &metrics::Accuracy::force_rms_percent);
}
/// The best is the highest: ranked by what lacks.
std::optional<double> told_apart(const RendererResult& r) {
  constexpr double kWhole = 100.0;
  if (!r.accuracy || !r.accuracy->indistinguishable_percent) return std::nullopt;
  return kWhole - *r.accuracy->indistinguishable_percent;
}

/// What a renderer's contact got wrong, or nothing.
std::string contact_faults(const RendererResult& r) {
  std::vector<std::string> faults;
  const auto add = [&](std::uint64_t n, const char* one, const char* several) {
    if (n > 0) faults.push_back(fmt::format("{} {}", count_text(n), n == 1 ? one : several));
  };
  add(r.accuracy->caught.value_or(0), "time caught", "times caught");
  add(r.accuracy->lost.value_or(0), "time lost", "times lost");
  add(r.accuracy->kicks.value_or(0), "kick", "kicks");
  add(r.accuracy->missed_contact_frames, "frame of missed contact", "frames of missed contact");
  add(r.accuracy->false_contact_frames, "frame of false contact", "frames of false contact");
  if (r.accuracy->longest_stick_frames > 0)
    faults.push_back(
        fmt::format("stuck for up to {} in a row", count_text(r.accuracy->longest_stick_frames)));
  add(r.accuracy->pop_throughs.value_or(0), "pop-through", "pop-throughs");
  add(r.accuracy->fall_throughs.value_or(0), "fall-through", "fall-throughs");
  // A tolerance as large as the path is deep would call right what never answers.
  if (r.accuracy->felt_percent.value_or(metrics::kRightSharePercent) < metrics::kRightSharePercent)
    faults.push_back(fmt::format("only {} % of the contact is felt", short_number(r.accuracy->felt_percent)));
  return joined(faults, ", ");
}

/// Who keeps contact right, and who does not: what a hand notices first.
std::string contact_verdict(const metrics::ResultDocument& document) {
  // Renderers that differ in shading alone have the same contact: said once.
  std::vector<std::string> clean;
  std::vector<std::pair<std::string, std::vector<std::string>>> faulty;
  for (const RendererResult& r : document.renderers) {
    if (!r.accuracy || !competes(r)) continue;
    const std::string fault = contact_faults(r);
    const auto same =
        std::find_if(faulty.begin(), faulty.end(), [&](const auto& f) { return f.first == fault; });
    if (fault.empty())
      clean.push_back(r.label);
    else if (same != faulty.end())
      same->second.push_back(r.label);
    else
      faulty.push_back({fault, {r.label}});
  }
  std::vector<std::string> parts;
  if (!clean.empty())
    parts.push_back(fmt::format("right with {}: nothing missed, false or stuck", listed(clean)));
  for (const auto& [fault, labels] : faulty)
    parts.push_back(fmt::format("wrong with {}: {}", listed(labels), fault));
  return parts.empty() ? "" : joined(parts, "; ") + " (beyond one local resolution).";
}

}  // namespace

std::vector<Headline> headlines_of(const metrics::ResultDocument& document) {
  std::vector<Headline> lines;
  for (const RendererResult& r : document.renderers)
    if (r.status != metrics::RunStatus::kOk)
      lines.push_back(
          {"Fell short",
           fmt::format("{} {}: {}.", r.label,
                       r.status == metrics::RunStatus::kFailed ? "failed" : "did not finish", r.reason)});
  const auto add = [&](const char* lead, const std::string& text) {
    if (!text.empty()) lines.push_back({lead, text});
  };
  add("Contact", contact_verdict(document));
  const auto percent = [](double p) { return p == 0.0 ? std::string("exact") : short_number(p) + " %"; };
  const auto us = [](double t) { return short_number(t) + " µs"; };
  const auto of_accuracy = [](std::optional<Interval> metrics::Accuracy::*member) {
    return [member](const RendererResult& r) { return r.accuracy ? (*r.accuracy).*member : std::nullopt; };
  };
  const auto of_frames = [](std::optional<trace::FrameStatistics> RendererResult::*set) {
    return [set](const RendererResult& r) { return r.*set ? (r.*set)->mean_interval_us : std::nullopt; };
  };
  constexpr double kWhole = 100.0;
  add("Frames that no hand tells from the truth",
      ranked(
          document, told_apart, [](double lacks) { return short_number(kWhole - lacks) + " %"; },
          [](const RendererResult& r) -> std::optional<Interval> {
            if (!r.accuracy || !r.accuracy->indistinguishable_interval) return std::nullopt;
            return Interval{kWhole - r.accuracy->indistinguishable_interval->high,
                            kWhole - r.accuracy->indistinguishable_interval->low};
          }));
  add("Force error, RMS",
      ranked(document, force_rms, percent, of_accuracy(&metrics::Accuracy::force_rms_percent_interval)));
  add("Mean of all frames", ranked(document, all_us, us, of_frames(&RendererResult::frame_all)));
  add("Mean frame in contact", ranked(document, mean_us, us, of_frames(&RendererResult::frame)));
  std::string cached;
  for (const RendererResult& r : document.renderers)
    if (competes(r) && prepared_from_cache(r)) cached += (cached.empty() ? "" : ", ") + r.label;
  add("Preparation", ranked(document, prepare_ms, duration_text) +
                         (cached.empty() ? "" : "; from the cache, and not ranked: " + cached));
  return lines;
}

}  // namespace palpate::experiments
