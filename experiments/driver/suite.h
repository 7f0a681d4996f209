// A command that takes long: checks its arguments, does its cases one after the other, each once whatever
// interrupts it, and writes a document and a page. Cases are kept as parts (once), or in a file that grows
// case by case and is a result itself (the record of begin).
//
//   Suite suite(context);
//   PALPATE_TRY(suite.open(arguments.out));
//   PALPATE_TRY(suite.begin(RunKey().add(arguments.path)));
//   PALPATE_ASSIGN(const Row row, suite.once<Row>("cloud", key, [&] { return measure(); }));
//   if (suite.partial()) return suite.leave();
//   PALPATE_TRY(suite.publish({"rows.json", to_json(row), {table_of(row)}}, page, arguments.json));
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/report/page.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

/// Results that a suite leaves and prints.
struct SuiteResults {
  std::string file;                     ///< of the document
  std::string json;                     ///< its text
  std::vector<Table> tables;            ///< printed, where the document is not
  std::vector<std::string> warnings{};  ///< told on standard error
  std::vector<std::string> faults{};    ///< the same, before the warnings
};

class Suite {
 public:
  explicit Suite(Context& context) : context_(context) {}

  /// Opens the result folder (OutputFolder::open). Error too: it is one of the files `read`.
  [[nodiscard]] Status open(const std::string& out, std::span<const std::string> read = {});
  /// Begins, or goes on from an earlier run (OutputFolder::begin), and says so where that was interrupted.
  /// From here on an Error is a run that fell short, before it one of bad input (Context::working).
  [[nodiscard]] Status begin(const RunKey& key, const std::string& record = {});

  [[nodiscard]] Context& context() const { return context_; }
  [[nodiscard]] ProgressBar& progress() const { return context_.progress; }
  [[nodiscard]] const OutputFolder& folder() const { return *folder_; }

  /// The value that an interrupted run has kept of a case; false: there is none. A T is described
  /// for JSON where this is called (json_document.h).
  template <class T>
  [[nodiscard]] bool take(const std::string& name, const std::string& key, T& value) const {
    return folder_->take_over(name, key, [&](const std::string& text) { return from_line(text, value); });
  }
  /// Keeps a case, with the files claimed since the last one.
  template <class T>
  [[nodiscard]] Status keep(const std::string& name, const std::string& key, const T& value) const {
    PALPATE_TRY(folder_->keep(name, key, to_line(value)));
    folder_->start_part();
    return Done{};
  }
  /// A case's value: kept by an interrupted run, or measured now and kept. `name`: a file name, shown to the
  /// user. `measure`: a Result<T>. Empty where another process measures the case; see partial().
  template <class T, class Measure>
  [[nodiscard]] Result<T> once(const std::string& name, const std::string& key, const Measure& measure,
                               Case about = {}) const {
    T value{};
    if (take(name, key, value)) return value;
    about.name = name;
    if (!measures(about)) return value;
    folder_->start_part();
    PALPATE_ASSIGN(value, measure());
    PALPATE_TRY(keep(name, key, value));
    return value;
  }

  /// Whether a case that was not taken is measured here: always, unless other processes measure it.
  [[nodiscard]] bool measures(const Case& one) const;
  /// Whether this process leaves cases to others (CaseSelection). Behind its last case it ends by leave().
  [[nodiscard]] bool partial() const { return !context_.cases.all(); }
  /// Writes the list of cases, or leaves what was measured where the whole command finds it. The exit status.
  [[nodiscard]] Result<int> leave() const;
  /// Files of this name that processes of one case left in this folder, sorted.
  [[nodiscard]] std::vector<std::string> files_of_cases(const std::string& name) const;

  /// Writes document and page, and completes the folder.
  [[nodiscard]] Status write(const SuiteResults& results, const Page& page) const;
  /// Writes, and prints: the document with `json`, else what a screen of fifteen lines holds of tables and
  /// warnings (Context::verbose: all of them), and where the page is.
  [[nodiscard]] Status publish(const SuiteResults& results, const Page& page, bool json) const;

 private:
  Context& context_;
  std::optional<OutputFolder> folder_;
};

// A command's cases as jobs of a workflow engine: a table, a Snakefile, and profiles for this machine and for
// a Slurm cluster. A job is this program with the same command line and --case; the last one is the command
// itself, which finds every case kept.
//
//   OUT/jobs/jobs.tsv        a row for each case
//   OUT/jobs/Snakefile       prepare, case, merge, report
//   OUT/jobs/run             the command line, where it was typed
//   OUT/jobs/profiles/NAME   local, slurm: config.yaml for Snakemake 7, config.v8+.yaml from 8 on
//   OUT/jobs/cases/ID        what the process of a case leaves: an OutputFolder of its own
//   OUT/jobs/done            what Snakemake has seen end

inline constexpr const char* kJobsFolder = "jobs";
inline constexpr const char* kCasesFolder = "cases";
/// The id of no case: the process checks its arguments and loads what they name.
inline constexpr const char* kNoCase = "none";

/// The name of a case as one of a file that needs no quotes in a shell: other names end in their hash.
[[nodiscard]] std::string case_id(const std::string& name);

/// A case of one renderer on a scene, with what it may take: known to a factor of three where meshes are
/// made. `frames`: stepped, of all passes; `preparations`: how often it is prepared.
[[nodiscard]] Case case_of(const RendererRequest& request, const render::RendererInfo& info,
                           const std::string& scene, std::size_t points, double frames, double preparations);

/// Writes table, Snakefile and profiles into `out`/jobs, which is returned, and says how they are run.
[[nodiscard]] Result<std::string> write_jobs(const CaseSelection& cases, const std::filesystem::path& out);

/// Becomes Snakemake on this folder; returns where that is not possible alone.
[[nodiscard]] Error run_jobs(const std::string& folder);

// A page as a document: all that its HTML is drawn from, kept beside it in page.json. A drawn figure of a
// section stands in it as the script that draws it.

// With defaults: documents of earlier versions lack what came later.
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Cell, text, best, bad, link)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Table, title, caption, columns, rows, notes, turns, best_means, bad_means)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figure, name, title, caption, svg, wide)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Fact, about, sentences)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Headline, lead, text)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(HeadlineGroup, title, lines)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Known, about, warnings, notes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Section, id, title, opening, paragraphs, tables, figures,
                                                facts, found)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(Page, title, answers, tables, headlines, figures, known,
                                                sections, apart, commands)

inline constexpr const char* kPageFile = "page.json";

/// Head of a document that begin_json() began. Throws nlohmann::json::exception where a key is wrong.
[[nodiscard]] metrics::DocumentHead head_from(const nlohmann::json& document);

/// Puts the script's name in the place of each picture in the sections, and draws them all again by it from
/// the scripts in `folder`/figures.
void put_scripts(std::vector<Section>& sections);
[[nodiscard]] Status draw_scripts(std::vector<Section>& sections, const OutputFolder& folder);

/// Writes the page that `page` makes of a document of this schema in the folder. Error: names the file.
[[nodiscard]] Status draw_again(const OutputFolder& folder, const char* name, const char* schema,
                                const std::function<Result<Page>(const nlohmann::json&)>& page);

/// Writes page.json and the page.
[[nodiscard]] Status keep_page(const Page& page, const OutputFolder& folder);
/// Draws the page again from page.json and the figures' scripts. Error: names the file.
[[nodiscard]] Status draw_kept_page(const OutputFolder& folder);

}  // namespace palpate::experiments
