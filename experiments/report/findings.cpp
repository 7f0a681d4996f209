#include "experiments/report/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

using metrics::RendererResult;
using HeadlineInterval = std::function<std::optional<Interval>(const RendererResult&)>;

constexpr double kWholePercent = 100.0;

/// "a", "a and b", "a, b and c".
std::string listed(const std::vector<std::string>& items) {
  if (items.size() < 2) return joined(items, "");
  return joined({items.begin(), items.end() - 1}, ", ") + " and " + items.back();
}

/// The texts in the order of their first use, each with the labels that it holds for.
std::vector<std::pair<std::string, std::vector<std::string>>> by_text(
    const std::vector<std::pair<std::string, std::string>>& labels_and_texts) {
  std::vector<std::pair<std::string, std::vector<std::string>>> all;
  for (const auto& [label, text] : labels_and_texts) {
    auto same = std::find_if(all.begin(), all.end(), [&](const auto& one) { return one.first == text; });
    if (same == all.end()) same = all.insert(all.end(), {text, {}});
    same->second.push_back(label);
  }
  return all;
}

/// "cloud 0.21 µs, mesh-godobject 0.40 µs (1.9 times)", the lowest first; of many the first ones and the
/// last. A renderer whose interval overlaps that of the first is no worse: "(no difference)".
std::string ranked(const metrics::ResultDocument& document, const ScoreGet& value,
                   const std::function<std::string(double)>& show, const HeadlineInterval& interval = {}) {
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
    const std::string times = i == 0 ? "" : same ? "no difference" : format_ratio(own, best);
    items.push_back(fmt::format("{}{} {}{}",
                                last_of_many ? fmt::format("{} more up to ", order.size() - kFirst) : "",
                                order[i]->label, show(own), times.empty() ? "" : " (" + times + ")"));
  }
  return joined(items, ", ");
}

std::optional<double> all_us(const RendererResult& r) {
  return r.frame_all ? r.frame_all->mean_us : std::nullopt;
}
std::optional<double> force_rms(const RendererResult& r) {
  return settled_score(r, &metrics::Accuracy::force_rms_percent);
}

/// Renderers that keep contact right, and those that do not: a hand notices this first. Renderers with the
/// same contact are named together.
std::string contact_verdict(const metrics::ResultDocument& document) {
  std::vector<std::pair<std::string, std::string>> faults;
  for (const RendererResult& r : document.renderers)
    if (r.accuracy && competes(r)) faults.emplace_back(r.label, contact_faults(r));
  std::vector<std::string> parts;
  for (const auto& [fault, labels] : by_text(faults))
    if (fault.empty())
      parts.insert(parts.begin(),
                   fmt::format("right with {}: nothing missed, false or stuck", listed(labels)));
    else
      parts.push_back(fmt::format("wrong with {}: {}", listed(labels), fault));
  return parts.empty() ? "" : joined(parts, "; ") + " (beyond one local resolution).";
}

const char* status_text(const RendererResult& r) {
  return r.status == metrics::RunStatus::kFailed ? "failed" : "did not finish";
}

/// Kind of a renderer, in a word or two.
std::string role_text(const RendererResult& r) {
  const std::string what = r.role == render::Role::kOurs           ? "ours"
                           : r.role == render::Role::kLiteral      ? "as printed"
                           : r.role == render::Role::kReference    ? "ground truth"
                           : r.role == render::Role::kOracle       ? "oracle of tests"
                           : r.works_on == render::Geometry::kMesh ? "rival, on a mesh"
                                                                   : "rival";
  return what + (r.missing.empty() ? "" : "; without " + joined(r.missing, ", "));
}

}  // namespace

std::vector<std::string> warnings_of(const metrics::ResultDocument& document) {
  std::vector<std::string> all = document.warnings;
  if (document.schema == metrics::kFormerResultSchema)
    all.push_back(
        "An earlier version measured this: times are over each renderer's own contact frames, of one pass.");
  std::vector<std::pair<std::string, std::string>> prepared;
  for (const RendererResult& r : document.renderers)
    if (r.prepare)
      for (const std::string& warning : r.prepare->warnings) prepared.emplace_back(r.label, warning);
  for (const auto& [warning, labels] : by_text(prepared)) all.push_back(joined(labels) + ": " + warning);
  return all;
}

std::string findings_text(const metrics::ResultDocument& document) {
  std::string text;
  for (const std::string& warning : warnings_of(document))
    text += fmt::format("palpate: warning: {}\n", warning);
  for (const std::string& note : document.notes) text += fmt::format("palpate: note: {}\n", note);
  return text;
}

