// Findings of a result, which stand before any table: warnings, the recommended renderer, and the ranks by
// contact, error, time and preparation; and the report card of a renderer: every threshold that the
// literature gives, and whether it is kept. Pure functions of the document.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/tables.h"

namespace palpate::experiments {

/// One thing found: "Contact", "right with cloud: ...".
struct Headline {
  std::string lead, text;
};

/// Warnings of the scene and the path, then those of every renderer's preparation, with the labels it holds
/// for: "cloud, cloud-smooth: ...". Each text once.
[[nodiscard]] std::vector<std::string> warnings_of(const metrics::ResultDocument& document);

/// warnings_of() and the notes of scene and path, a line each: "palpate: warning: ...", "palpate: note: ...".
[[nodiscard]] std::string findings_text(const metrics::ResultDocument& document);

/// Errors of a renderer's contact against the truth: "1,234 frames of false contact"; empty: none.
[[nodiscard]] std::string contact_faults(const metrics::RendererResult& result);

/// The recommended renderer: its contact is right and no other's force error is surely lower; of these the
/// fastest. `label` is empty where none is right, the whole where there is no choice.
struct Choice {
  std::string label, text;
};
[[nodiscard]] Choice choice_of(const metrics::ResultDocument& document);

/// Renderers that fell short, the recommended one, those that keep contact right, and the ranks by error,
/// time and preparation.
[[nodiscard]] std::vector<Headline> headlines_of(const metrics::ResultDocument& document);

/// The sentence that answers: "Take cloud: contact right, ..", or the first other finding.
[[nodiscard]] Headline answer_of(const metrics::ResultDocument& document);

/// One line a renderer: what it is, force error, what a hand feels as wrong, frames, readiness, memory; the
/// best is marked. The first table of a study's page, and of its terminal.
[[nodiscard]] Table summary_table(const metrics::ResultDocument& document);

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
