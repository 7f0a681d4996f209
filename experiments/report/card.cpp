#include "experiments/report/card.h"

#include <fmt/format.h>

namespace palpate::experiments {
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