std::string contact_faults(const RendererResult& r) {
  if (!r.accuracy) return {};
  const metrics::Accuracy& a = *r.accuracy;
  std::vector<std::string> faults;
  const auto add = [&](std::uint64_t n, const char* one, const char* several) {
    if (n > 0) faults.push_back(fmt::format("{} {}", format_count(n), n == 1 ? one : several));
  };
  add(a.caught.value_or(0), "time caught", "times caught");
  add(a.lost.value_or(0), "time lost", "times lost");
  add(a.kicks.value_or(0), "kick", "kicks");
  add(a.missed_contact_frames, "frame of missed contact", "frames of missed contact");
  add(a.false_contact_frames, "frame of false contact", "frames of false contact");
  if (a.longest_stick_frames > 0)
    faults.push_back(fmt::format("stuck for up to {} in a row", format_count(a.longest_stick_frames)));
  add(a.pop_throughs.value_or(0), "pop-through", "pop-throughs");
  add(a.fall_throughs.value_or(0), "fall-through", "fall-throughs");
  // A tolerance as large as the path is deep would call right what never answers.
  if (a.felt_percent.value_or(metrics::kRequiredSharePercent) < metrics::kRequiredSharePercent)
    faults.push_back(fmt::format("only {} % of the contact is felt", format_number(a.felt_percent)));
  return joined(faults, ", ");
}

Choice choice_of(const metrics::ResultDocument& document) {
  std::vector<const RendererResult*> all, right;
  for (const RendererResult& r : document.renderers)
    if (competes(r) && r.status == metrics::RunStatus::kOk && all_us(r)) all.push_back(&r);
  if (all.size() < 2) return {};
  std::stable_sort(all.begin(), all.end(), [](const RendererResult* a, const RendererResult* b) {
    return *all_us(*a) < *all_us(*b);
  });
  if (std::none_of(all.begin(), all.end(), [](const RendererResult* r) { return r->accuracy.has_value(); }))
    return {
        all.front()->label,
        fmt::format(
            "{} for speed alone, {} µs a frame: without a ground truth (--reference) nothing says which is "
            "right.",
            all.front()->label, format_number(*all_us(*all.front())))};
  for (const RendererResult* r : all)
    if (r->accuracy && contact_faults(*r).empty()) right.push_back(r);
  if (right.empty()) return {"", "none of them unseen: contact is wrong with every one."};
  const auto known = [](const RendererResult* r) { return force_rms(*r) && std::isfinite(*force_rms(*r)); };
  const RendererResult* best = nullptr;
  for (const RendererResult* r : right)
    if (known(r) && (best == nullptr || *force_rms(*r) < *force_rms(*best))) best = r;
  if (best != nullptr)
    std::erase_if(right, [&](const RendererResult* r) {
      return r != best && !(known(r) && overlap(r->accuracy->force_rms_percent_interval,
                                                best->accuracy->force_rms_percent_interval));
    });
  const RendererResult& taken = *right.front();
  std::string text = taken.label + ": contact right";
  if (known(&taken)) text += fmt::format(", force error {} %", format_number(*force_rms(taken)));
  text += fmt::format(", mean frame {} µs", format_number(*all_us(taken)));
  if (right.size() > 1)
    text += fmt::format("; as right as {} at {} of the time", right[1]->label,
                        format_number(*all_us(taken) / *all_us(*right[1])));
  return {taken.label, text + "."};
}

