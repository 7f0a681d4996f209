// The report: one page that needs nothing else, on a screen or on paper.
#pragma once

#include <string>
#include <vector>

#include "experiments/report/figures.h"
#include "experiments/report/tables.h"

namespace palpate::experiments {

struct Section {
  std::string id;
  std::string title;
  std::vector<std::string> paragraphs;  ///< plain text
  std::vector<Table> tables;
  std::vector<Figure> figures;
  std::vector<std::string> facts;  ///< small print: options, hashes, exactness
};

struct Page {
  std::string title;
  std::vector<std::string> headlines;  ///< plain sentences, the most important first
  std::vector<Section> sections;
  std::vector<std::string> commands;  ///< that repeat it
  metrics::ResultDocument about;      ///< machine, commit, time; its renderers are not read
};

[[nodiscard]] Page begin_page(std::string title, const metrics::ResultDocument& about);

/// The study's section with its figures (drawn into `folder`/figures) and its headlines.
void add_study(Page& page, const Study& study, const std::string& id, const OutputFolder& folder);

/// What a study shows, in sentences: who won, what fell short. A pure function of the document.
[[nodiscard]] std::vector<std::string> headlines_of(const metrics::ResultDocument& document,
                                                    const std::string& title);

[[nodiscard]] std::string to_html(const Page& page);
/// report.html.
[[nodiscard]] Status write_page(const Page& page, const OutputFolder& folder);

/// The style sheet.
[[nodiscard]] const char* page_style();

}  // namespace palpate::experiments
