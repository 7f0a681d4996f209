#include "experiments/report/findings.h"

#include <fmt/format.h>

#include <algorithm>

namespace palpate::experiments {

std::vector<std::string> warnings_of(const metrics::ResultDocument& document) {
  std::vector<std::string> all = document.warnings;
  if (document.schema == metrics::kFormerResultSchema)
    all.push_back(
        "An earlier version measured this: times are over each renderer's own contact frames, of one pass.");
  std::vector<std::pair<std::string, std::string>> by_text;  // a warning and who it holds for
  for (const metrics::RendererResult& r : document.renderers) {
    if (!r.prepare) continue;
    for (const std::string& warning : r.prepare->warnings) {
      const auto same =
          std::find_if(by_text.begin(), by_text.end(), [&](const auto& w) { return w.first == warning; });
      if (same == by_text.end())
        by_text.emplace_back(warning, r.label);
      else
        same->second += ", " + r.label;
    }
  }
  for (const auto& [warning, labels] : by_text) all.push_back(fmt::format("{}: {}", labels, warning));
  return all;
}

std::string findings_text(const metrics::ResultDocument& document) {
  std::string text;
  for (const std::string& warning : warnings_of(document))
    text += fmt::format("palpate: warning: {}\n", warning);
  for (const std::string& note : document.notes) text += fmt::format("palpate: note: {}\n", note);
  return text;
}

}  // namespace palpate::experiments