std::vector<Headline> headlines_of(const metrics::ResultDocument& document) {
  using F = trace::FrameStatistics;
  std::vector<Headline> lines;
  for (const RendererResult& r : document.renderers)
    if (r.status != metrics::RunStatus::kOk)
      lines.push_back({"Fell short", fmt::format("{} {}: {}.", r.label, status_text(r), r.reason)});
  const auto add = [&](const char* lead, const std::string& text) {
    if (!text.empty()) lines.push_back({lead, text});
  };
  add("Take", choice_of(document).text);
  add("Contact", contact_verdict(document));
  const auto percent = [](double p) { return p == 0.0 ? std::string("exact") : format_number(p) + " %"; };
  const auto us = [](double t) { return format_number(t) + " µs"; };
  const auto of_frames = [](std::optional<F> RendererResult::*set) {
    return [set](const RendererResult& r) { return r.*set ? (r.*set)->mean_interval_us : std::nullopt; };
  };
  // The best share is the highest: ranked by what lacks.
  add("Frames that no hand tells from the truth",
      ranked(
          document,
          [](const RendererResult& r) -> std::optional<double> {
            if (!r.accuracy || !r.accuracy->indistinguishable_percent) return std::nullopt;
            return kWholePercent - *r.accuracy->indistinguishable_percent;
          },
          [](double lacks) { return format_number(kWholePercent - lacks) + " %"; },
          [](const RendererResult& r) -> std::optional<Interval> {
            if (!r.accuracy || !r.accuracy->indistinguishable_interval) return std::nullopt;
            return Interval{kWholePercent - r.accuracy->indistinguishable_interval->high,
                            kWholePercent - r.accuracy->indistinguishable_interval->low};
          }));
  add("Force error, RMS", ranked(document, force_rms, percent, [](const RendererResult& r) {
        return r.accuracy ? r.accuracy->force_rms_percent_interval : std::nullopt;
      }));
  add("Mean of all frames", ranked(document, all_us, us, of_frames(&RendererResult::frame_all)));
  add("Mean frame in contact", ranked(document, frame_score(&RendererResult::frame, &F::mean_us), us,
                                      of_frames(&RendererResult::frame)));
  std::vector<std::string> cached;
  for (const RendererResult& r : document.renderers)
    if (competes(r) && prepared_from_cache(r)) cached.push_back(r.label);
  // Values from a cache were measured on another day, perhaps on another machine.
  add("Preparation",
      ranked(
          document,
          [](const RendererResult& r) { return prepared_from_cache(r) ? std::nullopt : prepare_ms(r); },
          format_duration) +
          (cached.empty() ? "" : "; from the cache, and not ranked: " + joined(cached)));
  return lines;
}

Headline answer_of(const metrics::ResultDocument& document) {
  for (Headline& found : headlines_of(document))
    if (found.lead != "Fell short") return std::move(found);
  return {};
}

Table summary_table(const metrics::ResultDocument& document) {
  using F = trace::FrameStatistics;
  Table table;
  table.columns = {"renderer"};
  for (const RendererResult& r : document.renderers) table.rows.push_back({plain(r.label)});
  const auto column = [&](const char* name, const auto& cell) {
    table.columns.emplace_back(name);
    for (std::size_t i = 0; i < table.rows.size(); ++i) table.rows[i].push_back(cell(document.renderers[i]));
  };
  /// The lowest of at least two that compete is marked.
  const auto number = [&](const char* name, const ScoreGet& get, const auto& show, const ScoreGet& ranks) {
    std::vector<double> values;
    for (const RendererResult& r : document.renderers)
      if (competes(r) && ranks(r) && std::isfinite(*ranks(r))) values.push_back(*ranks(r));
    const double best = values.size() > 1 ? *std::min_element(values.begin(), values.end()) : -HUGE_VAL;
    column(name, [&](const RendererResult& r) {
      return Cell{show(r, get(r)), competes(r) && ranks(r) && *ranks(r) <= best, false};
    });
  };
  const auto shown = [](const RendererResult&, const std::optional<double>& v) { return format_number(v); };
  const auto ready = [](const RendererResult& r, const std::optional<double>&) {
    return r.status == metrics::RunStatus::kOk ? preparation_text(r) : std::string(status_text(r));
  };
  const auto prepared = [](const RendererResult& r) {
    return prepared_from_cache(r) ? std::nullopt : prepare_ms(r);
  };
  const ScoreGet p999 = frame_score(&RendererResult::frame_all, &F::p999_us);
  column("what it is", [](const RendererResult& r) { return plain(role_text(r)); });
  number("force error, RMS, %", force_rms, shown, force_rms);
  column("contact", [](const RendererResult& r) {
    const std::string faults = contact_faults(r);
    return Cell{!r.accuracy ? kMissingNumber : faults.empty() ? "right" : faults, false, !faults.empty()};
  });
  number("mean of all frames, µs", all_us, shown, all_us);
  number("99.9 % under, µs", p999, shown, p999);
  number("ready after", prepare_ms, ready, prepared);
  number("bytes a point", bytes_a_point, shown, bytes_a_point);
  table.best_means = "the lowest";
  table.bad_means = "contact is wrong";
  return table;
}

