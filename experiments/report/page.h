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
/// What a reader must know first: warnings, and notes of scene and path.
struct Known {
  std::string about;  ///< the study; may be empty where there is one only
  std::vector<std::string> warnings, notes;
};
/// Small print about one renderer, or about the whole.
struct Fact {
  std::string about;
  std::vector<std::string> sentences;
};

struct Section {
  std::string id;
  std::string title;
  std::string opening{};                ///< HTML: the first thing in it, or on a page where it is alone
  std::vector<std::string> paragraphs;  ///< plain text
  std::vector<Table> tables;
  std::vector<Figure> figures;
  std::vector<Fact> facts;  ///< options, phases, hashes, exactness
};

struct Page {
  std::string title;
  std::vector<Known> known;              ///< the first thing on the page
  std::vector<HeadlineGroup> headlines;  ///< what was found
  std::vector<Section> sections;
  std::vector<std::string> commands;  ///< that repeat it
  metrics::DocumentHead about;        ///< machine, commit, time
};

/// Takes over warnings and notes, where there are any.
void add_known(Page& page, Known known);
/// Those of a document. `about`: the study.
[[nodiscard]] Known known_of(const std::string& about, const metrics::ResultDocument& document);

[[nodiscard]] Page begin_page(std::string title, const metrics::DocumentHead& about);

/// The study's section with its figures (drawn into `folder`/figures) and its headlines. `name` begins them;
/// it may be empty.
void add_study(Page& page, const Study& study, const std::string& id, const std::string& name,
               const OutputFolder& folder);

/// report.html of one study, drawn from its folder and put into it.
[[nodiscard]] Status draw_report(const OutputFolder& folder);

/// What a reader asks first of every renderer: right, fast, ready when, how large? A picture and four
/// numbers.
[[nodiscard]] std::string opening_html(const metrics::ResultDocument& document);

/// What a study shows: who keeps contact right, who is exact, fast, ready soon. A pure function of the
/// document.
[[nodiscard]] std::vector<Headline> headlines_of(const metrics::ResultDocument& document);

/// A figure as it stands on a page: picture, title and caption.
[[nodiscard]] std::string figure_html(const Figure& figure);
[[nodiscard]] std::string to_html(const Page& page);
/// report.html.
[[nodiscard]] Status write_page(const Page& page, const OutputFolder& folder);

/// The style sheet.
[[nodiscard]] const char* page_style();

}  // namespace palpate::experiments
