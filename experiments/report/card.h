// The report card of a renderer: every threshold that the literature gives, and whether it is kept.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/tables.h"

namespace palpate::experiments {

/// One line of a card. docs/reference/scores.md has a section on each.
struct CardItem {
  std::string about;  ///< "lag, ms"
  std::string limit;  ///< "at most 1"
  std::string value;
  bool known = false;  ///< measured here
  bool kept = false;
};

/// The card of one renderer, the headline first; empty without a truth to compare forces with. Always the
/// same items in the same order. A pure function of the result.
[[nodiscard]] std::vector<CardItem> card_of(const metrics::RendererResult& result);

/// A column a renderer; nothing where nobody has a card.
[[nodiscard]] std::optional<Table> card_table(const metrics::ResultDocument& document);

}  // namespace palpate::experiments