namespace {

using R = metrics::RendererResult;

// Thresholds of the literature page; docs/reference/scores.md says where each is from and what it cannot see.
constexpr double kForceJndPercent = 7.0;    // Pang, Tan and Durlach 1991
constexpr double kDirectionJndDeg = 25.6;   // Barbagli et al. 2006, at rest
constexpr double kMostLagMs = 1.0;          // one frame of the 1 kHz loop
constexpr double kMostEnergyPercent = 1.0;  // of the true stored energy
constexpr double kMostPeakPercent = 50.0;   // wrong pieces and edges give many times that, noise a tenth
constexpr double kNoticed = 1.0;            // times what touch notices
constexpr double kDeadlineUs = 1000.0;      // the 1 kHz loop

class Card {
 public:
  void at_most(std::string about, std::optional<double> value, double limit) {
    add(std::move(about), "at most " + format_number(limit), value, value && *value <= limit);
  }
  void at_least(std::string about, std::optional<double> value, double limit) {
    add(std::move(about), "at least " + format_number(limit), value, value && *value >= limit);
  }
  void none(std::string about, std::optional<std::uint64_t> count) {
    items.push_back({std::move(about), "0", count ? format_count(*count) : kMissingNumber, count.has_value(),
                     count == std::optional<std::uint64_t>(0)});
  }

  std::vector<CardItem> items;

 private:
  void add(std::string about, std::string limit, std::optional<double> value, bool kept) {
    items.push_back({std::move(about), std::move(limit), value ? format_number(*value) : kMissingNumber,
                     value.has_value(), kept});
  }
};

}  // namespace

std::vector<CardItem> card_of(const R& r) {
  using A = metrics::Accuracy;
  if (r.status != metrics::RunStatus::kOk || !r.accuracy || !r.accuracy->indistinguishable_percent) return {};
  const A& a = *r.accuracy;
  const auto settled_of = [&](std::optional<double> A::*score) { return settled_score(r, score); };
  Card card;
  card.at_least("frames that no hand tells from the truth, %", a.indistinguishable_percent,
                metrics::kRequiredSharePercent);
  card.at_least("contact that is felt, %", a.felt_percent, metrics::kRequiredSharePercent);
  card.none("caught, times", a.caught);
  card.none("lost, times", a.lost);
  card.none("kicks", a.kicks);
  card.at_most("force above the truth's largest, %", a.force_peak_excess_percent, kMostPeakPercent);
  card.none("missed contact, frames", a.missed_contact_frames);
  card.none("false contact, frames", a.false_contact_frames);
  card.none("fall-throughs", a.fall_throughs);
  card.none("pop-throughs", a.pop_throughs);
  card.at_most("force error, RMS, %", settled_of(&A::force_rms_percent), kForceJndPercent);
  card.at_most("force direction, 99 %, degrees", settled_of(&A::direction_p99_deg), kDirectionJndDeg);
  card.none("jump errors", a.jump_errors);
  card.at_most("lag, ms", a.lag_ms, kMostLagMs);
  card.at_most("ripple, times what touch notices", a.ripple_ratio, kNoticed);
  card.at_most("relief, times what touch notices", a.relief_ratio, kNoticed);
  card.at_most("energy made in the worst episode, %", r.energy ? r.energy->drawdown_percent : std::nullopt,
               kMostEnergyPercent);
  card.at_most("99.9 % of all frames, µs", r.frame_all ? r.frame_all->p999_us : std::nullopt, kDeadlineUs);
  return std::move(card.items);
}

std::optional<Table> card_table(const metrics::ResultDocument& document) {
  Table table;
  table.title = "Report card";
  table.columns = {"", "wanted"};
  std::vector<std::vector<CardItem>> cards;
  for (const R& r : document.renderers) {
    std::vector<CardItem> card = card_of(r);
    if (card.empty()) continue;
    table.columns.push_back(r.label);
    cards.push_back(std::move(card));
  }
  if (cards.empty()) return std::nullopt;
  for (std::size_t i = 0; i < cards.front().size(); ++i) {
    const CardItem& first = cards.front()[i];
    std::vector<Cell> row = {{first.about, false, false}, {first.limit, false, false}};
    for (const std::vector<CardItem>& card : cards)
      row.push_back({card[i].value, false, card[i].known && !card[i].kept});
    table.rows.push_back(std::move(row));
  }
  std::vector<Cell> verdict = {{"all of it", false, false}, {"kept", false, false}};
  for (const std::vector<CardItem>& card : cards) {
    const auto missed = std::count_if(card.begin(), card.end(), [](const CardItem& c) { return !c.kept; });
    verdict.push_back(
        {missed == 0 ? "kept" : fmt::format("{} of {} not", missed, card.size()), false, missed > 0});
  }
  table.rows.push_back(std::move(verdict));
  table.caption =
      "The first line is the headline: of the frames in which the device could show either force, how many "
      "no human threshold tells from the truth. docs/reference/scores.md says of each line where its "
      "threshold is from and what it cannot see.";
  table.bad_means = "beyond the threshold";
  return table;
}

}  // namespace palpate::experiments
