// The report. Its first page answers before it explains: the answer in a sentence, one table, one picture;
// then what to know, and the rest. A page needs nothing else, on a screen or on paper.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <palpate/result.h>
#include "experiments/report/figures.h"
#include "experiments/report/findings.h"

namespace palpate::experiments {

struct HeadlineGroup {
  std::string title;
  std::vector<Headline> lines;
};
/// Known facts for a reader: warnings, and notes of scene and path.
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
  std::string opening{};                ///< HTML: the first thing in it
  std::vector<std::string> paragraphs;  ///< plain text
  std::vector<Table> tables;
  std::vector<Figure> figures;
  std::vector<Fact> facts;        ///< options, phases, hashes, exactness
  std::vector<Headline> found{};  ///< what was found, above its tables
};

struct Page {
  std::string title;
  std::vector<Headline> answers{};       ///< the first thing on the page
  std::vector<Table> tables{};           ///< of the first page, below the answers
  std::vector<HeadlineGroup> headlines;  ///< what was found, and what was not done
  std::vector<Figure> figures{};         ///< of the first page
  std::vector<Known> known;              ///< below all that answers
  std::vector<Section> sections;         ///< on the same page, or
  bool apart = false;                    ///< each on a page of its own, ID.html
  std::vector<std::string> commands;     ///< that repeat it
  metrics::DocumentHead about;           ///< machine, commit, time
};

/// Takes over warnings and notes, where there are any.
void add_known(Page& page, Known known);
/// Those of a document. `about`: the study.
[[nodiscard]] Known known_of(const std::string& about, const metrics::ResultDocument& document);

[[nodiscard]] Page begin_page(std::string title, const metrics::DocumentHead& about);

/// Ends the name of a study's picture of time against error, the first of its section's figures.
inline constexpr const char* kTradeSuffix = "-trade";
/// The study's section with what was found and its figures, drawn into `folder`/figures. `name` begins its
/// warnings; it may be empty.
void add_study(Page& page, const Study& study, const std::string& id, const std::string& name,
               const OutputFolder& folder);

/// report.html of one study and the page behind it, drawn from its folder and put into it.
[[nodiscard]] Status draw_report(const OutputFolder& folder);

/// The first page.
[[nodiscard]] std::string to_html(const Page& page);
/// The page of one section, where they are apart.
[[nodiscard]] std::string section_page(const Page& page, const Section& section);
/// report.html, and the pages of the sections that are apart.
[[nodiscard]] Status write_page(const Page& page, const OutputFolder& folder);

/// The style sheet.
[[nodiscard]] const char* page_style();

// Figures in README.md and docs/: each stands in a marked block, which is written from a template and from
// results, never by hand.
//
//   <!-- figures: NAME -->
//   what docs/figures/NAME.txt says, its {..} filled from the results that its first line names
//   <!-- end of figures -->
//
// Results are docs/figures/FILE.json: {"commit", "date", "machine", "documents": {"table7/result.json": ..}},
// documents as a run wrote them, reduced to what is shown; a text is shown as it stands. {table7 cloud
// frame.mean_us µs} is a key of a renderer, with its unit ("s" of a key in ms, "µs", "%", none, or "by:37.4",
// how often it is in that); {table6/neighbours.json modified_knn[dragon].points} one of any document;
// {commit} says where all of it comes from.

struct PageWithFigures {
  std::filesystem::path file;
  std::string before, after;  ///< its text, and with every block written anew
  std::size_t blocks = 0;
};

/// README.md and the pages below docs/ that have such blocks. An Error names the file and line of a block, a
/// template or a value that is not there.
[[nodiscard]] Result<std::vector<PageWithFigures>> pages_with_figures(const std::filesystem::path& checkout);

/// Writes those that differ; answers their names.
[[nodiscard]] Result<std::vector<std::string>> write_page_figures(const std::filesystem::path& checkout);

/// Puts the results of `run`, a folder that `palpate reproduce` has written, in place of what stands in
/// docs/figures/`file`: every value that a template shows of it.
[[nodiscard]] Status take_page_figures(const std::filesystem::path& checkout, const std::string& file,
                                       const std::filesystem::path& run);

}  // namespace palpate::experiments
