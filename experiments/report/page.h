// The report: one page that needs nothing else, on a screen or on paper.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/figures.h"
#include "experiments/report/tables.h"

namespace palpate::experiments {

/// One thing found: "Contact", "right with cloud: ...".
struct Headline {
  std::string lead, text;
};
struct HeadlineGroup {
  std::string title;
  std::vector<Headline> lines;
};
/// Small print about one renderer, or about the whole.
struct Fact {
  std::string about;
  std::vector<std::string> sentences;
};

struct Section {
  std::string id;
  std::string title;
  std::vector<std::string> paragraphs;  ///< plain text
  std::vector<Table> tables;
  std::vector<Figure> figures;
  std::vector<Fact> facts;  ///< options, phases, hashes, exactness
};

struct Page {
  std::string title;
  std::vector<HeadlineGroup> headlines;  ///< what was found, the first thing on the page
  std::vector<Section> sections;
  std::vector<std::string> commands;  ///< that repeat it
  metrics::ResultDocument about;      ///< machine, commit, time; its renderers are not read
};

[[nodiscard]] Page begin_page(std::string title, const metrics::ResultDocument& about);

/// The study's section with its figures (drawn into `folder`/figures) and its headlines.
void add_study(Page& page, const Study& study, const std::string& id, const OutputFolder& folder);

/// What a study shows: who keeps contact right, who is exact, fast, ready soon. A pure function of the
/// document.
[[nodiscard]] std::vector<Headline> headlines_of(const metrics::ResultDocument& document);

[[nodiscard]] std::string to_html(const Page& page);
/// report.html.
[[nodiscard]] Status write_page(const Page& page, const OutputFolder& folder);

/// The style sheet.
[[nodiscard]] const char* page_style();

}  // namespace palpate::experiments
